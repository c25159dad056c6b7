"""The plan of a rectangle light tells the noise of its rays, and takes as many as the tolerance wants."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from skinbake.atlas import rasterize
from skinbake.irradiance import light_texels
from skinbake.profile import GaussianSum
from skinbake.scene.lights import RectangleLight
from skinbake.scene.maps import SkinMaps
from tests.shapes import joined, relief

SIZE = (96, 72)
HILL = relief(40.0, 14.0, 6.0, 24)
SKIN = GaussianSum(np.array([0.1, 2.0]), np.array([[0.3, 0.5, 0.8], [0.7, 0.5, 0.2]]), np.zeros(3), np.ones(3))


def box(**more) -> RectangleLight:
    keys = {
        "name": "box", "type": "rectangle", "position_mm": (20, 0, 40), "edge_u_mm": (90, 0, 0),
        "edge_v_mm": (0, -90, 0), "radiance": (1.0, 0.7, 0.4),
    }  # fmt: skip
    return RectangleLight(**(keys | more))


def lit(light, mesh=HILL, size=SIZE, **options):
    atlas = rasterize(mesh, size, gutter=2, udim=options.pop("udim", False))
    return atlas, light_texels(atlas, mesh, SkinMaps(), [light], **options)


@cache
def exact_hill(place=(20, 0, 40)):
    """Under 1600 rays."""
    return lit(box(samples=1600, position_mm=place))


def rms(atlas, found, exact):
    """Relative, by area, over all tiles."""
    area = np.concatenate([raster.area_mm2.ravel() for raster in atlas])[:, None]
    a, b = (np.concatenate([tile.rgb[0].reshape(-1, 3) for tile in tiles]) for tiles in (found, exact))
    return np.sqrt((area * (a - b) ** 2).sum() / (area * b**2).sum())


def line(found):
    (only,) = found[0].plan["box"]
    return only


@pytest.mark.parametrize("samples", [9, 36, 144])
def test_the_noise_of_rays_that_are_asked_for_is_counted(samples):
    """Light as it arrives, against 1600 rays: to a sixth."""
    atlas, exact = exact_hill()
    _, found = lit(box(samples=samples))
    assert line(found).how == f"{samples} rays"
    assert line(found).error == pytest.approx(rms(atlas, found, exact), rel=1 / 6)
    assert line(found).error > 0.001


def test_the_plan_takes_as_many_rays_as_the_tolerance_wants():
    """What is left is below the tolerance, and not far below."""
    atlas, exact = exact_hill()
    counts = []
    for tolerance in (0.1, 0.002, 0.001):
        _, found = lit(box(), tolerance=tolerance)
        counts.append(int(line(found).how.split()[0]))
        assert line(found).error <= tolerance
        assert rms(atlas, found, exact) <= 1.2 * tolerance
        assert counts[-1] == 36 or line(found).error > 0.75 * tolerance
    assert 36 == counts[0] < counts[1] < counts[2]


def test_tiles_of_one_skin_are_planned_together():
    """Half of the skin on each: the noise that is told is that of both."""
    moved, uv = np.add(HILL.positions_mm, (90, 0, 0)), np.add(HILL.corner_uv, (1, 0))
    beside = replace(HILL, positions_mm=moved, corner_uv=uv)
    mesh = joined(HILL, beside)
    atlas, exact = lit(box(samples=1600), mesh, udim=True)
    _, found = lit(box(), mesh, udim=True)
    assert len(atlas) == 2
    assert line(found).error == pytest.approx(rms(atlas, found, exact), rel=1 / 4)


def test_skin_smooths_what_texels_do_not_share():
    """So fewer rays do at a finer texture, and none the fewer where nothing is scattered."""
    coarse, fine, bare = (
        line(lit(box(), size=size, gaussians=skin, tolerance=1.0)[1]).error
        for size, skin in ((SIZE, SKIN), ((512, 384), SKIN), ((512, 384), None))
    )
    assert fine < 0.5 * coarse < 0.5 * bare


def test_without_shadows_nothing_is_planned():
    """Unshadowed light is exact; a light that reaches no skin has no error either."""
    assert "box" not in lit(box(shadows=False))[1][0].plan
    _, found = lit(box(position_mm=(0, 0, -400)))
    assert [each.error for each in found[0].plan["box"]] == [0, 0]  # the other says that it is dark
