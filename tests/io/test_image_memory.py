"""Images are weighed before they are decoded."""

from __future__ import annotations

import pytest

from skinbake.errors import MachineError
from skinbake.io import image_memory
from skinbake.io.read_maps import read_maps
from skinbake.scene.map_files import MapsSpec
from tests.images import flat_png


def test_a_picture_that_no_memory_holds_is_refused_undecoded(tmp_path, monkeypatch):
    """30000 x 30000 texels, in a file of a megabyte: named, with what it needs, on a machine of 4 GiB."""
    path = flat_png(tmp_path / "huge.png", 30000, 30000)
    assert path.stat().st_size < 5e6
    monkeypatch.setattr(image_memory, "physical_memory_bytes", lambda: 4 << 30)
    monkeypatch.setattr("skinbake.io.read_maps.read_stored", lambda *_: pytest.fail("it was decoded"))
    with pytest.raises(MachineError, match=r"huge\.png: 30000 x 30000 texels need about 11 GiB .* has 4 GiB"):
        read_maps(MapsSpec(albedo=str(path)))


def test_maps_count_together(tmp_path, monkeypatch):
    """Two that fit alone, and not beside each other."""
    first, second = (flat_png(tmp_path / name, 2000, 1000) for name in ("a.png", "r.png"))
    monkeypatch.setattr(image_memory, "physical_memory_bytes", lambda: 30_000_000)
    read_maps(MapsSpec(albedo=str(first)))
    with pytest.raises(MachineError, match=r"a\.png: 2000 x 1000 .* with the other images\)"):
        read_maps(MapsSpec(albedo=str(first), roughness=str(second)))
