"""A job in another process: what it needs to be the same there."""

from __future__ import annotations

import pytest

from skinbake.batch.job import BakeJob, bake_job
from skinbake.errors import MachineError
from skinbake.io.config import load_look
from tests.conftest import ROOT


@pytest.mark.parametrize("advice", [{}, {"advice": "restart watch"}])
def test_other_code_is_refused_with_what_to_do(advice):
    """A watch is restarted, a batch started again; before anything is read."""
    job = BakeJob(load_look(ROOT / "configs" / "head.yaml"), False, True, None, 0, "of another version", **advice)
    with pytest.raises(MachineError, match=advice.get("advice", "update it, or start the batch again")):
        bake_job(job, print)
