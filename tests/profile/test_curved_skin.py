"""Round skin and hollows by diffusion, against walks in balls."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.profile.curved_skin import curved_gain, curved_share, first_depth_mm
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.profile.medium import Medium
from skinbake.profile.slab_transport import diffuse_mean, slab_transport
from skinbake.scene.lights import EnvironmentLight
from skinbake.transport.light_leaving import ESTIMATES, light_leaving
from skinbake.transport.medium import TransportMedium
from tests.shapes import sphere
from tests.transport.solids import rays_of

SKIN = Medium(np.array([0.032, 0.17, 0.48]), np.array([0.74, 0.88, 1.01]))
SKY = EnvironmentLight(type="environment", name="sky", radiance=(1 / np.pi,) * 3)


@pytest.mark.parametrize(("eta", "radius"), [(1.0, 20.0), (1.4, 8.0), (1.4, 20.0)])
def test_a_ball_in_a_sky_shines_as_walks_in_it_say(eta, radius):
    """M of a constant sky over that of a plane, within noise and 2 %; a plane's would be off by 4 to 43 %."""
    mesh = sphere(radius, "cube", 48)
    face = np.arange(7, len(mesh.faces), len(mesh.faces) // 24).astype(np.int32)
    medium = TransportMedium(SKIN.sigma_a_per_mm, SKIN.sigma_sp_per_mm, 0.0, eta)
    found = light_leaving(rays_of(mesh), medium, [SKY], face, np.full((len(face), 2), 1 / 3), 256, 3)
    walked = found.mean[ESTIMATES["whole"]][:, 0].mean(axis=0)
    noise = np.sqrt((found.stderr[ESTIMATES["whole"]][:, 0] ** 2).sum(axis=0)) / len(face)
    plane = slab_transport(SKIN, eta, np.array([1.0]))
    want = diffuse_mean(plane.cosine, plane.back) * curved_gain(SKIN, eta, np.array([1 / radius]))[0]
    assert np.all(np.abs(walked / want - 1) < 0.02 + 3 * noise / want), (walked / want, noise / want)


def test_planes_have_no_gain_and_hollows_less():
    """1 at no curvature with the same slope on both sides, and the gain rises with it everywhere."""
    bend = np.array([-2.0, -0.2, -1e-4, 0.0, 1e-4, 0.2, 2.0])
    gain = curved_gain(SKIN, 1.4, bend)
    np.testing.assert_allclose(gain[3], 1, rtol=1e-12)
    np.testing.assert_allclose(gain[4] - 1, 1 - gain[2], rtol=1e-2)
    assert np.all(np.diff(gain, axis=0) > 0)
    assert np.all((gain > 0) & np.isfinite(gain))
    # No more than all of the light comes back
    plane = slab_transport(SKIN, 1.4, np.array([1.0]))
    assert np.all(gain[-1] * diffuse_mean(plane.cosine, plane.back) < 1.05)


def test_the_gain_is_the_wide_lobes():
    """Shares times weights sum to the weights; the narrowest lobe has none, the widest the most."""
    variance = np.array([0.02, 0.1, 0.5, 2.0, 8.0, 30.0])
    weight = np.tile(np.array([0.1, 0.1, 0.15, 0.2, 0.25, 0.2])[:, None], (1, 3))
    share = curved_share(GaussianSum(variance, weight, np.zeros(3), np.ones(3)), SKIN, 1.4)
    np.testing.assert_allclose((share * weight).sum(axis=0), weight.sum(axis=0))
    assert np.all(share >= 0)
    assert np.all(share[0] < 0.05)
    assert np.all(share[:, 0].argmax() >= 3)


def test_light_scatters_first_less_deep_where_it_enters_at_a_slant():
    """Two thirds of a free path with equal indices, more where it is refracted towards the normal."""
    np.testing.assert_allclose(first_depth_mm(SKIN, 1.0), 2 / 3 * SKIN.free_path_mm, rtol=1e-6)
    assert np.all(first_depth_mm(SKIN, 1.4) > 0.85 * SKIN.free_path_mm)
