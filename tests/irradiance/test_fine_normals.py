"""Heights and repeated details tilt the normals by the slopes they have on the skin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinbake.atlas import interpolate, rasterize
from skinbake.irradiance.fine_normals import add_fine_normals
from skinbake.irradiance.normal_map import shading_normals
from skinbake.scene.maps import DetailNormals, SkinMaps
from tests.shapes import quad, sphere

SIZE = (48, 32)
INNER = (slice(3, -3), slice(3, -3))


def normals(mesh, maps, size=SIZE):
    """Unit normals of the skin at a texture of `size`, and the raster."""
    (raster,) = rasterize(mesh, size)
    return shading_normals(raster, mesh, add_fine_normals(maps, mesh, size, (1001,), False))[1], raster


def test_a_ramp_tilts_by_its_slope_in_millimetres():
    """120 x 60 mm, heights of 6 mm (u + 2 v): slopes .05 along x and .2 along y, exact."""
    u, v = np.meshgrid((np.arange(40) + 0.5) / 40, 1 - (np.arange(24) + 0.5) / 24)
    height_mm = (6 * (u + 2 * v)).astype(np.float32)
    found, _ = normals(quad(120, 60), SkinMaps(height_mm={1001: height_mm}))
    exact = np.array([-0.05, -0.2, 1]) / np.linalg.norm([0.05, 0.2, 1])
    np.testing.assert_allclose(found[INNER], np.broadcast_to(exact, found[INNER].shape), atol=1e-5)


@pytest.mark.parametrize("chart", ["slanted", "mirrored", "upside down"])
def test_a_slope_does_not_depend_on_the_chart(chart):
    """The same ramp of .1 along x on the skin, whatever way its chart lies: (-.1, 0, 1)."""
    mesh = quad(100, 100, columns=2, rows=2)
    way = {"slanted": [[0.6, 0.3], [0.0, 0.5]], "mirrored": [[-1, 0], [0, 1]], "upside down": [[-1, 0], [0, -1]]}[chart]
    uv = (mesh.corner_uv - 0.5) @ np.array(way) + 0.5
    mesh = replace(mesh, corner_uv=uv)
    # Height .1 x as a function of u, v
    u, v = np.meshgrid((np.arange(64) + 0.5) / 64, 1 - (np.arange(64) + 0.5) / 64)
    x = (np.stack([u - 0.5, v - 0.5], axis=-1) @ np.linalg.inv(way))[..., 0] * 100
    found, raster = normals(mesh, SkinMaps(height_mm={1001: (0.1 * x).astype(np.float32)}), (64, 64))
    inside = raster.coverage == 1
    inside[:3] = inside[-3:] = inside[:, :3] = inside[:, -3:] = False
    exact = np.array([-0.1, 0, 1]) / np.hypot(0.1, 1)
    np.testing.assert_allclose(found[inside], np.broadcast_to(exact, found[inside].shape), atol=2e-4)


def test_a_bump_on_a_sphere_faces_as_its_surface_does():
    """Waves of .2 mm on a sphere of 50 mm: the normals of that surface but for its facets: a fifth of the tilt."""
    mesh, size = sphere(50.0, "latlong", 96), (512, 256)
    (raster,) = rasterize(mesh, size)
    u, v = np.meshgrid((np.arange(1024) + 0.5) / 1024, 1 - (np.arange(512) + 0.5) / 512)
    height_mm = 0.2 * np.sin(16 * np.pi * u) * np.sin(np.pi * v) ** 2
    found, _ = normals(mesh, SkinMaps(height_mm={1001: height_mm.astype(np.float32)}), size)
    middle = (slice(40, -40), slice(20, -20))
    smooth, found = (values[middle].astype(float) for values in (shading_normals(raster, mesh, SkinMaps())[0], found))
    # Steps on the sphere along a column and a row, as the layout has them, raised by the wave
    p = interpolate(raster, mesh.corner_position_mm).astype(float)
    phi, theta = np.moveaxis(interpolate(raster, mesh.corner_uv)[middle] * [16 * np.pi, np.pi], -1, 0)
    per_column = 0.2 * 16 * np.pi * np.cos(phi) * np.sin(theta) ** 2 / size[0]
    per_row = 0.2 * np.sin(phi) * 2 * np.pi * np.sin(theta) * np.cos(theta) / size[1]
    east = np.gradient(p, axis=1)[middle] + per_column[..., None] * smooth
    north = -np.gradient(p, axis=0)[middle] + per_row[..., None] * smooth
    exact = np.cross(east, north)
    exact *= np.sign((exact * smooth).sum(-1, keepdims=True)) / np.linalg.norm(exact, axis=-1, keepdims=True)
    tilt, off = (np.sqrt(((values - exact) ** 2).sum(axis=-1).mean()) for values in (smooth, found))
    assert tilt > 0.015
    assert off < 0.2 * tilt, (off, tilt)


def test_slopes_of_all_maps_add_up():
    """Base (.1, 0), detail (0, .2) at half strength, height .05 along x: (.1 - .05, .1)."""
    base = np.full((8, 8, 3), [0.1, 0.0, 1.0], np.float32) / np.float32(np.hypot(0.1, 1))
    detail = np.full((4, 4, 3), [0.0, 0.2, 1.0], np.float32)
    u = np.broadcast_to((np.arange(40) + 0.5) / 40, (40, 40))
    maps = SkinMaps(
        normal={1001: base}, height_mm={1001: (5 * u).astype(np.float32)}, detail=DetailNormals(detail, (3, 3), 0.5)
    )
    found, _ = normals(quad(100, 100), maps)
    exact = np.array([0.1 - 0.05, 0.1, 1])
    exact /= np.linalg.norm(exact)
    np.testing.assert_allclose(found[INNER], np.broadcast_to(exact, found[INNER].shape), atol=1e-5)


def test_a_detail_is_repeated_from_the_lower_left_corner():
    """Three times along u, twice along v, row 0 of the patch on top; what is finer than the texture is averaged."""
    patch = np.zeros((16, 16, 3), np.float32)
    patch[..., 2] = 1
    patch[:8, :8, 0] = 0.3  # its upper left quarter
    fine = add_fine_normals(
        SkinMaps(detail=DetailNormals(patch, (3, 2), 1.0)), quad(100, 100), SIZE, (1001,), False
    ).normal[1001]
    slope = fine[..., 0] / fine[..., 2]
    (height, width), quarter = (SIZE[1], SIZE[0]), np.zeros((16, 16))
    quarter[:8, :8] = 0.3
    np.testing.assert_allclose(slope, np.tile(quarter, (2, 3))[:height, :width], atol=0.16)
    assert np.abs(slope - np.tile(quarter, (2, 3))).mean() < 0.02
    coarse = add_fine_normals(
        SkinMaps(detail=DetailNormals(patch, (200, 200), 1.0)), quad(100, 100), SIZE, (1001,), False
    ).normal[1001]
    np.testing.assert_allclose(coarse[..., 0] / coarse[..., 2], 0.3 / 4, atol=1e-5)


def test_without_either_nothing_changes():
    """The very same maps, and those that are left as they were."""
    maps = SkinMaps(normal={1001: np.ones((2, 2, 3), np.float32)})
    assert add_fine_normals(maps, quad(), SIZE, (1001,), False) is maps


def test_slopes_finer_than_a_texel_widen_the_oil():
    """A detail eight times as fine as the texture leaves the normals flat, and adds its slopes' variance to m^2; one
    that the texture resolves adds nothing.
    """
    rng = np.random.default_rng(3)
    slope = rng.normal(0, 0.2, (32, 32, 2)).astype(np.float32)
    slope -= slope.mean(axis=(0, 1))
    patch = np.concatenate([slope, np.ones_like(slope[..., :1])], axis=2)
    detail = DetailNormals(patch, (32.0, 32.0), 0.5)  # 32 x 32 texels in one of the texture's
    found = add_fine_normals(SkinMaps(detail=detail), quad(60, 60), (32, 32), (1001,), False, 0.25)
    np.testing.assert_allclose(found.normal[1001], np.broadcast_to([0, 0, 1], (32, 32, 3)), atol=1e-5)
    wanted = np.sqrt(0.25**2 + 0.25 * (slope**2).sum(axis=2).mean())
    np.testing.assert_allclose(found.roughness[1001], wanted, rtol=1e-4)
    coarse = DetailNormals(patch, (1.0, 1.0), 0.5)
    assert not add_fine_normals(SkinMaps(detail=coarse), quad(60, 60), (64, 64), (1001,), False, 0.25).roughness
