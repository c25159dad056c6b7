"""Rays into flesh bring what a slab lets through, and know the shortest way to a face that leans."""

import numpy as np
import pytest

from skinbake.diffuse.terms.flesh_rays import AROUND, gathered, rays_inwards, through_along
from skinbake.diffuse.terms.slab_weights import SlabWeights, fit_slabs
from skinbake.profile import GaussianSum
from skinbake.profile.medium import Medium

SKIN = Medium(np.array([0.032, 0.17, 0.48]), np.array([0.74, 0.88, 1.01]))


def brought(slabs: SlabWeights, distance_mm: float, lean: float):
    """What all rays bring from a plane at a distance, whose normal leans from the way in by an angle."""
    ways, _ = rays_inwards()
    towards = ways @ np.array([np.sin(lean), 0, np.cos(lean)])
    length = distance_mm / np.maximum(towards, 1e-9)
    table, logarithm = through_along(slabs.thickness_mm, slabs.through_rgb), np.log(slabs.thickness_mm)
    each = np.stack([np.interp(np.log(length), logarithm, table[:, c], right=0) for c in range(3)], axis=1)
    return gathered(np.where(towards[:, None] > 0, each, 0), AROUND[0])[0]


@pytest.mark.parametrize("eta", [1.0, 1.4])
def test_a_slab_lets_through_what_it_does(eta):
    """T(d) of slabs of skin1, by rays of the lengths that they have in them."""
    weight = np.full((1, 3), 0.3)
    slabs = fit_slabs(GaussianSum(np.ones(1), weight, np.zeros(3), weight[0], normalise="none"), SKIN, eta)
    for thick in (0.5, 1.0, 2.0, 4.0, 6.0):
        at = [np.interp(np.log(thick), np.log(slabs.thickness_mm), slabs.through_rgb[:, c]) for c in range(3)]
        np.testing.assert_allclose(brought(slabs, thick, 0.0)[:2], at[:2], rtol=0.05)
        np.testing.assert_allclose(brought(slabs, thick, 0.0)[2], at[2], rtol=0.06, atol=1e-4)


@pytest.mark.parametrize("degrees", [0, 15, 30])
def test_a_face_that_leans_is_as_near_as_it_is(degrees):
    """Light that dies away as exp(-kappa r) comes by the shortest way, whichever way the point's own normal looks."""
    kappa, thickness = np.array([0.3, 0.6, 0.9]), np.geomspace(0.1, 40.0, 96)
    one = np.ones((96, 2, 3))
    slabs = SlabWeights(thickness, np.exp(-kappa * thickness[:, None]), 1.0, one, one)
    lean, shortest = np.radians(degrees), 3.0
    want = np.exp(-kappa * shortest)
    np.testing.assert_allclose(brought(slabs, shortest, lean), want, rtol=0.15)
    straight_in = np.cos(lean) * np.exp(-kappa * shortest / np.cos(lean))
    if degrees == 30:
        assert np.all(straight_in < 0.8 * want)
