"""The same pixels under another header: what was packed once is not packed again.

Lobes that are too narrow to be blurred are all the light itself, and packing is a seventh of a bake. The bytes are
those that `write_parts` would write.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from skinbake.io.atomic import atomic_write
from skinbake.io.exr_header import encoded, offsets_of, read_headers


def copy_parts(source: Path, path: Path, attributes: Mapping[str, str | float | list[float]]) -> bool:
    """Write a copy of our own EXR, with other values of some header attributes in every part.

    Parameters
    ----------
    source : Path
        As `write_parts` left it.
    path : Path
    attributes : mapping
        Text, a number or several; those that `source` has not are added.

    Returns
    -------
    bool
        False where the file is laid out otherwise than `write_parts` does, and nothing was written.

    Raises
    ------
    InputError, MachineError
        As `atomic_write`.
    """
    content = source.read_bytes()
    try:
        headers = read_headers(content)
        offsets = offsets_of(content, headers.end)
    except (struct.error, ValueError, IndexError):
        return False
    new = {name: encoded(value) for name, value in attributes.items()}
    begin = replace(headers, parts=[{**part, **new} for part in headers.parts]).encoded()
    moved = len(begin) - headers.end
    table = struct.pack(f"<{len(offsets)}Q", *(offset + moved for offset in offsets))
    with atomic_write(path) as temporary, open(temporary, "wb") as file:
        file.write(begin)
        file.write(table)
        file.write(memoryview(content)[headers.end + len(table) :])
    return True
