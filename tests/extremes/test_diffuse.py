"""Diffusion is linear, positive, symmetric, and the same from any side, in any unit and for any turn of the texture."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skinbake.atlas import interpolate, rasterize
from skinbake.diffuse import diffuse
from skinbake.diffuse.lattice import discrete_gaussian
from skinbake.diffuse.texture_space.stretch import stretch_blur
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.scene.spec import DiffusionSpec
from tests.extremes.moves import moved, relative, rotation, uv_turned
from tests.shapes import quad, relief, sphere

METHODS = ("texture", "stretch", "surface")
SIZE = (53, 46)


def one_lobe(variance):
    return GaussianSum(np.array([variance]), np.ones((1, 3)), np.zeros(3), np.ones(3))


def blurred(mesh, light, variance, method, **spec):
    """One lobe at full size, float32; `light` is (H, W, 3)."""
    size = light.shape[1::-1]
    atlas = rasterize(mesh, size, gutter=2)
    spec = DiffusionSpec(**{"method": method, "probes": 0, **spec}).model_copy(update={"tolerance": 1e-9})
    baked = diffuse({1001: light[None]}, ("key",), atlas, mesh, one_lobe(variance), spec, 0, "float")
    return baked.lobes[0].rgb[1001][0], atlas[0]


def stripes(mesh, size=SIZE, axis=0, period_mm=14.0):
    """Light that knows the skin and not the texture."""
    position = interpolate(rasterize(mesh, size, gutter=2)[0], mesh.corner_position_mm)
    wave = (np.sin(2 * np.pi * position[..., axis] / period_mm) > 0.2).astype(np.float32)
    return np.stack([wave, 0.5 * wave, 1 - wave], axis=-1)


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 99), shift=st.sampled_from([0.0, 1e3]), scale=st.sampled_from([1e-2, 1.0, 50.35]))
def test_motion_and_unit(method, seed, shift, scale):
    """Positions moved and scaled, variances with the square of the scale: the same map, to float32 of positions."""
    mesh = relief()
    light = stripes(mesh)
    here, _ = blurred(mesh, light, 4.0, method)
    there, _ = blurred(moved(mesh, rotation(seed), np.full(3, shift * scale), scale), light, 4.0 * scale**2, method)
    # What the surface method adds from just beyond its cut depends on how batches lie to the axes
    assert relative(there, here) < (1e-4 if method == "surface" else 2e-6)
    assert np.sqrt(np.mean((there - here) ** 2)) < (1e-5 if method == "surface" else 2e-7)


@pytest.mark.parametrize("method", METHODS)
def test_a_quarter_turn_of_the_texture(method):
    """The blur turns as an image does."""
    mesh = sphere(20.0, "cube", 24)
    light = stripes(mesh)
    here, raster = blurred(mesh, light, 3.0, method)
    there, _ = blurred(uv_turned(mesh), np.ascontiguousarray(np.rot90(light)), 3.0, method)
    inside = np.rot90(raster.coverage) > 0.99
    assert relative(there[inside], np.rot90(here)[inside]) < {"texture": 2e-6, "stretch": 5e-3, "surface": 1e-4}[method]


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 99), k=st.floats(1e-3, 1e3), variance=st.sampled_from([0.05, 1.0, 30.0]))
def test_linear_positive_and_within_the_light(method, seed, k, variance):
    """blur(f + k g) = blur(f) + k blur(g) to float32, nothing below zero, nothing above the brightest texel."""
    mesh, rng = relief(), np.random.default_rng(seed)
    f, g = (rng.random((*SIZE[::-1], 3), dtype=np.float32) ** 8 for _ in range(2))
    both = f + np.float32(k) * g
    parts = [blurred(mesh, light, variance, method)[0] for light in (f, g, both)]
    assert np.abs(parts[2] - (parts[0] + k * parts[1])).max() < 3e-6 * both.max()
    assert (parts[2] >= 0).all()
    assert parts[2].max() <= both.max() * (1 + 1e-5)


@pytest.mark.parametrize("variance", [0.3, 4.0])
def test_the_classical_integral_is_symmetric(variance):
    """Light from A seen at B is light from B seen at A, by area: <g, K f> = <f, K g>, to 5e-5."""
    mesh, rng = relief(), np.random.default_rng(1)
    f, g = (rng.random((*SIZE[::-1], 3), dtype=np.float32) for _ in range(2))
    kf, raster = blurred(mesh, f, variance, "surface", normalise=False)
    kg, _ = blurred(mesh, g, variance, "surface", normalise=False)
    area = raster.area_mm2[..., None].astype(np.float64)
    assert (g * kf * area).sum() == pytest.approx((f * kg * area).sum(), rel=5e-5)


@pytest.mark.parametrize("variance", [0.2, 3.0, 40.0])
def test_a_closed_surface_keeps_its_light(variance):
    """Total light by area after the blur over before, on a sphere: within 0.1 %, lobes up to a third of its radius."""
    mesh = sphere(20.0, "cube", 32)
    light = stripes(mesh, (96, 64))
    out, raster = blurred(mesh, light, variance, "surface")
    area = raster.area_mm2[..., None].astype(np.float64)
    ratio = (out * area).sum(axis=(0, 1)) / (light * area).sum(axis=(0, 1))
    np.testing.assert_allclose(ratio, 1, atol=1e-3)


@pytest.mark.parametrize(("sigma", "peak"), [(0.4, 1e6), (3.0, 1e6), (4.0, 1e9)])
def test_texture_in_float32_beside_a_sun_glint(sigma, peak):
    """One texel of 1e6 to 1e9 in light of 1: beyond the kernel's reach six digits of a float64 blur stay."""
    height, width = 81, 96
    light = np.ones((height, width, 3), np.float32)
    light[40, 48] = peak
    got, _ = blurred(quad(float(width), float(height)), light, sigma**2, "texture")
    half = discrete_gaussian(sigma**2)
    kernel = np.concatenate([half[:0:-1], half])
    wanted = light[..., 0].astype(np.float64)
    for axis, n in ((0, height), (1, width)):
        index = np.arange(n)[:, None] - np.arange(n)[None, :]
        weights = np.where(np.abs(index) < len(half), kernel[np.clip(index + len(half) - 1, 0, len(kernel) - 1)], 0.0)
        weights /= weights.sum(axis=1, keepdims=True)
        wanted = np.moveaxis(np.tensordot(weights, wanted, axes=(1, axis)), 0, axis)
    away = np.hypot(*np.mgrid[-40:41, -48:48]) > 7 * sigma + 12
    assert away.any()
    assert np.abs(got[..., 0] / wanted - 1)[away].max() < 2e-6
    assert np.abs(got[..., 0] - wanted).max() < 2e-6 * peak


