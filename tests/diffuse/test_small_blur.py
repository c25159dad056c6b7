"""Light at few texels is blurred as the rest is: by the same lobes, each by its method, times the same factors."""

from dataclasses import replace

import numpy as np
import pytest

from skinbake.atlas import rasterize
from skinbake.bilinear import magnify_bilinear
from skinbake.diffuse.diffuse import diffuse
from skinbake.diffuse.diffuse_map import Lobe
from skinbake.diffuse.small_blur import TOLERANCE, SmallBlur
from skinbake.diffuse.terms.curvature import STEPS
from skinbake.diffuse.terms.diffuse_profile import EverywhereLight
from skinbake.profile import GaussianSum
from skinbake.scene.maps import SkinMaps
from skinbake.scene.spec import DiffusionSpec
from tests.shapes import relief

SIZE = (96, 80)
VARIANCE = np.array([0.0, 4.0, 60.0])  # mm^2, of texels of a millimetre
WEIGHT = np.full((3, 3), 1 / 3)
GAUSSIANS = GaussianSum(VARIANCE, WEIGHT, np.zeros(3), WEIGHT.sum(axis=0))
SPEC = DiffusionSpec(tolerance=0.005, probes=0)
METHOD = ("identity", "hybrid", "reference")
FACTOR = np.array([1.0, 1.25, 0.5])


@pytest.fixture(scope="module")
def skin():
    mesh = relief(80.0, 20.0, 12.0, 24)
    return mesh, rasterize(mesh, SIZE, 4)


def small_blur(skin, everywhere=None):
    mesh, atlas = skin
    like = [Lobe(v, (1 / 3,) * 3, name, {}) for v, name in zip(VARIANCE, METHOD, strict=True)]
    return SmallBlur(atlas, mesh, GAUSSIANS, SkinMaps(), SPEC, like, everywhere)


def read(lobe, shape):
    """A lobe at the size of its light, of a light."""
    return magnify_bilinear(np.asarray(lobe.rgb[1001][0], np.float32), shape)


def test_lobes_are_those_of_the_light_itself(skin):
    """A lit square is blurred as by sums over the surface, within the tolerance; what was not blurred is not here."""
    mesh, (raster,) = skin
    light = np.zeros((1, *raster.shape, 3), np.float32)
    light[:, 30:50, 20:60] = [1.0, 0.5, 0.25]
    want = diffuse(
        {1001: light}, ("spot",), (raster,), mesh, GAUSSIANS, SPEC.model_copy(update={"method": "surface"}), 0, "float"
    ).lobes
    made = small_blur(skin).lobes({1001: light})
    np.testing.assert_array_equal(made[0].rgb[1001], light)
    assert [lobe.method for lobe in made] == ["identity", "hybrid", "surface"]
    where = raster.covered
    for lobe, exact in zip(made[1:], want[1:], strict=True):
        got, asked = read(lobe, raster.shape)[where], read(exact, raster.shape)[where]
        assert np.sqrt(((got - asked) ** 2).mean() / (asked**2).mean()) < TOLERANCE


def test_even_light_is_taken_by_the_factors_and_stays_even(skin):
    """Of light from everywhere each lobe has its factor; of a light without the term it has it once."""
    _, (raster,) = skin
    factor = np.repeat(np.repeat(FACTOR[:, None, None], STEPS + 1, axis=1), 3, axis=2)
    everywhere = EverywhereLight({}, VARIANCE, factor, {1001: np.ones((1, 1, 3), np.float32)})
    blur, where = small_blur(skin, everywhere), raster.covered
    for lobe, times in zip(blur.of_even_light(), FACTOR, strict=True):
        np.testing.assert_allclose(read(lobe, raster.shape)[where], times, rtol=1e-4)
    one = np.ones((2, *raster.shape, 3), np.float32)
    for lobe, times in zip(blur.lobes({1001: one}, [False, True]), FACTOR, strict=True):
        with_term = replace(lobe, rgb={1001: lobe.rgb[1001][1:]})
        np.testing.assert_allclose(read(lobe, raster.shape)[where], 1, rtol=1e-4)
        np.testing.assert_allclose(read(with_term, raster.shape)[where], times, rtol=1e-4)
