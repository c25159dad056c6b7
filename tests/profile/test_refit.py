"""Another skin on Gaussians that are there."""

from dataclasses import replace

import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.io.config import load_named_skin
from skinbake.io.presets import skin_names
from skinbake.profile import fit_skin
from skinbake.profile.fit import more_gaussians
from skinbake.profile.refit import refit
from skinbake.profile.varying_skin import Range
from skinbake.scene.skin import FitSpec

SKIN = load_named_skin("jensen-skin1")


def test_a_skin_on_its_own_gaussians_is_itself():
    """Weights and error, of one skin, of a range of it, and where part does not scatter."""
    one = fit_skin(SKIN).gaussians
    np.testing.assert_allclose(refit(SKIN, one.variance_mm2).weight_rgb, one.weight_rgb, atol=1e-9)
    np.testing.assert_allclose(refit(SKIN, one.variance_mm2).relative_error_rgb, one.relative_error_rgb, rtol=1e-6)
    over = {"radius": Range(0.8, 1.3, 1.0), "scatter": Range(0.0, 1.0, 0.7)}
    varied = fit_skin(SKIN, over=over).gaussians
    again = refit(SKIN, varied.variance_mm2, varied.table)
    np.testing.assert_allclose(again.table.weight_rgb, varied.table.weight_rgb, atol=1e-9)
    assert again.table.quantities == ("radius", "scatter")
    assert again.variance_mm2.tobytes() == varied.variance_mm2.tobytes()


@pytest.mark.parametrize("name", skin_names())
def test_every_skin_that_comes_along_goes_on_another_s(name):
    """White stays white, no weight is negative, and the error is that of the best weights: never above that of one."""
    variance = fit_skin(SKIN).gaussians.variance_mm2
    skin = load_named_skin(name)
    found = refit(skin, variance)
    assert found.weight_rgb.min() >= 0
    np.testing.assert_allclose(found.weight_rgb.sum(axis=0), 1)
    alone = [refit(skin, variance[i : i + 1]).relative_error_rgb for i in range(len(variance))]
    assert (found.relative_error_rgb <= np.min(alone, axis=0) + 1e-9).all()


def test_how_far_is_too_far_is_the_same_for_all():
    """By an eye or the look's own tolerance; a table by its worst skin; more are advised while there can be more."""
    fit = FitSpec()
    one, six = (fit_skin(SKIN.model_copy(update={"fit": FitSpec(gaussians=n)})).gaussians for n in (1, 6))
    assert one.too_far_off()
    assert not six.too_far_off()
    assert six.too_far_off(1e-6)
    assert more_gaussians(one, fit) == 3
    assert more_gaussians(six, fit) is None
    assert more_gaussians(six, FitSpec(tolerance=1e-6)) == 8
    table = fit_skin(SKIN.model_copy(update={"fit": FitSpec(gaussians=1)}), over={"radius": Range(0.5, 2, 1)}).gaussians
    assert table.relative_error_rgb.max() == table.table.worst[1]
    twelve = replace(six, variance_mm2=np.arange(1.0, 13), weight_rgb=np.full((12, 3), 1 / 12))
    assert more_gaussians(twelve, FitSpec(tolerance=1e-6)) is None


def test_what_does_not_go_is_said():
    variance = fit_skin(SKIN).gaussians.variance_mm2
    with pytest.raises(InputError, match=r"expected 1 on Gaussians without one of no width, got 0\.5"):
        refit(SKIN.model_copy(update={"scatter": 0.5}), variance)
    physiology = load_named_skin("physiology-light")
    table = fit_skin(physiology, over={"melanin": Range(0.01, 0.1, 0.05)}).gaussians
    with pytest.raises(InputError, match=r"expected one that knows melanin, .* got model dipole"):
        refit(SKIN, table.variance_mm2, table.table)
    with pytest.raises(InputError, match=r"skin: expected a file, or one of donner-three-layer, .*, got nobody"):
        load_named_skin("nobody")