@pytest.mark.parametrize("method", METHODS)
def test_the_widest_blur_is_the_mean(method):
    """As sigma outgrows the skin, each texel tends to the mean of the light."""
    mesh = quad(20.0, 16.0)
    light = np.random.default_rng(0).random((*SIZE[::-1], 3), dtype=np.float32)
    out, _ = blurred(mesh, light, 1e5, method)
    bound = {"texture": 2e-4, "stretch": 2e-2, "surface": 1e-5}[method]
    np.testing.assert_allclose(out, np.broadcast_to(light.mean(axis=(0, 1)), out.shape), rtol=bound)


@pytest.mark.parametrize(("peak", "allowed"), [(1.0, 3e-6), (1e6, 1e-4)])
def test_stretch_in_float32_beside_a_sun_glint(peak, allowed):
    """Against float64 with the library's exp, of each texel's own value; the glint shows the far tail's own digits."""
    rng = np.random.default_rng(5)
    height, width, reach = 37, 45, 7  # CUT_SIGMA deviations of the wider axis, below
    light = rng.random((1, height, width, 3)).astype(np.float32) + np.float32(0.5)
    light[0, 18, 20] = peak
    area = (0.2 + rng.random((height, width))).astype(np.float32)
    chart = np.zeros((height, width), np.int32)
    chart[:, 30:] = 1
    covariance = np.broadcast_to(np.array([4.0, 1.0, 4.0], np.float32), (height, width, 3)).copy()
    got = stretch_blur(light, area, chart, covariance)[0]
    inverse = np.linalg.inv([[4.0, 1.0], [1.0, 4.0]])
    dy, dx = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    falloff = np.exp(-0.5 * (inverse[0, 0] * dx**2 + 2 * inverse[0, 1] * dx * dy + inverse[1, 1] * dy**2))
    for row, col in [(0, 0), (18, 14), (18, 29), (18, 30), (36, 44), (12, 22), (20, 26)]:
        rows, cols = np.clip(row + dy, 0, height - 1), np.clip(col + dx, 0, width - 1)
        inside = (rows == row + dy) & (cols == col + dx) & (chart[rows, cols] == chart[row, col])
        weight = falloff * inside * area[rows, cols].astype(np.float64)
        want = (weight[..., None] * light[0][rows, cols]).sum(axis=(0, 1)) / weight.sum()
        np.testing.assert_allclose(got[row, col], want, rtol=allowed)
