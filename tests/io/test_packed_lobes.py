"""Lobes that are packed before their headers are known get the files that they would have got."""

from pathlib import Path

import numpy as np
import pytest

from skinbake.diffuse.diffuse_map import DiffuseMap, Lobe
from skinbake.io.lobes import StoredLobe, as_stored_lobes, write_lobes
from skinbake.io.packed_lobes import PackedLobes
from skinbake.io.spool import Spool

LIGHTS = ("key", "rim")
HOW = "half", "auto"


def _made(shared: bool = False) -> DiffuseMap:
    """Three lobes of two lights on two tiles; with `shared`, the first two have the same pixels."""
    random = np.random.default_rng(7)
    lobes = [
        Lobe(variance, (0.5, 0.3, 0.2), "surface", {t: random.random((2, 70, 33, 3), np.float32) for t in (1001, 1002)})
        for variance in (0.1, 1.0, 4.0)
    ]
    made = as_stored_lobes(DiffuseMap(LIGHTS, tuple(lobes), None), "half")
    if not shared:
        return made
    first, second, third = made.lobes
    assert isinstance(first, StoredLobe)
    same = StoredLobe(**vars(second) | {"rgb": dict(first.rgb), "total": first.total})
    return DiffuseMap(LIGHTS, (first, same, third), None)


def _write(folder: Path, made: DiffuseMap, separate: bool, ahead: PackedLobes | None = None) -> dict[str, bytes]:
    folder.mkdir(exist_ok=True)
    write_lobes(folder, made, "k", {"skinbake:version": "1"}, *HOW, separate, True, ahead=ahead)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def _pack(ahead: PackedLobes, made: DiffuseMap, lights: tuple[str, ...], lobes: slice = slice(None)) -> None:
    for lobe in made.lobes[lobes]:
        assert isinstance(lobe, StoredLobe)
        for tile, rgb in lobe.rgb.items():
            ahead.pack(rgb, lobe.total[tile], lights)


@pytest.mark.parametrize("separate", [True, False])
@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("some", [slice(None), slice(1)])
def test_files_are_the_same_and_nothing_else_is_left(tmp_path, separate, shared, some):
    made = _made(shared)
    wanted = _write(tmp_path / "wanted", made, separate)
    folder = tmp_path / "got"
    folder.mkdir()
    ahead = PackedLobes(folder, *HOW, Spool())
    _pack(ahead, made, LIGHTS if separate else (), some)
    assert list(folder.iterdir())
    assert _write(folder, made, separate, ahead) == wanted


def test_what_is_packed_with_other_lights_is_not_taken(tmp_path):
    made = _made()
    wanted = _write(tmp_path / "wanted", made, True)
    ahead = PackedLobes(tmp_path, *HOW, Spool())
    _pack(ahead, made, ())
    assert _write(tmp_path / "got", made, True, ahead) == wanted


def test_lobes_that_are_made_anew_are_not_taken_for_those_before(tmp_path):
    ahead = PackedLobes(tmp_path, *HOW, Spool())
    for _ in range(20):  # their memory is free again, but for what `ahead` holds
        _pack(ahead, _made(), LIGHTS)
    made = _made(shared=True)
    assert _write(tmp_path / "got", made, True, ahead) == _write(tmp_path / "wanted", made, True)


def test_what_nobody_takes_is_removed(tmp_path):
    ahead = PackedLobes(tmp_path, *HOW, Spool())
    _pack(ahead, _made(), LIGHTS)
    assert len(list(tmp_path.iterdir())) == 6
    ahead.close()
    assert not list(tmp_path.iterdir())
