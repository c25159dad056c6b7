"""Places of a skin that varies give back what their media do, as the mean skin does by `incidence`."""

import numpy as np
import pytest

from skinbake.profile import fit_skin, profile_of
from skinbake.profile.skin_medium import medium_incidence, skin_medium
from skinbake.profile.transport import trace_layers
from skinbake.profile.varying_skin import Range, mean_skin
from skinbake.profile.weight_table import even_nodes
from skinbake.scene.skin import DipoleSkin, PhysiologySkin

OVER = {"melanin": Range(0.01, 0.25, 0.035)}
PIGMENTS = {"melanin": Range(0.005, 0.2, 0.03), "haemoglobin": Range(0.004, 0.03, 0.006)}


def skin(**keys):
    return PhysiologySkin(
        **{"model": "physiology", "melanin": 0.01, "normalise": "none", "fit": {"gaussians": 3}} | keys
    )


def given_back(of, over, values):
    """Share of light from everywhere that a bake with `incidence` gives back where maps hold given values, (P, 3)."""
    gaussians, mean = fit_skin(of, over=over).gaussians, mean_skin(of, over)
    # What the mean skin itself gives back is left to it, but for what is read between nodes
    np.testing.assert_allclose(gaussians.weight_rgb.sum(axis=0), profile_of(mean).total_reflectance, rtol=0.01)
    factor = medium_incidence(skin_medium(mean)).diffuse_rgb / gaussians.weight_rgb.sum(axis=0)
    return gaussians.table.total(values) * factor


def test_flat_skin_of_each_node_gives_back_what_photons_say():
    """Light and dark skin in light from everywhere, equal indices; the mean skin's factor alone is off by some 6 %."""
    melanin = np.array([0.01, 0.05551, 0.25])  # nodes 0, 12 and 32
    got = given_back(skin(eta=1.0), OVER, {"melanin": melanin})
    mean = mean_skin(skin(eta=1.0), OVER)
    one = medium_incidence(skin_medium(mean)).diffuse_rgb / profile_of(mean).total_reflectance
    for value, found in zip(melanin, got, strict=True):
        of = skin(eta=1.0, melanin=value)
        medium = skin_medium(of)
        photons = trace_layers(medium.layers, 4000, incidence="diffuse")
        want = medium.to_rgb @ photons.total[0]
        error = np.sqrt(medium.to_rgb**2 @ photons.total_error[0] ** 2)
        assert np.all(np.abs(found - want) < 3.5 * error + 2e-3 * want)
        if value == melanin[1]:
            assert np.all(np.abs(profile_of(of).total_reflectance * one / want - 1) > 0.04)


def test_two_pigments_at_nodes():
    """As the medium of each place reflects, to what is read between 13 x 7 nodes of the mean."""
    melanin, blood = np.array([0.005, 0.05, 0.2]), np.array([0.004, 0.03, 0.03])
    melanin[1] = even_nodes(0.005, 0.2, 13)[5]
    got = given_back(skin(), PIGMENTS, {"melanin": melanin, "haemoglobin": blood})
    for a, b, found in zip(melanin, blood, got, strict=True):
        want = medium_incidence(skin_medium(skin(melanin=float(a), haemoglobin=float(b)))).diffuse_rgb
        np.testing.assert_allclose(found, want, rtol=0.01)


@pytest.mark.parametrize(
    ("of", "over"),
    [
        (skin(normalise="white"), OVER),
        (DipoleSkin(model="dipole", sigma_a_per_mm=(0.1, 0.2, 0.4), sigma_sp_per_mm=(1, 1, 1), normalise="none"), None),
    ],
    ids=["white", "of another width"],
)
def test_skin_of_one_level_stays_as_it_is(of, over):
    """White skin has its colours from the albedo; a width changes no total."""
    table = fit_skin(of, over=over or {"radius": Range(0.5, 1.5, 1.0)}).gaussians.table
    total = table.weight_rgb.sum(axis=2)
    np.testing.assert_allclose(total, np.broadcast_to(total[0, 0], total.shape), rtol=1e-12)
