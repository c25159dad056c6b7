"""Light times area is summed over all tiles, lights and texels."""

import numpy as np

from skinbake.atlas import rasterize
from skinbake.diffuse.area_sum import area_sum
from skinbake.diffuse.skin_geometry import SkinGeometry
from tests.shapes import sphere


def test_the_sum_is_that_of_the_texels():
    """Over two tiles and two lights; the gutter's light does not count."""
    mesh = sphere(30.0, "latlong", 40, 2)
    atlas = rasterize(mesh, (150, 117), udim=True)
    rng = np.random.default_rng(0)
    light = {raster.tile: rng.random((2, *raster.shape, 3)).astype(np.float32) for raster in atlas}
    want = sum((light[r.tile].sum(axis=0, dtype=np.float64) * r.area_mm2[..., None]).sum(axis=(0, 1)) for r in atlas)
    np.testing.assert_allclose(area_sum(light, SkinGeometry(atlas, mesh).points), want, rtol=1e-6)
