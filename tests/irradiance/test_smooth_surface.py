"""The surface that rays meet is the one the normals imply, closed where the mesh is closed."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.irradiance.smooth_surface import FLAT_ENOUGH_MM, descend, smooth_surface
from skinbake.scene.mesh import SkinMesh
from tests.shapes import quad, sphere


def cube(smooth: bool) -> SkinMesh:
    corner = np.array([[x, y, z] for x in (-50, 50) for y in (-50, 50) for z in (-50, 50)], float)
    faces = []
    for axis in range(3):
        for side in (0, 1):
            i = [k for k in range(8) if (corner[k, axis] > 0) == bool(side)]
            order = [i[0], i[1], i[3], i[2]]
            n = np.cross(corner[order[1]] - corner[order[0]], corner[order[2]] - corner[order[0]])
            if n @ corner[i].mean(axis=0) < 0:
                order = order[::-1]
            faces += [[order[0], order[1], order[2]], [order[0], order[2], order[3]]]
    faces = np.array(faces, np.int32)
    mesh = SkinMesh(corner, faces, np.zeros((12, 3, 2)), np.zeros((12, 3, 3)))
    normal = corner[faces] / np.linalg.norm(corner[0]) if smooth else np.repeat(mesh.face_normal[:, None], 3, axis=1)
    return SkinMesh(corner, faces, np.zeros((12, 3, 2)), normal)


def edges_with_other_than_two_faces(faces):
    pairs = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return np.count_nonzero(np.unique(pairs, axis=0, return_counts=True)[1] != 2)


@pytest.mark.parametrize("segments", [12, 16, 24])
def test_a_coarse_sphere_becomes_round(segments):
    """The refined mesh lies on the sphere to a twentieth of what the coarse facets missed, and it is closed."""
    radius = 80.0
    mesh = sphere(radius, "latlong", segments)
    fine = smooth_surface(mesh)
    missed = radius * (1 - np.cos(np.pi / segments / 2))  # sagitta of the coarse facets
    assert fine.levels >= 1
    error = np.abs(np.linalg.norm(fine.positions_mm, axis=1) - radius)
    assert error.max() < max(0.05 * missed, FLAT_ENOUGH_MM)
    assert edges_with_other_than_two_faces(fine.faces) == 0
    radial = fine.positions_mm[fine.faces] / np.linalg.norm(fine.positions_mm[fine.faces], axis=2, keepdims=True)
    assert np.einsum("fki,fki->fk", fine.corner_normal, radial).min() > 0.999


def test_flat_and_hard_edged_meshes_stay_as_they_are():
    """A quad and a cube with hard edges are not bent: no level is needed."""
    for mesh in (quad(columns=3), cube(smooth=False)):
        fine = smooth_surface(mesh)
        assert fine.levels == 0
        assert fine.positions_mm is mesh.positions_mm


def test_poor_normals_do_not_fold_it():
    """A cube with averaged normals bulges, but by a tenth of its edges at most a level, and stays closed."""
    fine = smooth_surface(cube(smooth=True))
    assert edges_with_other_than_two_faces(fine.faces) == 0
    assert np.abs(fine.positions_mm).max() < 50 + 0.2 * 100 * np.sqrt(2)
    assert np.isfinite(fine.corner_normal).all()


def test_a_place_in_a_face_is_found_in_its_children():
    """On a flat triangle, descending keeps the point, at random places and at the borders of the children."""
    mesh = sphere(60.0, "latlong", 8)
    flat = SkinMesh(mesh.positions_mm, mesh.faces, mesh.corner_uv, np.repeat(mesh.face_normal[:, None], 3, axis=1))
    # Hard normals leave every edge straight, so children tile their parent; force the levels through the private step
    from skinbake.irradiance.smooth_surface import SmoothSurface, _edges, _subdivide

    surface = SmoothSurface(0, flat.positions_mm, flat.faces, flat.corner_normal, np.zeros((len(flat.faces), 3)))
    for _ in range(3):
        surface = _subdivide(surface, *_edges(surface))
    rng = np.random.default_rng(0)
    places = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 0.0), (0.5, 0.5), (0.25, 0.25)]
    places += [tuple(p) for p in rng.dirichlet((1, 1, 1), 200)[:, 1:]]
    for b1, b2 in places:
        face = int(rng.integers(len(flat.faces)))
        child, c1, c2 = descend(face, b1, b2, 3)
        assert child // 64 == face
        assert min(c1, c2, 1 - c1 - c2) >= -1e-12
        p = flat.corner_position_mm[face]
        q = surface.positions_mm[surface.faces[child]]
        expected = (1 - b1 - b2) * p[0] + b1 * p[1] + b2 * p[2]
        np.testing.assert_allclose((1 - c1 - c2) * q[0] + c1 * q[1] + c2 * q[2], expected, atol=1e-9)


def test_relief_is_what_the_normals_disagree_by():
    """None where every edge is an arc of a circle or straight; a quarter of what both ends of a chord lean."""
    assert smooth_surface(sphere(60.0, "latlong", 24)).relief_mm.max() < 1e-6
    flat = quad(100.0, 80.0)
    assert smooth_surface(flat).relief_mm.max() == 0
    leaning = flat.corner_normal + np.array([0.04, 0, 0])  # chords along x: 100 mm; both ends lean the same way
    leaning /= np.linalg.norm(leaning, axis=-1, keepdims=True)
    relief = smooth_surface(SkinMesh(flat.positions_mm, flat.faces, flat.corner_uv, leaning)).relief_mm
    np.testing.assert_allclose(relief, 100 * 2 * leaning[0, 0, 0] / 4, rtol=1e-12)
