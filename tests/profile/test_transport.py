import numpy as np
import pytest

from skinbake.profile.chandrasekhar import half_space_diffuse_reflectance
from skinbake.profile.incidence import reflect_slanted
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.models import DipoleProfile
from skinbake.profile.photons import fresnel
from skinbake.profile.transport import trace_layers
from skinbake.profile.variable_projection import Fitter

Z_LIMIT = 4.0  # standard errors; the seeds are fixed, so a pass stays a pass


def layer(sigma_a, sigma_sp, thickness, eta, g=0.0):
    return Layer(Medium(np.array([float(sigma_a)]), np.array([float(sigma_sp)])), thickness, eta, g)


def z(found, error, expected, expected_error=0.0):
    return abs(found - expected) / np.hypot(error, expected_error)


def test_published_slab():
    """10 and 90 per cm, g .75, 0.2 mm, matched: Rd .09739, T .66096 (van de Hulst), exp(-2) of it straight."""
    out = trace_layers([layer(1.0, 9 * 0.25, 0.2, 1.0, 0.75)], 500_000, seed=1)
    assert z(out.total[0, 0], out.total_error[0, 0], 0.09739) < Z_LIMIT
    assert z(out.total[1, 0], out.total_error[1, 0], 0.66096) < Z_LIMIT
    assert out.unscattered[0] == pytest.approx(np.exp(-2), abs=Z_LIMIT * np.sqrt(np.exp(-2) / 500_000))


def test_published_half_space():
    """n 1.5, mu_a 10, mu_s 90 per cm, g 0: 0.2600 with the 4 % specular reflection (Giovanelli), 0.2200 without."""
    out = trace_layers([layer(1.0, 9.0, np.inf, 1.5)], 300_000, seed=1)
    diffuse, error = 0.96 * out.total[0, 0], 0.96 * out.total_error[0, 0]
    assert z(diffuse + 0.04, error, 0.2600) < Z_LIMIT


def test_same_seed_same_bits_on_any_number_of_threads():
    """One thread and three give equal arrays; another seed gives others."""
    stack = [layer(0.1, 4, 0.2, 1.4), layer(0.2, 1, np.inf, 1.33, 0.8)]
    one, three = (trace_layers(stack, 2000, seed=7, threads=n) for n in (1, 3))
    np.testing.assert_array_equal(one.light, three.light)
    np.testing.assert_array_equal(one.total_error, three.total_error)
    assert trace_layers(stack, 2000, seed=8).total[0, 0] != one.total[0, 0]


def test_without_absorption_every_photon_leaves():
    """R + T = 1 to the last photon through a lossless slab of three indices."""
    stack = [layer(0, 3, 0.5, 1.4), layer(0, 8, 0.2, 1.1, 0.9), layer(0, 1, 1.0, 1.6)]
    out = trace_layers(stack, 3000)
    assert out.lost[0] == 0
    assert out.total[:, 0].sum() == pytest.approx(1, abs=1e-12)


def test_splitting_a_layer_changes_nothing():
    """Unlike diffusion, transport does not see a cut through a homogeneous layer."""
    whole = trace_layers([layer(0.2, 3, 1.0, 1.4)], 60_000, seed=2)
    cut = trace_layers([layer(0.2, 3, 0.3, 1.4), layer(0.2, 3, 0.7, 1.4)], 60_000, seed=3)
    for side in (0, 1):
        assert (
            z(whole.total[side, 0], whole.total_error[side, 0], cut.total[side, 0], cut.total_error[side, 0]) < Z_LIMIT
        )


def test_unscattered_light_follows_beer():
    """A pure absorber lets exp(-mu d) through, straight, less what its faces reflect; nothing comes back scattered."""
    out = trace_layers([layer(0.7, 0, 1.0, 1.0)], 40_000)
    assert out.total[1, 0] == out.unscattered[0] == pytest.approx(np.exp(-0.7), abs=0.01)
    assert out.total[0, 0] == 0


def test_standard_error_is_the_scatter_of_repeats():
    """The stated error of R and of an annulus is the spread over independent seeds, within a third."""
    runs = [trace_layers([layer(0.3, 1, np.inf, 1.3)], 1500, seed=s) for s in range(60)]
    totals = np.array([run.total[0, 0] for run in runs])
    assert totals.std() == pytest.approx(runs[0].total_error[0, 0], rel=0.33)
    k = int(np.argmax(runs[0].light[0, :, 0]))
    assert np.std([run.light[0, k, 0] for run in runs]) == pytest.approx(runs[0].light_stderr[0, k, 0], rel=0.33)


def test_profile_holds_its_light():
    """R(r) between the annuli integrates to the annuli's total; its error shrinks as 1 / sqrt(photons)."""
    out = trace_layers([layer(0.3, 1, np.inf, 1.3)], 40_000)
    r = np.geomspace(1e-3, 80, 4000)
    total = 2 * np.pi * np.trapezoid(out.reflectance(r)[:, 0] * r**2, np.log(r))
    assert total == pytest.approx(out.total[0, 0], rel=0.02)
    fewer = trace_layers([layer(0.3, 1, np.inf, 1.3)], 10_000)
    assert fewer.total_stderr[0] / out.total_stderr[0] == pytest.approx(2, rel=0.1)


