"""Layers joined by adding in the Hankel domain, from the deepest upwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skinbake.numerics import Float
from skinbake.profile.fresnel import BoundaryMethod, boundary_factor
from skinbake.profile.medium import Medium
from skinbake.profile.slab import Array, ThinLayers, half_space, sharp_transmittance, slab


@dataclass(frozen=True)
class Layer:
    """One homogeneous layer.

    Attributes
    ----------
    medium : Medium
    thickness_mm : float
        Infinite in the last layer only.
    eta : float
        Refractive index.
    g : float
        Mean cosine of the phase function; used by transport alone.
    """

    medium: Medium
    thickness_mm: float
    eta: float
    g: float = 0.0


def without_empty(layers: Sequence[Layer]) -> tuple[Layer, ...]:
    """Layers that have a thickness: one of 0 mm reflects nothing and lets everything pass.

    Raises
    ------
    ValueError
        If none is left, a thickness is negative or NaN, or a layer other than the last is infinite.
    """
    kept = tuple(layer for layer in layers if layer.thickness_mm != 0)
    if not kept:
        raise ValueError("layers: expected at least one layer with a thickness above 0")
    if not all(layer.thickness_mm > 0 for layer in kept):
        raise ValueError("thickness_mm: expected numbers >= 0")
    if not all(np.isfinite(layer.thickness_mm) for layer in kept[:-1]):
        raise ValueError("thickness_mm: only the last layer may be infinite, nothing below it would be reached")
    return kept


def stack_response(
    layers: Sequence[Layer], s_per_mm: Array, boundary: BoundaryMethod = "polynomial", thin: ThinLayers = "guarded"
) -> tuple[Array, Array]:
    """Reflection and transmission of a stack lit from above, theory.md 3.7, each of shape (C, ...).

    The indices of neighbours set the boundary factors of both their faces; above and below is air.

    Parameters
    ----------
    layers : sequence of Layer
        Top first.
    s_per_mm : ndarray of shape (C or 1, ...)
        Spatial frequencies; s = 0 gives the totals.
    boundary : {"polynomial", "exact", "better"}
        As `boundary_factor`.
    thin : {"guarded", "ballistic", "continued"}
        As `slab`.

    Raises
    ------
    ValueError
        As `without_empty`.

    References
    ----------
    [Donner2005]
    """
    layers = without_empty(layers)
    outside = [1.0, *(layer.eta for layer in layers), 1.0]
    reflected: Array | None = None
    transmitted: Array = np.ones(1)
    loss: Array = np.ones(1)
    for i in reversed(range(len(layers))):
        layer = layers[i]
        # Each face has the index ratio of its own two sides, theory.md 1.5
        top = boundary_factor(layer.eta / outside[i], boundary)
        if np.isinf(layer.thickness_mm):
            reflected, loss = half_space(layer.medium, top, s_per_mm)
            transmitted = np.zeros_like(reflected)
            continue
        bottom = boundary_factor(layer.eta / outside[i + 2], boundary)
        this = slab(layer.medium, layer.thickness_mm, top, bottom, s_per_mm, thin)
        if reflected is None:
            reflected, transmitted, loss = this.down_r, this.down_t, this.down_loss
            continue
        # 1 - R1 R2 without subtraction, theory.md 3.8: all between the two is what escapes at each turn
        between = this.up_loss + this.up_r * loss
        transmitted = this.down_t * transmitted / between
        reflected = this.down_r + this.down_t * reflected * this.up_t / between
        loss = 1 - reflected
    assert reflected is not None
    return reflected, transmitted


def sharp_stack_transmittance(layers: Sequence[Layer], thin: ThinLayers = "guarded") -> Float:
    """Transmitted share that leaves exactly below its entry (a delta in T(r)), shape (C,)."""
    share = np.ones(1)
    for layer in without_empty(layers):
        if np.isinf(layer.thickness_mm):
            return np.zeros_like(layer.medium.albedo)
        share = share * sharp_transmittance(layer.medium, layer.thickness_mm, thin)
    return share
