import numpy as np
import pytest

from skinbake.profile.fresnel import boundary_factor
from skinbake.profile.medium import Medium


def test_absorbed_share_keeps_its_digits():
    """1 - alpha' comes from the coefficients, not from a subtraction that would lose it."""
    weak = Medium(np.array([1e-18]), np.array([1.0]))
    assert weak.absorbed[0] == 1e-18
    assert weak.albedo[0] == 1.0


@pytest.mark.parametrize(
    ("sigma_a", "sigma_sp", "message"),
    [(0.0, 0.0, "both are 0"), (-1.0, 1.0, "sigma_a_per_mm: expected"), (1.0, np.nan, "sigma_sp_per_mm: expected")],
)
def test_impossible_media_are_refused(sigma_a, sigma_sp, message):
    """Nothing to scatter, negative and NaN coefficients are named."""
    with pytest.raises(ValueError, match=message):
        Medium(np.array([sigma_a]), np.array([sigma_sp]))


def test_channels_must_match():
    """Two channels of one coefficient and three of the other are refused."""
    with pytest.raises(ValueError, match="same number of channels"):
        Medium(np.ones(2), np.ones(3))


def test_vector(agrees):
    """Published lengths of skin1, red."""
    m = Medium(np.array([0.032]), np.array([0.74]))
    lengths = [m.sigma_tp_per_mm, m.albedo, m.diffusion_mm, m.sigma_tr_per_mm, m.free_path_mm]
    agrees("params_skin1R", [x[0] for x in [*lengths, m.extrapolation_mm(boundary_factor(1.3))]])
