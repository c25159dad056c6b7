"""A large picture is drawn in parts, which meet without a seam."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.errors import MachineError
from skinbake.preview import picture_part
from skinbake.preview.camera import view
from skinbake.preview.draw import OffscreenRenderer
from skinbake.preview.picture_part import PicturePart, parts_of, refuse_picture_too_large
from tests.preview.scenes import scene


@pytest.mark.parametrize("size", [(1, 1), (4096, 2048), (4097, 5000), (9001, 3)])
@pytest.mark.parametrize("supersample", [1, 2, 3])
def test_parts_cover_a_picture(size, supersample):
    """Each point once, in parts of whole pixels that OpenGL allows."""
    parts = list(parts_of(size, supersample, largest=3000))
    seen = 0
    for part in parts:
        assert all(side % supersample == 0 and side <= 3000 for side in part.size)
        assert all(at % supersample == 0 for at in part.at)
        inside = [min(s, w - a) for s, w, a in zip(part.size, part.whole, part.at, strict=True)]
        seen += inside[0] * inside[1]
    assert seen == size[0] * size[1] * supersample**2
    assert len({part.at for part in parts}) == len(parts)


def test_a_part_s_projection_puts_its_corners_in_the_corners():
    """Clip coordinates of the whole picture, turned into those of the part."""
    part = PicturePart((300, 200), (150, 60), (30, 20))
    crop = part.projection(np.eye(4))
    for x, y, want in ((150, 60, (-1, -1)), (180, 80, (1, 1)), (165, 70, (0, 0))):
        clip = np.array([2 * x / 300 - 1, 2 * y / 200 - 1, 0.3, 1.0])
        assert (crop @ clip)[:2] == pytest.approx(want)
    whole = np.diag([2.0, 3.0, 4.0, 1.0])
    assert PicturePart((300, 200), (0, 0), (300, 200)).projection(whole) is whole


def test_parts_meet_without_a_seam(monkeypatch):
    """The same picture and the same geometry as drawn at once, but for round-off at edges."""
    try:
        opened = OffscreenRenderer(scene())
    except MachineError as error:
        pytest.skip(str(error))
    with opened:
        size = (117, 91)
        camera = view(opened.scene.mesh, "three-quarter", size[0] / size[1])
        whole = opened.draw(camera, size, supersample=2).rgba
        geometry = opened.draw(camera, size, supersample=1, geometry=True).geometry
        monkeypatch.setattr(picture_part, "MOST_POINTS_A_SIDE", 50)
        assert len(list(parts_of(size, 2, 10**4))) > 10
        parts = opened.draw(camera, size, supersample=2).rgba
        of_parts = opened.draw(camera, size, supersample=1, geometry=True).geometry
        assert whole[..., 3].mean() > 0.2
        assert np.mean(np.abs(parts - whole) > 0.02 * whole.max()) < 0.002
        assert np.mean(of_parts.tile != geometry.tile) < 0.002
        assert np.array_equal(opened.draw(camera, size, supersample=2).rgba, parts)


def test_a_picture_that_memory_does_not_hold_is_refused(monkeypatch):
    """With the size that it would hold."""
    monkeypatch.setattr(picture_part, "physical_memory_bytes", lambda: 2**30)
    refuse_picture_too_large((2000, 1000))
    with pytest.raises(
        MachineError, match=r"a picture of 8000 x 4000 needs about 1.8 GiB; .* room for one of 4634 x 2317"
    ):
        refuse_picture_too_large((8000, 4000))
