"""sha256 of files and of plain values."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from skinbake.errors import InputError


def sha256_of(path: Path | str) -> str:
    """Digest of a file's bytes.

    Raises
    ------
    InputError
        The file is missing or cannot be read.
    """
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, ValueError) as error:  # ValueError: a NUL byte, from a damaged manifest
        got = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{path}: expected a file that can be read, got: {got}") from error


def array_digest(array: NDArray[Any]) -> str:
    """Digest of an array's values, shape and type."""
    return hashlib.sha256(f"{array.dtype.str} {array.shape} ".encode() + array.tobytes()).hexdigest()


def key_of(*parts: Any) -> str:
    """Digest of plain values (anything JSON can hold)."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()
