import numpy as np
import pytest

from skinbake.numerics import gaussian_2d
from skinbake.profile.fit_nodes import AnnulusNodes, FrequencyNodes, geometric

VARIANCE = np.array([0.02, 0.5, 9.0])
WEIGHT = np.array([0.2, 0.5, 0.1])


def frequency_nodes():
    s = geometric(1e-6, 60)
    target = np.exp(-(s[:, None] ** 2) * VARIANCE / 2) @ WEIGHT
    return FrequencyNodes(s, target[:, None], np.array([WEIGHT.sum()]))


def annulus_nodes():
    edge = np.append(0.0, np.geomspace(1e-4, 40, 4000))
    light = -np.expm1(-(edge[:, None] ** 2) / (2 * VARIANCE)) @ WEIGHT
    return AnnulusNodes(edge, (np.diff(light) / (np.pi * np.diff(edge**2)))[:, None], np.array([WEIGHT.sum()]))


def exact_norm():
    """sqrt(int r R^2 dr) by the closed Gram matrix of theory.md 4.4."""
    return np.sqrt(WEIGHT @ (1 / (4 * np.pi**2 * (VARIANCE[:, None] + VARIANCE))) @ WEIGHT)


@pytest.mark.parametrize(("nodes", "rtol"), [(frequency_nodes(), 1e-11), (annulus_nodes(), 1e-5)])
def test_norm_is_the_one_of_the_plane(nodes, rtol):
    """By Parseval in the frequency domain, and directly on annuli, the sum of squares is int r R^2 dr."""
    assert np.linalg.norm(nodes.target[:, 0] * nodes.root_weight) == pytest.approx(exact_norm(), rel=rtol)


@pytest.mark.parametrize("nodes", [frequency_nodes(), annulus_nodes()])
def test_basis_is_the_unit_gaussian_and_its_slope(nodes):
    """The model is the weighted basis, and the second array is d/d ln v of the first."""
    value, slope = nodes.basis(VARIANCE)
    np.testing.assert_allclose(value @ WEIGHT, nodes.target[:, 0], rtol=1e-9, atol=1e-12)
    step = 1e-6
    numeric = (nodes.basis(VARIANCE * np.exp(step))[0] - nodes.basis(VARIANCE * np.exp(-step))[0]) / (2 * step)
    np.testing.assert_allclose(slope, numeric, rtol=1e-5, atol=1e-7 * np.abs(slope).max())


@pytest.mark.parametrize("nodes", [frequency_nodes(), annulus_nodes()])
def test_window_share(nodes):
    """The share of light under a Gaussian window v is sum w v / (v + v_i) over the total."""
    v = np.array([0.01, 1.0, 30.0])
    expected = (v[:, None] / (v[:, None] + VARIANCE)) @ WEIGHT / WEIGHT.sum()
    np.testing.assert_allclose(nodes.window_share(v)[:, 0], expected, rtol=1e-4)


def test_footprint_blurs_both():
    """Seen through a footprint the norm is that of the blurred profile."""
    nodes = frequency_nodes()
    seen = FrequencyNodes(nodes.s_per_mm, nodes.target, nodes.total, footprint_mm=0.5)
    r = np.geomspace(1e-5, 40, 20000)
    blurred = gaussian_2d(VARIANCE[None] + 0.25, r[:, None]) @ WEIGHT
    expected = np.sqrt(np.trapezoid(r**2 * blurred**2, np.log(r)))
    assert np.linalg.norm(seen.target[:, 0] * seen.root_weight) == pytest.approx(expected, rel=1e-6)
