import numpy as np
import pytest

from skinbake.profile.albedo_inversion import albedo_inversion


@pytest.mark.parametrize("fit", ["chiang", "wrenninge"])
def test_brighter_needs_more_scattering(fit):
    """Both fits rise from 0 and end just below 1."""
    albedo = albedo_inversion(np.linspace(0, 1, 200), fit)
    assert albedo[0] == 0
    assert (np.diff(albedo) >= 0).all()
    assert 0.998 < albedo[-1] < 1


@pytest.mark.parametrize("bad", [-0.1, 1.1, float("nan")])
def test_impossible_reflectance_is_refused(bad):
    """No surface reflects more than it gets."""
    with pytest.raises(ValueError, match="reflectance"):
        albedo_inversion(bad)


def test_vector(agrees):
    """Published values of section 8."""
    agrees("albedo_inversion", [albedo_inversion(0.8), albedo_inversion(0.8, "wrenninge")])
