"""Every program's way to say "one file a tile"."""

from __future__ import annotations

import pytest

from skinbake.io.tile_names import name_of_tile, names_tiles, tile_files


@pytest.mark.parametrize(
    ("pattern", "first", "last"),
    [
        ("a.<UDIM>.png", "a.1001.png", "a.1023.png"),
        ("a.<udim>.png", "a.1001.png", "a.1023.png"),
        ("a_%(UDIM)d.tif", "a_1001.tif", "a_1023.tif"),
        ("a_<UVTILE>.exr", "a_u1_v1.exr", "a_u3_v3.exr"),
        ("<UDIM>/a[1].<UDIM>.png", "1001/a[1].1001.png", "1023/a[1].1023.png"),
    ],
)
def test_patterns_name_and_find_their_files(tmp_path, pattern, first, last):
    """Names of tiles 1001 and 1023; the files that are there, and no others."""
    path = str(tmp_path / pattern)
    assert names_tiles(path)
    assert [name_of_tile(path, tile) for tile in (1001, 1023)] == [str(tmp_path / name) for name in (first, last)]
    for name in (first, last, "a.0999.png", "a_u0_v1.exr", "1001/a1.1001.png", "a.10011.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert tile_files(path) == {1001: tmp_path / first, 1023: tmp_path / last}


def test_a_single_file_is_tile_1001(tmp_path):
    """There or not: who reads it says so."""
    assert not names_tiles("skin.1001.png")
    assert tile_files("skin.1001.png") == {1001: tmp_path.__class__("skin.1001.png")}
