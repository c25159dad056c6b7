"""Looks of a batch that differ in their skin alone, which may take each other's blurs."""

from __future__ import annotations

from collections.abc import Sequence

from skinbake.baking.shared_blurs import SharedBlurs, share_blurs
from skinbake.io.batch_file import BatchJob
from skinbake.io.digests import key_of


def shared_among(jobs: Sequence[BatchJob], wanted: Sequence[BatchJob]) -> dict[str, SharedBlurs]:
    """Whether each wanted look that is like an earlier one but for its skin takes that one's blurs, by name.

    The first look of each kind is the base of the others, whether it is wanted or not: a look's lobes do not depend on
    what it is baked with. Equal skins need nothing.

    Parameters
    ----------
    jobs : sequence of BatchJob
        All of the batch.
    wanted : sequence of BatchJob
        Those to be baked.
    """
    first: dict[str, BatchJob] = {}
    names, found = {job.name for job in wanted}, {}
    for job in jobs:
        rest = job.spec.model_dump(mode="json", exclude={"skin": True, "output": {"dir"}})
        base = first.setdefault(key_of(rest), job)
        if job.name in names and job.spec.skin != base.spec.skin:
            found[job.name] = share_blurs(job.spec, base.name, base.spec)
    return found
