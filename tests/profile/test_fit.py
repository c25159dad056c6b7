from pathlib import Path

import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.io.config import load_skin
from skinbake.profile import GaussianSum, fit_report, fit_skin, profile_of
from skinbake.profile.fit_report import error_against
from skinbake.profile.models import GaussianProfile, LayeredProfile
from skinbake.profile.variable_projection import Fitter
from skinbake.scene.skin import BurleySkin, DipoleSkin, FitSpec, GaussiansSkin, MultipoleSkin, TableSkin, TransportSkin

PRESETS = sorted((Path(__file__).parents[2] / "configs" / "skins").glob("*.yaml"))
SKIN1 = {"sigma_a_per_mm": (0.032, 0.17, 0.48), "sigma_sp_per_mm": (0.74, 0.88, 1.01)}


def dipole(**keys):
    return DipoleSkin(model="dipole", **(SKIN1 | keys))


def test_white_gives_each_channel_the_same_light():
    """Normalised to white every channel sums to 1; as it is, to the model's total reflectance."""
    white, plain = fit_skin(dipole()).gaussians, fit_skin(dipole(normalise="none")).gaussians
    np.testing.assert_allclose(white.weight_rgb.sum(axis=0), 1, rtol=1e-13)
    np.testing.assert_allclose(plain.weight_rgb.sum(axis=0), profile_of(dipole()).total_reflectance, rtol=1e-13)
    np.testing.assert_allclose(white.weight_rgb * plain.energy_rgb, plain.weight_rgb, rtol=1e-9)
    assert white.normalise == "white"


def test_free_energy_loses_the_tail():
    """Without the constraint the error is smaller, red loses a tenth of its light, and the report says so."""
    free, exact = (fit_skin(dipole(fit={"gaussians": 3, "energy": e}, normalise="none")) for e in ("free", "exact"))
    assert (free.relative_error_rgb < exact.relative_error_rgb).all()
    assert free.energy_ratio_rgb[0] < 0.9
    np.testing.assert_allclose(exact.energy_ratio_rgb, 1, rtol=1e-12)


def test_tolerance_takes_the_fewest():
    """The smallest number that meets a tolerance is found: one fewer does not meet it."""
    report = fit_skin(dipole(fit={"tolerance": 0.01}))
    count = len(report.gaussians.variance_mm2)
    assert report.tolerance_met
    assert report.relative_error_rgb.max() <= 0.01
    assert fit_skin(dipole(fit={"gaussians": count - 1})).relative_error_rgb.max() > 0.01


@pytest.mark.slow
def test_tolerance_out_of_reach_is_said():
    """When twelve do not suffice the best is given, and marked."""
    report = fit_skin(dipole(fit={"tolerance": 1e-9}))
    assert not report.tolerance_met
    assert report.relative_error_rgb.max() < 1e-3


def test_given_gaussians_pass_unchanged():
    """Without a fit key variances and weights are those of the file; unsorted ones are sorted, equal ones merged."""
    weights = ((0.5, 0.25, 0.25), (0.3, 0.7, 0.7), (0.2, 0.05, 0.05))
    report = fit_skin(GaussiansSkin(model="gaussians", variance_mm2=(4.0, 1.0, 4.0), weight_rgb=weights))
    assert report.gaussians.variance_mm2.tolist() == [1.0, 4.0]
    np.testing.assert_allclose(report.gaussians.weight_rgb, [[0.3, 0.7, 0.7], [0.7, 0.3, 0.3]], rtol=1e-15)
    assert report.relative_error_rgb.tolist() == [0, 0, 0]


def test_given_gaussians_are_fitted_where_asked():
    """A fit key asks for fewer; a delta cannot be fitted and is refused."""
    given = {"model": "gaussians", "variance_mm2": (0.1, 1.0, 4.0), "weight_rgb": ((0.3, 0.3, 0.3),) * 3}
    assert len(fit_skin(GaussiansSkin(**given, fit={"gaussians": 2})).gaussians.variance_mm2) == 2
    with pytest.raises(InputError, match="delta"):
        fit_skin(GaussiansSkin(**(given | {"variance_mm2": (0.0, 1.0, 4.0)}), fit={"gaussians": 2}))


