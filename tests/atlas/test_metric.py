"""Millimetres per texel."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.atlas import face_mm_per_texel, first_fundamental_form, rasterize, uv_jacobian
from skinbake.scene.mesh import SkinMesh
from tests.shapes import quad, sphere


def test_each_axis_has_its_own_length():
    """A 200 x 50 mm quad at 100 x 100 texels measures 2 and 0.5 mm along its axes."""
    mesh = quad(200.0, 50.0)
    np.testing.assert_allclose(face_mm_per_texel(mesh, (100, 100)), np.broadcast_to([2.0, 0.5], (len(mesh.faces), 2)))


def test_the_form_measures_uv_steps():
    """The length of any UV step by the form is its length in space, on a sheared triangle."""
    mesh = SkinMesh(
        np.array([[0.0, 0, 0], [3, 1, 2], [-1, 4, 0.5]]),
        np.array([[0, 1, 2]], np.int32),
        np.array([[[0.1, 0.2], [0.5, 0.3], [0.2, 0.9]]]),
        np.zeros((1, 3, 3)),
    )
    e, f, h = first_fundamental_form(mesh)[0]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        du, dv = mesh.corner_uv[0, j] - mesh.corner_uv[0, i]
        step = mesh.positions_mm[j] - mesh.positions_mm[i]
        assert e * du * du + 2 * f * du * dv + h * dv * dv == pytest.approx(step @ step)
        np.testing.assert_allclose(np.array([du, dv]) @ uv_jacobian(mesh)[0], step, atol=1e-12)


def test_area_element_is_the_texel_area():
    """sqrt(eh - f^2) per texel is the area weight where the texel lies inside one face."""
    mesh = sphere(40.0, "cube", segments=16)
    (raster,) = rasterize(mesh, (96, 60))
    e, f, h = first_fundamental_form(mesh).T
    element = (np.sqrt(e * h - f * f) / (96 * 60))[raster.face_index]
    full = raster.coverage == 1
    ratio = raster.area_mm2[full] / element[full]
    assert np.median(np.abs(ratio - 1)) < 1e-3


def test_a_degenerate_face_has_zero_length():
    """No division by a zero UV area."""
    mesh = quad()
    flat = SkinMesh(mesh.positions_mm, mesh.faces, np.zeros_like(mesh.corner_uv), mesh.corner_normal)
    assert (face_mm_per_texel(flat, (8, 8)) == 0).all()
