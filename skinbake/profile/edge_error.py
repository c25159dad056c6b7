"""How wrong a fit makes light on skin: its error in spatial frequency, as a blur of shades and edges sees it.

What the blur does is M~ - E~ = (R~(k) - R~(0)) E~; what a fit does otherwise is (F~(k) - R~(k)) E~. The ratio of their
norms,

    (int (F~ - R~)^2 |E~|^2 dk) / (int (R~(0) - R~)^2 |E~|^2 dk),   square root of it,

times what the blur does, which a bake measures, is what the fit leaves wrong. Across an edge |E~|^2 falls as 1/k^2, and
slow shades fall faster: with 1/k^3 the estimate was 0.6 to 1.7 times what fits of 2 to 6 Gaussians to two skins left
wrong on a hill. The r-weighted error of theory.md 4.2 says 3 to 40 times less: it sees little of the far tail, which
carries light furthest.
"""

from __future__ import annotations

import numpy as np

from skinbake.numerics import Float, safe_div
from skinbake.profile.fit_nodes import AnnulusNodes, FitNodes, FrequencyNodes, geometric

FALL = 3.0  # exponent of the light's spectrum
LOWEST, HIGHEST = 0.03, 300.0  # per mm: waves as long as a head; as short as its finest texels


def edge_error(nodes: FitNodes, variance_mm2: Float, weight: Float) -> Float:
    """The ratio above, by channel, shape (C,); 0 where there is no light, or nothing is blurred.

    Parameters
    ----------
    nodes : FitNodes
        Of the model.
    variance_mm2 : ndarray of shape (N,)
    weight : ndarray of shape (N, C)
        In the model's own scale: not yet white.
    """
    s, model = _spectrum(nodes)
    fit = np.exp(-0.5 * s[:, None] ** 2 * variance_mm2) @ weight
    per_wave = s[:, None] ** (1 - FALL)  # |E~|^2 dk on a geometric grid
    wrong, blurred = ((each**2 * per_wave).sum(axis=0) for each in (fit - model, nodes.total - model))
    return np.sqrt(safe_div(wrong, blurred))


def _spectrum(nodes: FitNodes) -> tuple[Float, Float]:
    """Frequencies, geometric, and the model's Hankel transform there, (M,), (M, C)."""
    if isinstance(nodes, FrequencyNodes):
        seen = (nodes.s_per_mm >= LOWEST) & (nodes.s_per_mm <= HIGHEST)
        return nodes.s_per_mm[seen], nodes.target[seen]
    assert isinstance(nodes, AnnulusNodes)
    from scipy.special import j1

    s = geometric(LOWEST, HIGHEST)
    # int J0(s r) 2 pi r dr = 2 pi r J1(s r) / s
    inside = 2 * np.pi * nodes.edge_mm * j1(s[:, None] * nodes.edge_mm) / s[:, None]
    return s, np.diff(inside, axis=1) @ nodes.target
