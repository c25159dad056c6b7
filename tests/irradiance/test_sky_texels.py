"""Texels that stand for the skin and tell what it sees of the sky."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.atlas import rasterize
from skinbake.irradiance import smooth_surface
from skinbake.irradiance.lattice import lattice
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.sky_texels import SMALLEST, TELL, TEXEL_MM, SkyTexels, sky_texels
from skinbake.irradiance.surface import places_of_texels, texel_surface
from skinbake.scene.maps import SkinMaps
from skinbake.scene.spec import SpecularSpec
from tests.shapes import joined, quad, sphere


def texels_of(mesh, size=(96, 64), udim=False):
    return SkyTexels(mesh, Occluder(mesh), size, udim=udim)


def test_texels_are_of_two_millimetres_whatever_the_texture_has():
    """And no fewer than `SMALLEST` along the shorter side; not more than the texture's."""
    mesh = quad(400.0, 300.0)
    occluder, (width, height) = Occluder(mesh), (200, 150)
    for size in ((800, 600), (4096, 3072)):
        small = sky_texels(mesh, occluder, size, 8, False).size
        assert small == pytest.approx((width, height), rel=0.2)
        assert 400.0 * 300.0 / (small[0] * small[1]) == pytest.approx(TEXEL_MM**2, rel=0.35)
    assert min(sky_texels(quad(4.0, 3.0), occluder, (800, 600), 8, False).size) >= SMALLEST
    assert sky_texels(mesh, occluder, (40, 30), 8, False).size == (40, 30)


@pytest.mark.parametrize("tiles", [1, 2])
def test_they_stand_for_equal_areas(tiles):
    """A mean over them is that over the skin, also where a texel holds much more skin than others, and over tiles."""
    mesh = sphere(60.0, "latlong", 24, tiles=tiles)
    found = texels_of(mesh, udim=tiles > 1)
    assert [len(each) > 0.4 * TELL for each in found.numbers.values()] == [True] * tiles
    total = sum(len(each) for each in found.numbers.values())
    assert total == TELL
    towards = np.concatenate([found.seen[t].normal[np.searchsorted(found.seen[t].texels, n)]
                              for t, n in found.numbers.items()])  # fmt: skip
    # Of a sphere's normals, all directions are alike
    np.testing.assert_allclose(towards.mean(axis=0), 0, atol=0.02)
    np.testing.assert_allclose(towards.T @ towards / TELL, np.eye(3) / 3, atol=0.02)


def test_they_lie_where_all_directions_are_traced():
    """On the lattice; where that has too few texels, as on a small thing, on a finer one."""
    large, small = texels_of(quad(150.0, 100.0)), texels_of(quad(6.0, 4.0))
    for found, apart in ((large, 2), (small, 2)):
        assert lattice(found.atlas[0]) >= apart
        row, col = np.divmod(found.numbers[1001], 96)
        assert not (row % apart).any()
        assert not (col % apart).any()
    assert lattice(small.atlas[0]) == 32
    assert len(np.unique(small.numbers[1001])) == len(small.numbers[1001]) == TELL


def test_skin_of_no_texels_has_none():
    """Nothing is traced, and nobody divides by it."""
    mesh = quad(40.0, 30.0, uv_box=(2.0, 2.0, 3.0, 3.0))
    found = texels_of(mesh)
    assert len(found.numbers[1001]) == 0
    assert found.seen[1001].share.shape == (0, len(found.towards))


def test_some_texels_are_where_all_of_them_are(monkeypatch):
    """Their rays start at the same place to the bit, also where other skin is in the way up to the smooth surface."""
    monkeypatch.setattr(smooth_surface, "MAX_FACES", 0)  # coarse facets: a long way up
    mesh = joined(sphere(60.0, "cube", 24), sphere(60.2, "cube", 24))
    occluder, (raster,) = Occluder(mesh), rasterize(mesh, (96, 64), 2)
    surface = texel_surface(raster, mesh, SkinMaps(), SpecularSpec(), occluder)
    assert surface.on_facet.any()
    addressed = np.flatnonzero(raster.addressed)[::3]
    origin, normal = places_of_texels(raster, addressed, mesh, occluder)
    np.testing.assert_array_equal(origin, surface.origins(addressed))
    np.testing.assert_array_equal(normal, surface.smooth_normal.reshape(-1, 3)[addressed])
