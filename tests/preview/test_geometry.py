"""Vertex buffers are the mesh itself, split only where it is split, each tile with its own UVs."""

import numpy as np

from skinbake.preview.geometry import vertex_buffers
from tests.shapes import quad, sphere


def test_buffers_give_back_every_corner_of_the_mesh():
    mesh = sphere(90.0, "latlong", 20)
    buffers = vertex_buffers(mesh, (1001,))[1001]
    np.testing.assert_allclose(buffers.position_mm[buffers.faces], mesh.corner_position_mm, rtol=1e-6, atol=1e-5)
    np.testing.assert_allclose(buffers.uv[buffers.faces], mesh.corner_uv, atol=1e-7)
    np.testing.assert_allclose(buffers.normal[buffers.faces], mesh.corner_normal, atol=1e-6)
    seam = len(buffers.position_mm) - len(mesh.positions_mm)
    assert 0 < seam < 100  # the seam and the poles alone are split


def test_tangents_follow_u_and_carry_the_mirrored_side():
    plain = vertex_buffers(quad(50, 30, columns=3, rows=2), (1001,))[1001]
    np.testing.assert_allclose(plain.tangent, np.broadcast_to([1, 0, 0, 1], plain.tangent.shape), atol=1e-6)
    mirrored = vertex_buffers(quad(50, 30, columns=3, rows=2, uv_box=(1, 0, 0, 1)), (1001,))[1001]
    np.testing.assert_allclose(mirrored.tangent, np.broadcast_to([-1, 0, 0, -1], mirrored.tangent.shape), atol=1e-6)


def test_tiles_hold_their_own_faces_with_uvs_from_zero_to_one():
    mesh = sphere(90.0, "latlong", 20, tiles=2)
    buffers = vertex_buffers(mesh, (1001, 1002))
    assert sum(len(b.faces) for b in buffers.values()) == len(mesh.faces)
    for b in buffers.values():
        assert b.uv.min() >= -1e-9
        assert b.uv.max() <= 1 + 1e-9
