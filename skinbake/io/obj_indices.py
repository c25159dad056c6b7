"""Indices in the faces of an OBJ, where trimesh takes 0 for the first and drops all UVs for one that is not there."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

from skinbake.errors import InputError

_ZERO = re.compile(rb"[/ \t]-?0+(?![^/\s])")
_WHOLE = re.compile(rb"-?\d{1,18}")
_KINDS = ((b"v", "vertex"), (b"vt", "UV"), (b"vn", "normal"))


def may_hold_zero(text: bytes) -> bool:
    """Whether a face may name index 0, told in hundredths of a second: a `v 0 0 0` between faces looks like one."""
    return _ZERO.search(text, text.find(b"\nf")) is not None


def refuse_bad_indices(path: Path, text: bytes) -> None:
    """Read every face of an OBJ, a few tenths of a second for a head.

    Raises
    ------
    InputError
        A face names a vertex, UV or normal that the file does not hold; the message names its line.
    """
    lines = [line.split() for line in text.splitlines()]
    counts = Counter(line[0] for line in lines if line)
    for number, line in enumerate(lines, 1):
        if line[:1] != [b"f"]:
            continue
        for corner in line[1:]:
            for (tag, name), index in zip(_KINDS, corner.split(b"/"), strict=False):
                count = counts[tag]
                if count and _WHOLE.fullmatch(index) and not 1 <= abs(int(index)) <= count:
                    raise InputError(
                        f"{path}:{number}: f: expected a {name} from 1 to {count}, or from -{count} to -1, "
                        f"got {index.decode()}"
                    )
