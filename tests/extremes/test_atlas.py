"""The raster is the same skin from any side: turned, moved, in another unit, and with its texture turned."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skinbake.atlas import interpolate, rasterize
from tests.extremes.moves import moved, relative, rotation, uv_turned
from tests.shapes import sphere


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 99), shift=st.sampled_from([0.0, 1e2, 1e5]), scale=st.sampled_from([1e-3, 1.0, 25.4, 1e3]))
def test_motion_and_unit(seed, shift, scale):
    """Addresses are those of the UVs alone; areas scale with the square of the unit, to float32."""
    mesh = sphere(40.0, "cube", 32)
    here = rasterize(mesh, (61, 44))[0]
    there = rasterize(moved(mesh, rotation(seed), np.full(3, shift), scale), (61, 44))[0]
    np.testing.assert_array_equal(there.face_index, here.face_index)
    np.testing.assert_array_equal(there.barycentric, here.barycentric)
    assert relative(there.area_mm2 / scale**2, here.area_mm2) < 3e-6
    assert there.area_mm2.sum(dtype=np.float64) == pytest.approx(mesh.face_area_mm2.sum() * scale**2, rel=1e-6)


@pytest.mark.parametrize("layout", ["latlong", "cube"])
def test_a_quarter_turn_of_the_texture(layout):
    """Coverage, area and the skin shown turn as an image does."""
    mesh = sphere(40.0, layout, 32)
    here, there = rasterize(mesh, (61, 44), gutter=2)[0], rasterize(uv_turned(mesh), (44, 61), gutter=2)[0]
    np.testing.assert_allclose(there.coverage, np.rot90(here.coverage), atol=2e-6)
    np.testing.assert_allclose(there.area_mm2, np.rot90(here.area_mm2), rtol=1e-4, atol=1e-5)
    shown = [interpolate(raster, m.corner_position_mm) for raster, m in ((here, mesh), (there, uv_turned(mesh)))]
    inside = np.rot90(here.coverage) > 0.999
    assert np.abs(shown[1] - np.rot90(shown[0]))[inside].max() < 1e-3
