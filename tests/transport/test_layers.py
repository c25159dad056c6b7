"""Walks through layers by depth below the surface, against photons that go the other way."""

import math

import numpy as np
import pytest

from skinbake.profile.chandrasekhar import half_space_diffuse_reflectance, half_space_reflectance
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.transport import trace_layers
from skinbake.transport.light_leaving import light_leaving, medium_for_walks
from skinbake.transport.medium import Pigment, SkinLayers, TransportMedium
from skinbake.transport.skin_grid import SkinGrid
from skinbake.transport.walk_medium import DENSITY
from tests.shapes import sphere
from tests.transport.solids import box, on_top, rays_of
from tests.transport.test_light_leaving import WHOLE, agree, pooled, sky, sun

# Top first: absorption, reduced scattering, mm, g
DONNER = (
    ((0.21, 0.21, 0.50), (4.8, 6.0, 6.5), 0.25, 0.0),
    ((0.016, 0.019, 0.030), (3.2, 4.0, 4.6), 0.20, 0.0),
    ((0.0085, 0.10, 2.5), (0.45, 0.47, 0.48), np.inf, 0.0),
)
FORWARD = (((1.0, 2.0, 4.0), (2.0, 2.0, 2.0), 0.3, 0.8), ((0.1, 0.1, 0.1), (1.0, 4.0, 8.0), np.inf, 0.0))
SIDE = 300.0


def skin_of(stack, eta, pigments=None, radius=1.0):
    media = [TransportMedium(np.array(a), np.array(s) / (1 - g), g, eta).denser(1 / radius) for a, s, _, g in stack]
    thickness = tuple(thickness * radius for *_, thickness, _ in stack)
    return SkinLayers(tuple(media), thickness, pigments or (None,) * len(stack))


def walked(skin, lights, walks, points=4, grid=None, quantities=()):
    mesh = box([-SIDE, -SIDE, -SIDE], [SIDE, SIDE, 0])
    face, place = on_top(mesh, np.linspace(-10, 10, points), np.full(points, 20.0))
    rays = rays_of(mesh)
    medium = medium_for_walks(rays, skin, grid, quantities)
    return light_leaving(rays, medium, lights, face, place, walks, 5)


def everywhere(*values):
    """A grid that says the same at every place."""
    value = np.broadcast_to(np.array(values, np.float32), (2, 2, 2, len(values)))
    return SkinGrid(value, np.full(3, -SIDE), 2 * SIDE, np.array(values), np.array(values))


@pytest.mark.parametrize(("stack", "eta"), [(DONNER, 1.0), (DONNER, 1.4), (FORWARD, 1.3)])
def test_a_stack_of_layers_gives_the_totals_of_the_layered_walks(stack, eta):
    """Normal incidence, channel by channel: three layers with and without a face that refracts, forward scattering."""
    layers = [Layer(Medium(np.array(a), np.array(s)), thickness, eta, g) for a, s, thickness, g in stack]
    lights = [sun(), sky()] if eta == 1 else [sun()]
    got, stderr = pooled(walked(skin_of(stack, eta), lights, 200), WHOLE)
    photons = [trace_layers(layers, 20_000, incidence=how) for how in ("perpendicular", "diffuse")[: len(lights)]]
    want, noise = (
        np.array([getattr(each, name) for each in photons]) for name in ("total_reflectance", "total_stderr")
    )
    agree(got, np.hypot(stderr, noise), want, precise=0.06)


def test_layers_follow_a_curved_surface():
    """A ball of 2 mm with a skin of 0.4 mm under a sky, against photons in concentric shells."""
    stack = (((1.0, 0.5, 0.1), (2.0, 2.0, 2.0), 0.4, 0.0), ((0.1, 0.3, 1.0), (1.0, 4.0, 2.0), np.inf, 0.0))
    mesh = sphere(2.0, "cube", 24)
    face = np.arange(0, len(mesh.faces), len(mesh.faces) // 8, dtype=np.int32)
    found = light_leaving(rays_of(mesh), skin_of(stack, 1.0), [sky()], face, np.full((len(face), 2), 0.3), 160, 3)
    got, stderr = pooled(found, WHOLE)
    for channel in range(3):
        want, noise = _shells(np.random.default_rng(channel), 60_000, stack, channel, 2.0)
        # The mesh's faces are flat: half a per cent
        assert abs(got[0, channel] - want) < 3.5 * math.hypot(stderr[0, channel], noise) + 0.005 * want
    assert np.all(stderr < 0.03 * got)


def _shells(rng, photons, stack, channel, radius):
    """Share of light from everywhere that scatters in a ball of two shells and leaves, and its standard error."""
    sigma_a, sigma_s = (np.array([layer[k][channel] for layer in stack]) for k in (0, 1))
    most, inner = (sigma_a + sigma_s).max(), radius - stack[0][2]
    mu = np.sqrt(rng.random(photons))
    at = np.tile([0.0, 0.0, radius * (1 - 1e-9)], (photons, 1))
    way = np.stack([np.sqrt(1 - mu * mu), np.zeros(photons), -mu], axis=1)
    weight, scattered, out = np.ones(photons), np.zeros(photons, bool), np.zeros(photons)
    alive = np.arange(photons)
    while len(alive):
        at[alive] += rng.exponential(1 / most, len(alive))[:, None] * way[alive]
        r = np.linalg.norm(at[alive], axis=1)
        left = alive[r >= radius]
        out[left] = weight[left] * scattered[left]
        alive, r = alive[r < radius], r[r < radius]
        layer = (r < inner).astype(int)
        meets = rng.random(len(alive)) * most < (sigma_a + sigma_s)[layer]
        hit, layer = alive[meets], layer[meets]
        weight[hit] *= (sigma_s / (sigma_a + sigma_s))[layer]
        scattered[hit] = True
        cosine, turn = rng.uniform(-1, 1, len(hit)), rng.uniform(0, 2 * np.pi, len(hit))
        sine = np.sqrt(1 - cosine**2)
        way[hit] = np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=1)
        faint = alive[weight[alive] < 0.01]
        survives = rng.random(len(faint)) < 0.1
        weight[faint] *= np.where(survives, 10.0, 0.0)
        alive = alive[weight[alive] > 0]
    return out.mean(), out.std() / math.sqrt(photons)


