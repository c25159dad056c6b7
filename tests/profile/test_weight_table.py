"""Tables of weights: what they hold at their nodes, between them and beyond."""

import numpy as np
import pytest

from skinbake.io.profile import fit_csv, fit_record
from skinbake.io.weight_table import table_of_record
from skinbake.profile import fit_skin, profile_of
from skinbake.profile.scaled import scaled_nodes
from skinbake.profile.variable_projection import Fitter
from skinbake.profile.varying_skin import Range
from skinbake.scene.skin import DipoleSkin, GaussiansSkin, PhysiologySkin, TableSkin

SKIN = {"model": "dipole", "sigma_a_per_mm": (0.03, 0.17, 0.48), "sigma_sp_per_mm": (0.74, 0.88, 1.01)}
OVER = {"radius": Range(0.5, 1.5, 0.9)}


@pytest.fixture(scope="module")
def report():
    return fit_skin(DipoleSkin(**SKIN), over=OVER)


def test_each_node_keeps_its_energy_and_no_weight_is_negative(report):
    """White sums to 1, else to what the model gives back."""
    plain = fit_skin(DipoleSkin(**SKIN, normalise="none"), over=OVER)
    for found, want in ((report, np.ones(3)), (plain, plain.energy_rgb)):
        weight = found.gaussians.table.weight_rgb
        assert weight.min() >= 0
        np.testing.assert_allclose(weight.sum(axis=2), np.broadcast_to(want, (*weight.shape[:2], 3)), rtol=1e-12)


def test_a_narrow_skin_does_not_cut_the_tails_of_wide_ones():
    """Variances may be as wide as the widest skin asks for: eight of them serve hair of much melanin and light skin."""
    skin = PhysiologySkin(model="physiology", melanin=0.02, haemoglobin=0.005, fit={"gaussians": 8})
    over = {"melanin": Range(0.0066, 0.25, 0.02), "haemoglobin": Range(0.0026, 0.06, 0.006)}
    gaussians = fit_skin(skin, over=over).gaussians
    assert gaussians.table.worst[1] < 0.03  # 0.053 while the narrowest bounded them all
    light = profile_of(skin.model_copy(update={"melanin": 0.0066, "haemoglobin": 0.0026}))
    alone = Fitter(light.fit_nodes()).fit(6).variance_mm2[-1]
    assert gaussians.variance_mm2[-1] > 0.5 * alone  # 0.26 of it


def test_a_node_is_as_near_to_its_profile_as_it_says(report):
    """Its error is that of the Gaussians against the widened model, by quadrature over r."""
    table, variance = report.gaussians.table, report.gaussians.variance_mm2
    r = np.geomspace(1e-4, 300, 6000)
    for k in (0, 20, -1):
        radius = table.nodes[0][k]
        want = profile_of(DipoleSkin(**SKIN, radius=radius)).reflectance(r)
        got = np.exp(-(r[:, None] ** 2) / (2 * variance)) / (2 * np.pi * variance) @ table.weight_rgb[k, 0]
        got = got * report.energy_rgb
        error = np.sqrt(np.trapezoid((got - want) ** 2 * r[:, None], r, axis=0))
        norm = np.sqrt(np.trapezoid(want**2 * r[:, None], r, axis=0))
        np.testing.assert_allclose(error / norm, table.error_rgb[k, 0], rtol=0.02)
    assert table.between_rgb.max() < 1.2 * table.error_rgb.max()
    assert table.worst[1] == table.error_rgb.max()
    np.testing.assert_allclose(report.relative_error_rgb, table.error_rgb.max(axis=(0, 1)))


def test_a_tolerance_is_met_at_every_node():
    """With more Gaussians than a single profile needs."""
    wanted = {"fit": {"tolerance": 0.02}}
    varied, single = fit_skin(DipoleSkin(**SKIN, **wanted), over=OVER), fit_skin(DipoleSkin(**SKIN, **wanted))
    assert varied.tolerance_met
    assert varied.gaussians.table.error_rgb.max() <= 0.02
    assert len(varied.gaussians.variance_mm2) > len(single.gaussians.variance_mm2)


