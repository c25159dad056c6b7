"""Atlases of fewer texels."""

import numpy as np

from skinbake.atlas import coarser_atlas, coarser_size, rasterize
from tests.shapes import quad


def test_texels_are_about_as_wide_as_asked_and_never_finer():
    """A square of 64 mm over 256 by 128 texels: half a millimetre along the longer side, in whole multiples of it."""
    mesh = quad(64.0, 64.0, uv_box=(0.0, 0.0, 1.0, 1.0))
    for texel_mm, size in ((0.01, (256, 128)), (0.5, (256, 128)), (1.6, (86, 43)), (1000.0, (2, 1))):
        assert coarser_size(mesh, (256, 128), texel_mm) == size


def test_its_gutter_is_as_wide_on_the_skin():
    """A gutter of 16 texels at a quarter of the size is 4; at least 2 of them."""
    mesh = quad(64.0, 64.0, uv_box=(0.3, 0.3, 0.7, 0.7))
    for gutter, small in ((16, 4), (0, 2)):
        (found,), (wanted,) = coarser_atlas(mesh, (256, 256), gutter, False, (64, 64)), rasterize(mesh, (64, 64), small)
        np.testing.assert_array_equal(found.face_index, wanted.face_index)