def test_diffusion_is_right_far_away():
    """Beyond a few free paths the dipole is within a few per cent of transport; at a tenth of one it is too dark."""
    m = Medium(np.array([0.032]), np.array([0.74]))
    out = trace_layers([Layer(m, np.inf, 1.3)], 150_000, seed=4)
    r = np.array([0.1, 4.0]) / 0.772
    ratio = DipoleProfile(m, 1.3).reflectance(r)[:, 0] / out.reflectance(r)[:, 0]
    assert ratio[0] < 0.3
    assert ratio[1] == pytest.approx(0.95, abs=0.06)


def test_a_fit_errs_by_about_the_noise():
    """The stated noise of the profile is near the error of a fit that could do better on a smooth one, and falls."""
    few, many = (trace_layers([layer(0.3, 1, np.inf, 1.3)], n) for n in (5_000, 80_000))
    assert few.relative_noise[0] / many.relative_noise[0] == pytest.approx(4, rel=0.25)
    error = Fitter(few.fit_nodes()).fit(6).error[0]
    assert 0.4 < error / few.relative_noise[0] < 1.2


def test_no_photons_are_refused():
    """At least one photon."""
    with pytest.raises(ValueError, match="photons"):
        trace_layers([layer(1, 1, 1.0, 1.4)], 0)


def annuli(out, edges, channel):
    """Light between given radii, those of the run's annuli that fit, by interpolating the cumulative light."""
    inside = np.append(0.0, np.cumsum(out.light[0, :-1, channel]))
    cumulative = np.interp(edges[1:-1], out.edge_mm[:-1], inside)
    return np.diff(np.concatenate([[0.0], cumulative, [out.total[0, channel]]]))


def test_vectors(vectors, three_layers):
    """Totals and light per annulus of published media, within their stated and our statistical errors."""
    red = trace_layers([layer(0.032, 0.74, np.inf, 1.3)], 150_000, seed=5)
    stack = trace_layers(three_layers, 60_000, seed=6)
    expected = vectors["mc_skin1R"]
    assert abs(red.total[0, 0] - expected["expected"]) < expected["atol"] + 3 * red.total_error[0, 0]
    expected = vectors["mc_skin3"]
    assert (np.abs(stack.total[0] - expected["expected"]) < expected["atol"] + 3 * stack.total_error[0]).all()
    for out, name, rows in ((red, "mc_annuli_skin1R", 1), (stack, "mc_annuli_skin3", 3)):
        vector = vectors[name]
        edges = np.array([float(e) for e in vector["inputs"]["edges"]])
        for c in range(rows):
            wanted = np.array(vector["expected"] if rows == 1 else vector["expected"][c])
            statistical = 4 * np.sqrt(wanted / (150_000 if rows == 1 else 60_000))
            assert (np.abs(annuli(out, edges, c) - wanted) < vector["atol"] + statistical).all()
    slab, half = vectors["mcml_slab"], vectors["mcml_semi"]
    out = trace_layers([layer(1.0, 9 * 0.25, 0.2, 1.0, 0.75)], 300_000, seed=9)
    assert (np.abs(out.total[:, 0] - slab["expected"]) < slab["atol"] + 3 * out.total_error[:, 0]).all()
    out = trace_layers([layer(1.0, 9.0, np.inf, 1.5)], 200_000, seed=9)
    found = 0.96 * out.total[0, 0] + np.array([0.04, 0.0])
    assert (np.abs(found - half["expected"]) < half["atol"] + 3 * out.total_error[0, 0]).all()


def test_light_from_everywhere_gives_back_what_its_slants_do():
    """The total is Chandrasekhar's 0.6253 where that holds, else that of the slants; slants carry it further."""
    skin = layer(0.228, 0.772, np.inf, 1.0)
    pencil, diffuse = (trace_layers([skin], 200_000, 3, None, how) for how in ("perpendicular", "diffuse"))
    (expected,) = half_space_diffuse_reflectance(np.array([0.772]))
    assert z(diffuse.total[0, 0], diffuse.total_error[0, 0], expected) < Z_LIMIT
    inside = [
        profile.light[0, profile.edge_mm[1:] < 1.0, 0].sum() / profile.total[0, 0] for profile in (pencil, diffuse)
    ]
    assert inside[1] < 0.98 * inside[0]
    glossy = Layer(Medium(np.array([0.05]), np.array([1.5])), 2.0, 1.4, 0.5)
    out = trace_layers([glossy], 100_000, 4, incidence="diffuse")
    slants = reflect_slanted([glossy], 60_000)
    # Of the slants, those that get in count
    mu = np.linspace(0, 1, 2001)
    enters = mu * np.array([1 - fresnel(1.0, 1.4, m)[0] for m in mu])
    entered = np.interp(mu, slants.cosine, slants.reflectance_rgb[:, 0])
    assert out.total[0, 0] == pytest.approx((enters * entered).sum() / enters.sum(), rel=0.01)


def test_another_way_to_enter_is_refused():
    with pytest.raises(ValueError, match="incidence: expected perpendicular or diffuse, got slanted"):
        trace_layers([layer(1, 1, 1.0, 1.4)], 10, incidence="slanted")
