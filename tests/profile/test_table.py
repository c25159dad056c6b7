import numpy as np
import pytest

from skinbake.profile import GaussianSum, fit_report
from skinbake.profile.table import TableProfile
from skinbake.scene.skin import FitSpec

SUM = GaussianSum(
    np.array([0.05, 0.8, 6.0]), np.array([[0.3, 0.2, 0.1], [0.2, 0.3, 0.1], [0.3, 0.1, 0.05]]), np.zeros(3), np.ones(3)
)


def table(count=300):
    r = np.append(0.0, np.geomspace(0.005, 16, count))
    return TableProfile(r, SUM.evaluate(r))


def test_interpolates_its_source():
    """Between the rows the table is within 1e-4 of the profile it was sampled from, and its total within 1e-3."""
    r = np.geomspace(0.01, 8, 77)
    np.testing.assert_allclose(table().reflectance(r), SUM.evaluate(r), rtol=1e-4)
    np.testing.assert_allclose(table().total_reflectance, SUM.weight_rgb.sum(axis=0), rtol=1e-3)


def test_sampled_sum_of_gaussians_is_recovered():
    """Gaussians come back from a table of their sum: variances to 1 %, weights to 2e-3."""
    found = fit_report(table(), FitSpec(gaussians=3), "none").gaussians
    np.testing.assert_allclose(found.variance_mm2, SUM.variance_mm2, rtol=0.01)
    np.testing.assert_allclose(found.weight_rgb, SUM.weight_rgb, atol=2e-3)


def test_ends_and_zeros():
    """Constant inside the first radius, 0 past the last, and zeros in the table are kept."""
    values = np.array([[2.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    profile = TableProfile(np.array([0.5, 1.0, 2.0]), values)
    assert profile.reflectance([0.0, 0.5]).tolist() == [[2.0, 1.0, 0.0]] * 2
    assert profile.reflectance([2.5]).tolist() == [[0.0, 0.0, 0.0]]
    assert (profile.reflectance([0.7, 1.5])[:, 2] == 0).all()
    assert profile.total_reflectance[2] == 0


@pytest.mark.parametrize(
    ("radius", "values"),
    [
        ([1.0, 1.0], np.ones((2, 3))),
        ([1.0], np.ones((1, 3))),
        ([1.0, 2.0], np.ones((2, 2))),
        ([1.0, 2.0], np.full((2, 3), np.nan)),
    ],
)
def test_impossible_tables_are_refused(radius, values):
    """Radii that do not ascend, one row, wrong shapes, NaN."""
    with pytest.raises(ValueError, match=r"r_mm|R, G, B"):
        TableProfile(np.array(radius), values)
