"""UDIM tiles in file names: `<UDIM>`, `<udim>` and `%(UDIM)d` are 1001, 1002, ..., `<UVTILE>` is u1_v1, u2_v1, ..."""

from __future__ import annotations

import glob
import re
from collections.abc import Collection
from pathlib import Path

from skinbake.atlas import FIRST_TILE, tile_origin

_MARK = re.compile(r"<UDIM>|%\(UDIM\)d|<UVTILE>", re.IGNORECASE)
MARKS = "<UDIM>, %(UDIM)d or <UVTILE>"


def names_tiles(path: str) -> bool:
    """Whether a path stands for one file a tile."""
    return _MARK.search(path) is not None


def name_of_tile(path: str, tile: int) -> str:
    """The path of one tile's file; unchanged where it names no tiles."""
    u, v = tile_origin(tile)
    return _MARK.sub(lambda mark: f"u{u + 1}_v{v + 1}" if _is_uv(mark[0]) else str(tile), path)


def name_of_tiles(name: str, tiles: Collection[int]) -> str:
    """The name with a mark in place of the number of one of these tiles; unchanged where it has none of them."""
    for tile in tiles:
        u, v = tile_origin(tile)
        marked = re.sub(rf"(?<![a-zA-Z])u{u + 1}_v{v + 1}(?!\d)", "<UVTILE>", name)
        marked = re.sub(rf"(?<!\d){tile}(?!\d)", "<UDIM>", marked)
        if marked != name:
            return marked
    return name


def tile_files(path: str) -> dict[int, Path]:
    """Files that are there by tile, ascending; the file itself as tile 1001, there or not, where it names no tiles."""
    marks = _MARK.findall(path)
    if not marks:
        return {FIRST_TILE: Path(path)}
    between = _MARK.split(path)
    pattern, numbers = glob.escape(between[0]), re.escape(between[0])
    for mark, text in zip(marks, between[1:], strict=True):
        pattern += ("u*_v*" if _is_uv(mark) else "[1-9][0-9][0-9][0-9]") + glob.escape(text)
        numbers += (r"u(\d+)_v(\d+)" if _is_uv(mark) else r"([1-9]\d{3})") + re.escape(text)
    found = {}
    for name in glob.glob(pattern):
        match = re.fullmatch(numbers, name)
        if match is None:
            continue
        tile = int(match[1]) if not _is_uv(marks[0]) else FIRST_TILE + int(match[1]) - 1 + 10 * (int(match[2]) - 1)
        if tile >= FIRST_TILE and name_of_tile(path, tile) == name:
            found[tile] = Path(name)
    return dict(sorted(found.items()))


def _is_uv(mark: str) -> bool:
    return mark.upper() == "<UVTILE>"
