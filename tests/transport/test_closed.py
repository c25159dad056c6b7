"""Meshes that have no inside are refused."""

import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.scene.mesh import SkinMesh
from skinbake.transport.closed import refuse_open
from tests.shapes import joined, quad, sphere
from tests.transport.solids import box


def test_closed_meshes_pass():
    """A ball whose seam is welded, a box, two of them."""
    refuse_open(sphere(20.0, "cube", 24))
    refuse_open(joined(box([0, 0, 0], [1, 2, 3]), box([5, 0, 0], [6, 2, 3])))


def test_open_ones_are_refused_with_the_place():
    """Each edge counts, and the first one's place is told."""
    with pytest.raises(InputError, match=r"me.obj: expected a closed mesh.* 4 edges .*\(-50, -50, 0\) mm"):
        refuse_open(quad(), "me.obj")
    whole = box([0, 0, 0], [1, 2, 3])
    with pytest.raises(InputError, match="3 edges"):
        refuse_open(SkinMesh(whole.positions_mm, whole.faces[1:], whole.corner_uv[1:], whole.corner_normal[1:]))


def test_a_mesh_that_is_inside_out_is_refused():
    """Its normals would send walks away from the skin."""
    whole = box([0, 0, 0], [1, 2, 3])
    with pytest.raises(InputError, match="inside out"):
        refuse_open(
            SkinMesh(
                whole.positions_mm, np.ascontiguousarray(whole.faces[:, ::-1]), whole.corner_uv, whole.corner_normal
            )
        )