def test_dark_channels():
    """White cannot be made of no light: refused by channel; with none the dark channel has zero weights."""
    dark = {"sigma_a_per_mm": (0.1, 1.0, 0.1), "sigma_sp_per_mm": (1.0, 0.0, 1.0)}
    with pytest.raises(InputError, match="green reflects 0"):
        fit_skin(DipoleSkin(model="dipole", **dark))
    report = fit_skin(DipoleSkin(model="dipole", **dark, normalise="none"))
    assert (report.gaussians.weight_rgb[:, 1] == 0).all()
    assert report.relative_error_rgb[1] == 0
    with pytest.raises(InputError, match="no light"):
        fit_skin(DipoleSkin(model="dipole", sigma_a_per_mm=(1, 1, 1), sigma_sp_per_mm=(0, 0, 0), normalise="none"))


def test_every_model_has_a_fit():
    """Burley, transport, multipole, the better dipole and a table all end as six or fewer Gaussians of small error."""
    radius = np.geomspace(0.01, 20, 200)
    table = radius, profile_of(dipole()).reflectance(radius)
    layers = [{**SKIN1, "thickness_mm": 1.0}, {**SKIN1}]
    for skin, limit in (
        (BurleySkin(model="burley", d_mm=(0.5, 0.3, 0.2)), 0.06),
        (MultipoleSkin(model="multipole", layers=layers), 0.01),
        (dipole(variant="better"), 0.01),
        (TableSkin(model="table", path="unused.csv"), 0.01),
        (TransportSkin(model="transport", layers=layers, photons=20_000), 0.25),
    ):
        report = fit_skin(skin, table)
        assert report.relative_error_rgb.max() < limit, skin.model
        assert report.gaussians.model == skin.model
    with pytest.raises(InputError, match="table"):
        fit_skin(TableSkin(model="table", path="unused.csv"))


def test_report_describes_the_fit():
    """Condition number, largest residual and its place are those of the curves that are plotted."""
    report = fit_skin(dipole())
    assert 10 < report.condition_number < 2000
    curve = report.curve
    off = np.abs(curve.radius_mm[:, None] * (curve.model_rgb - curve.fit_rgb))
    peak = (curve.radius_mm[:, None] * curve.model_rgb).max(axis=0)
    np.testing.assert_allclose(report.largest_residual_rgb, off.max(axis=0) / peak)
    assert (report.largest_residual_rgb < 0.01).all()
    assert report.largest_residual_radius_mm.shape == (3,)


def test_error_against_another_profile():
    """Gaussians against themselves err by nothing; at half their light the best scale is 1/2 and the error as is 1."""
    gaussians = fit_report(profile_of(dipole()), FitSpec(gaussians=4)).gaussians
    half = GaussianSum(gaussians.variance_mm2, gaussians.weight_rgb / 2, np.zeros(3), np.ones(3))
    error, scale, scaled = error_against(gaussians, GaussianProfile(half).fit_nodes())
    np.testing.assert_allclose(error, 1, rtol=1e-9)
    np.testing.assert_allclose(scale, 0.5, rtol=1e-9)
    np.testing.assert_allclose(scaled, 0, atol=1e-7)


def test_published_table_is_near_three_layers(three_layer_skin):
    """The printed variances with free weights describe the three-layer skin to the 9.2 7.4 5.8 % found elsewhere."""
    printed = np.array([0.0064, 0.0484, 0.187, 0.567, 1.99, 7.41])
    continued = LayeredProfile(three_layer_skin.layers, thin_layers="continued")
    error = Fitter(continued.fit_nodes(), exact_energy=False).project(printed).error
    np.testing.assert_allclose(100 * error, [9.2, 7.4, 5.8], atol=0.05)


@pytest.mark.parametrize("path", PRESETS, ids=lambda p: p.stem)
def test_every_preset_fits(path):
    """Each named skin is fitted to 3 % in its worst channel."""
    assert fit_skin(load_skin(path)).relative_error_rgb.max() < 0.03


def test_same_input_same_bits():
    """Two fits of one skin are equal to the last bit."""
    one, two = (fit_skin(dipole()).gaussians for _ in range(2))
    assert one.weight_rgb.tobytes() == two.weight_rgb.tobytes()
    assert one.variance_mm2.tobytes() == two.variance_mm2.tobytes()


def test_not_finite_profile_is_refused():
    """NaN in a profile ends as a message."""
    bad = GaussianSum(np.ones(1), np.ones((1, 3)), np.zeros(3), np.ones(3))
    object.__setattr__(bad, "weight_rgb", np.full((1, 3), np.nan))
    with pytest.raises(InputError, match="finite"):
        fit_report(GaussianProfile(bad), FitSpec(gaussians=1))
