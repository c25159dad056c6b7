"""Errors of fits as light on skin sees them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from skinbake.profile import fit_skin
from skinbake.profile.edge_error import FALL, edge_error
from skinbake.profile.fit_nodes import AnnulusNodes, FrequencyNodes, geometric
from skinbake.scene.parse import parse
from skinbake.scene.skin import SkinSpec


def gaussians(s, variance):
    return np.exp(-0.5 * s[:, None] ** 2 * variance)


def test_a_wrong_width_is_found_in_both_domains():
    """A Gaussian fitted by one 20 % wider: by frequencies, by annuli, and by quadrature."""
    s = geometric(1e-3, 1e4, 64)
    model, wide = np.array([2.0]), np.array([2.88])
    nodes = FrequencyNodes(s, gaussians(s, model), np.ones(1))
    k = np.linspace(0.03, 60, 400_000)[:, None]
    per = k**-FALL
    want = np.sqrt(
        ((gaussians(k[:, 0], wide) - gaussians(k[:, 0], model)) ** 2 * per).sum()
        / ((1 - gaussians(k[:, 0], model)) ** 2 * per).sum()
    )
    found = edge_error(nodes, wide, np.ones((1, 1)))
    assert found == pytest.approx([want], rel=0.02)
    edge = np.linspace(0, 12, 3000)
    inside = 1 - np.exp(-(edge**2) / (2 * model[0]))
    means = np.diff(inside) / (np.pi * np.diff(edge**2))
    annuli = AnnulusNodes(edge, means[:, None], np.ones(1))
    assert edge_error(annuli, wide, np.ones((1, 1))) == pytest.approx(found, rel=0.02)
    assert edge_error(nodes, model, np.ones((1, 1))) == pytest.approx([0], abs=1e-12)


def test_more_gaussians_leave_less_wrong():
    """Of a dipole, each by a third or more; a given sum leaves nothing."""
    dipole = {"model": "dipole", "sigma_a_per_mm": [0.03, 0.2, 0.5], "sigma_sp_per_mm": [0.7, 0.9, 1.0], "eta": 1.3}

    def error(skin):
        return fit_skin(parse(SkinSpec, skin, lambda key, text: text)).gaussians.fit_error

    found = [error(dipole | {"fit": {"gaussians": n}}) for n in (2, 3, 4, 6)]
    assert all(b < 0.7 * a for a, b in pairwise(found))
    assert error({"model": "gaussians", "variance_mm2": [1.0], "weight_rgb": [[1, 1, 1]]}) == 0
