"""batch.json: the looks of a batch, and how each fared."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from skinbake.io.record import Record, read_record

NAME = "batch.json"


class _Job(Record):
    """One look."""

    name: str
    status: str
    error: str | None = None
    note: str | None = None


class _Report(Record):
    """Keys that readers of a batch's folder rely on."""

    version: str = "?"
    file: str = "?"
    jobs: list[_Job]


def read_batch_report(folder: Path) -> dict[str, Any]:
    """Read batch.json of a batch's folder.

    Raises
    ------
    InputError
        The folder has none, or it is not ours.
    """
    return read_record(folder / NAME, _Report, f"the folder of a batch with {NAME} in it")
