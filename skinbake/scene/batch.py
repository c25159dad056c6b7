"""BatchSpec: many looks from one file, as `defaults`, `jobs` and a `matrix` of named overrides."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BeforeValidator, ConfigDict, Field, model_validator

from skinbake.scene.strict import Strict

Key = tuple[str | int, ...]
MOST_LOOKS = 10_000
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]
# `medium:` with nothing after it is an option that changes nothing
Override = Annotated[dict[str, Any], BeforeValidator(lambda value: {} if value is None else value)]


class JobEntry(Strict):
    """One look by name; every other key is an override of the defaults."""

    model_config = ConfigDict(extra="allow", frozen=True)

    name: Name


class BatchSpec(Strict):
    """A batch file.

    Attributes
    ----------
    defaults : mapping
        A look, or part of one over the look file that its key `base` names.
    jobs : tuple of JobEntry
    matrix : mapping of axis to mapping of option to override
        Every combination of one option from each axis is a look; its name is the options' names, joined by `-`.
    """

    defaults: Override = Field(default_factory=dict)
    jobs: tuple[JobEntry, ...] = ()
    matrix: dict[Name, dict[Name, Override]] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _something_to_do(self) -> BatchSpec:
        if not self.jobs and not self.matrix:
            raise ValueError("expected jobs, a matrix, or both, got neither")
        empty = [axis for axis, options in self.matrix.items() if not options]
        if empty:
            raise ValueError(f"expected at least one option in matrix.{empty[0]}, got none")
        looks = len(self.jobs) + math.prod(map(len, self.matrix.values())) * bool(self.matrix)
        if looks > MOST_LOOKS:
            raise ValueError(f"expected at most {MOST_LOOKS:,} looks, got {looks:,}")
        names = Counter(plan.name for plan in expand(self))
        twice = sorted(name for name, count in names.items() if count > 1)
        if twice:
            raise ValueError(f"expected job names that differ, got {', '.join(twice)} more than once")
        return self


@dataclass(frozen=True)
class PlannedJob:
    """One look of a batch before its overrides are applied.

    Attributes
    ----------
    name : str
    overrides : tuple of key paths into the batch file, applied from left to right
    choices : mapping of axis to option, empty for an entry of `jobs`
    """

    name: str
    overrides: tuple[Key, ...]
    choices: Mapping[str, str]


def expand(spec: BatchSpec) -> tuple[PlannedJob, ...]:
    """Looks of a batch: its jobs in their order, then all combinations of the matrix, the last axis running fastest."""
    jobs = [PlannedJob(job.name, (("jobs", i),), {}) for i, job in enumerate(spec.jobs)]
    for options in itertools.product(*spec.matrix.values()) if spec.matrix else ():
        choices = dict(zip(spec.matrix, options, strict=True))
        keys = tuple(("matrix", axis, option) for axis, option in choices.items())
        jobs.append(PlannedJob("-".join(options), keys, choices))
    return tuple(jobs)
