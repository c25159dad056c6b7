"""JSON files of ours, read again: by now they may be cut short, edited, or of another version."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from skinbake.errors import InputError
from skinbake.scene.parse import parse


class Record(BaseModel):
    """Keys that readers rely on; other keys are free, and values are as they stand, never converted."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)


def read_record(path: Path, kind: type[Record], what: str) -> dict[str, Any]:
    """Checked JSON object of a file; a key that it lacks has its default.

    Parameters
    ----------
    path : Path
    kind : type of Record
    what : str
        What the user should have given, where there is no such file.

    Raises
    ------
    InputError
        The file is not there, or it is not ours.
    """
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: expected {what}, got: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected JSON, got: {error}") from error
    checked: Record = parse(
        kind, record, lambda key, sentence: ": ".join(filter(None, (str(path), ".".join(map(str, key)), sentence)))
    )
    return checked.model_dump(exclude=set(record)) | dict(record)