def test_a_width_by_map_widens_layers_as_the_key_does():
    """Density 1 / 2 everywhere: the same walks as in layers twice as thick of coefficients half as large."""
    one = walked(skin_of(DONNER, 1.3), [sun(0.5), sky()], 16, 2, everywhere(0.5), (DENSITY,))
    other = walked(skin_of(DONNER, 1.3, radius=2.0), [sun(0.5), sky()], 16, 2)
    np.testing.assert_allclose(one.mean, other.mean, rtol=1e-6)


def test_a_pigment_by_map_absorbs_as_the_same_coefficient_does():
    """The same share of pigment everywhere in either layer: the same walks as through layers that hold it."""
    base = (((0.1, 0.2, 0.3), (4.0, 5.0, 6.0), 0.25, 0.0), ((0.02, 0.1, 0.4), (2.0, 2.5, 3.0), np.inf, 0.0))
    pigments = Pigment("melanin", np.array([2.0, 4.0, 9.0])), Pigment("haemoglobin", np.array([0.5, 5.0, 3.0]))
    holding = tuple(
        (np.array(a) + share * pigment.sigma_a_per_mm, s, thickness, g)
        for (a, s, thickness, g), pigment, share in zip(base, pigments, (0.25, 0.125), strict=True)
    )
    grid, names = everywhere(0.125, 0.25), ("haemoglobin", "melanin")
    one = walked(skin_of(base, 1.3, pigments), [sun(0.5), sky()], 16, 2, grid, names)
    other = walked(skin_of(holding, 1.3), [sun(0.5), sky()], 16, 2)
    np.testing.assert_allclose(one.mean, other.mean, rtol=1e-6)


def test_wavelengths_add_up_to_the_colour_that_a_matrix_makes_of_their_totals():
    """Seven wavelengths of one medium, a matrix with negative numbers, Chandrasekhar's R(1) and R of a sky."""
    albedo = np.array([0.3, 0.95, 0.6, 0.99, 0.8, 0.5, 0.9])
    to_rgb = np.array(
        [[0.1, -0.4, 0.2, 0.6, 0.5, 0, 0], [0, 0.1, 0.3, -0.1, 0.2, 0.3, 0.2], [0.8, 0.4, 0, 0, 0, 0, -0.2]]
    )
    sigma_t = np.linspace(0.5, 3.0, 7)
    medium = TransportMedium((1 - albedo) * sigma_t, albedo * sigma_t)
    found = walked(SkinLayers((medium,), (np.inf,), (None,), to_rgb), [sun(), sky()], 960)
    want = np.stack([half_space_reflectance(1.0, albedo), half_space_diffuse_reflectance(albedo)]) @ to_rgb.T
    agree(*pooled(found, WHOLE), want, precise=0.04)


def test_what_walks_need_of_layers_is_asked_for():
    """A pigment without a map, layers of two indices, a last layer with an end."""
    medium = TransportMedium(np.ones(3), np.ones(3))
    skin = SkinLayers((medium,), (np.inf,), (Pigment("melanin", np.ones(3)),))
    rays = rays_of(sphere(2.0, "cube", 4))
    with pytest.raises(ValueError, match="melanin"):
        medium_for_walks(rays, skin)
    with pytest.raises(ValueError, match="eta"):
        SkinLayers((medium, TransportMedium(np.ones(3), np.ones(3), 0.0, 1.3)), (1.0, np.inf), (None, None))
    with pytest.raises(ValueError, match="thickness_mm"):
        SkinLayers((medium, medium), (1.0, 1.0), (None, None))