def test_the_table_reads_linearly_in_the_root(report):
    """At a node its row, halfway between the roots the mean of two rows, beyond the ends the last row."""
    table = report.gaussians.table
    nodes = table.nodes[0]
    rows = table.weight_rgb[:, 0]
    half = (0.5 * (np.sqrt(nodes[3]) + np.sqrt(nodes[4]))) ** 2
    got = table.at({"radius": np.array([nodes[7], half, 0.01, 99.0])}).swapaxes(0, 1)
    np.testing.assert_allclose(got, [rows[7], 0.5 * (rows[3] + rows[4]), rows[0], rows[-1]], atol=1e-12)


def test_one_value_is_the_fit_of_that_skin():
    """A map of one value is the key, bit for bit."""
    one = fit_skin(DipoleSkin(**SKIN), over={"radius": Range(0.8, 0.8, 0.8)}).gaussians
    key = fit_skin(DipoleSkin(**SKIN, radius=0.8)).gaussians
    assert one.table is None
    assert one.variance_mm2.tobytes() == key.variance_mm2.tobytes()
    assert one.weight_rgb.tobytes() == key.weight_rgb.tobytes()


def test_widths_scale_and_light_stays():
    """Of a model, of given Gaussians and of a measured table."""
    r = np.linspace(0.01, 9, 300)
    csv = r, np.exp(-r[:, None] * [1.0, 2.0, 3.0])
    given = GaussiansSkin(model="gaussians", variance_mm2=(0.1, 2.0), weight_rgb=((0.4, 0.5, 0.6), (0.6, 0.5, 0.4)))
    for skin, table in ((DipoleSkin(**SKIN), None), (given, None), (TableSkin(model="table", path="-"), csv)):
        one = fit_skin(skin, table).gaussians
        wide = fit_skin(skin.model_copy(update={"radius": 2.0}), table).gaussians
        np.testing.assert_allclose(wide.variance_mm2, 4 * one.variance_mm2, rtol=1e-3)
        np.testing.assert_allclose(wide.energy_rgb, one.energy_rgb)
        profile = profile_of(skin.model_copy(update={"radius": 2.0}), table)
        np.testing.assert_allclose(profile.reflectance([3.0]), profile_of(skin, table).reflectance([1.5]) / 4)
        nodes = scaled_nodes(profile_of(skin, table).fit_nodes(), 2.0)
        error = Fitter(nodes).project(wide.variance_mm2).error
        np.testing.assert_allclose(error, fit_skin(skin, table).relative_error_rgb, atol=1e-3)


def test_what_does_not_scatter_is_a_gaussian_of_no_width():
    """Its weight is what is left of the total; by a key for all, by a map at each place."""
    key = fit_skin(DipoleSkin(**SKIN, scatter=0.75)).gaussians
    np.testing.assert_allclose(key.weight_rgb[0], 0.25)
    np.testing.assert_allclose(key.weight_rgb.sum(axis=0), 1)
    assert key.variance_mm2[0] == 0
    assert key.table is None
    both = fit_skin(DipoleSkin(**SKIN), over=OVER | {"scatter": Range(0.0, 1.0, 0.5)}).gaussians
    got = both.table.at({"radius": np.array([0.7, 0.7]), "scatter": np.array([0.0, 0.4])})
    np.testing.assert_allclose(got[:, 0], [[1, 1, 1], *[[0, 0, 0]] * 6], atol=1e-12)
    np.testing.assert_allclose(got[0, 1], 0.6)
    assert both.table.scatter_at({})[0] == 1


def test_a_table_comes_back_from_its_record(report):
    """To the last bit; a damaged one is refused; its rows stand in the CSV as lines that readers pass over."""
    record, table = fit_record(report)["weights_table"], report.gaussians.table
    back = table_of_record(record, len(report.gaussians.variance_mm2))
    assert back.weight_rgb.tobytes() == table.weight_rgb.tobytes()
    assert back.at({"radius": 0.6}).tobytes() == table.at({"radius": 0.6}).tobytes()
    assert record["worst"]["relative_error"] == table.error_rgb.max()
    for damage in (
        {"weight_rgb": [[1.0]]},
        {"nodes": [[1, 0], [0]]},
        {"constants": {}},
        {"names": ["radius"] * 3},
        {"names": ["width"]},
    ):
        with pytest.raises((ValueError, LookupError, TypeError)):
            table_of_record(record | damage, len(report.gaussians.variance_mm2))
    lines = [line for line in fit_csv(report).splitlines() if line.startswith("#")]
    assert len(lines) == 2 + len(table.nodes[0])
