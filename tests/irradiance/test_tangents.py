"""Tangent frames are MikkTSpace's: those of its own program, and a normal map baked for them comes back."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from skinbake.atlas import interpolate, rasterize, signed_uv_area
from skinbake.irradiance.normal_map import corner_tangents, shading_normals
from skinbake.numerics import normalized
from skinbake.scene.maps import SkinMaps
from tests.shapes import quad, relief, sphere

# x, y, z and the bitangent's sign at each corner, by mikktspace.c as npm's mikktspace 1.1.1 has it
TRUTH = json.loads((Path(__file__).parent / "mikktspace.json").read_text())


def mirrored_relief():
    """Whose right half has the left one's UVs, turned round."""
    mesh = relief(segments=4)
    uv = mesh.corner_uv.copy()
    uv[..., 0] = np.where(uv[..., 0] > 0.5, 1 - uv[..., 0], uv[..., 0])
    return replace(mesh, corner_uv=uv)


MESHES = {"mirrored relief": mirrored_relief, "cube": lambda: sphere(100.0, "cube", 8)}


@pytest.mark.parametrize("name", MESHES)
def test_tangents_are_those_of_the_program(name):
    """At every corner: seams, stretched charts, mirrored ones."""
    mesh, truth = MESHES[name](), np.reshape(TRUTH[name], (-1, 3, 4))
    np.testing.assert_allclose(corner_tangents(mesh), truth[..., :3], atol=2e-5)
    np.testing.assert_array_equal(np.where(signed_uv_area(mesh) < 0, -1, 1)[:, None] * np.ones(3), truth[..., 3])


def test_a_baked_normal_map_comes_back():
    """Normals of a wavy surface, baked onto a coarse cube's charts as bakers do it: the same normals at each texel."""
    mesh, tangent = MESHES["cube"](), np.reshape(TRUTH["cube"], (-1, 3, 4))
    (raster,) = rasterize(mesh, (96, 64), 2)
    on = raster.addressed
    point = interpolate(raster, mesh.corner_position_mm)[on].astype(np.float64)
    wanted = normalized(point / 100 + 0.3 * np.sin(point / 15))
    n = interpolate(raster, mesh.corner_normal)[on].astype(np.float64)
    t = interpolate(raster, tangent[..., :3])[on].astype(np.float64)
    b = np.cross(n, t) * tangent[raster.face_index[on], 0, 3:]
    stored = np.zeros((*raster.shape, 3), np.float32)
    stored[on] = normalized(np.linalg.solve(np.stack([t, b, n], axis=2), wanted[..., None])[..., 0])
    _, found = shading_normals(raster, mesh, SkinMaps(normal={1001: stored}))
    inside = on & (raster.coverage == 1)
    off_deg = np.degrees(np.linalg.norm(np.cross(found[inside], wanted[inside[on]]), axis=1))
    assert inside.sum() > 3000
    assert off_deg.max() < 0.05


def test_tangents_of_a_mesh_are_made_once():
    """And anew for a changed one; they are nobody's to change."""
    mesh = quad()
    found = corner_tangents(mesh)
    assert corner_tangents(mesh) is found
    assert corner_tangents(replace(mesh, corner_uv=1 - mesh.corner_uv)) is not found
    with pytest.raises(ValueError, match="read-only"):
        found[0] = 0


def test_hard_edges_part_tangents():
    """Two faces that share a vertex and its UV, but not its normal, average nothing."""
    mesh = quad()
    normal = mesh.corner_normal.copy()
    normal[1] = normalized(np.array([0.6, 0, 0.8]))
    found = corner_tangents(replace(mesh, corner_normal=normal))
    np.testing.assert_allclose(found[0], np.tile([1, 0, 0], (3, 1)), atol=1e-12)
    np.testing.assert_allclose(found[1], np.tile([0.8, 0, -0.6], (3, 1)), atol=1e-12)


def test_tangents_of_the_file_go_before():
    """Where it brings some; laid into the planes of the normals, of length 1."""
    mesh = quad()
    given = np.tile([0.0, 2.0, 5.0], (2, 3, 1))
    given[1] = np.nan
    found = corner_tangents(replace(mesh, corner_tangent=given))
    np.testing.assert_allclose(found[0], np.tile([0, 1, 0], (3, 1)), atol=1e-12)
    np.testing.assert_allclose(found[1], np.tile([1, 0, 0], (3, 1)), atol=1e-12)
