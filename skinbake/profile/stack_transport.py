"""Transport through stacks of layers that scatter to all sides alike: what comes back of a beam, without noise.

As in `slab_transport.py`, layers are doubled and then laid on one another (theory.md 7.5).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from skinbake.numerics import Float
from skinbake.profile.fresnel import reflectance_from_inside
from skinbake.profile.layers import Layer, without_empty

GAUSS = 8  # directions on either side of the critical angle: R(mu) to 4e-5, with an index of 1.4 to 1e-7
THINNEST = 2.0**-12  # free paths of the layers that doubling begins with
MOST_DOUBLINGS = 60
VANISHED = 1e-7  # transmittance below which a layer is as good as infinite
SMALLEST_COSINE = 1e-4


class _Operators(NamedTuple):
    """Reflection and transmission of radiance by a layer, from direction j to i, each (C, n, n)."""

    reflect: Float
    transmit: Float


def stack_reflectance(stacks: Sequence[Sequence[Layer]], cosine: Float) -> Float:
    """Share of a beam that entered each of S stacks and leaves it above, (S, M, C).

    Layers that several stacks have in common are solved once.

    Parameters
    ----------
    stacks : sequence of sequence of Layer
        All of one index, g 0 and C channels.
    cosine : ndarray of shape (M,)
        Of incidence, outside.

    Raises
    ------
    ValueError
        If an index is below 1, two differ or a layer scatters forwards, or as `without_empty`.

    References
    ----------
    [vandeHulst1980]
    """
    kept = [without_empty(stack) for stack in stacks]
    eta = kept[0][0].eta
    if not eta >= 1 or any(layer.eta != eta or layer.g for stack in kept for layer in stack):
        raise ValueError("layers: expected one index >= 1, and g 0")
    mu, weight = _directions(eta, cosine)
    face = reflectance_from_inside(eta, mu)
    known: dict[bytes, _Operators] = {}
    found = np.empty((len(kept), len(cosine), len(kept[0][0].medium.albedo)))
    for k, stack in enumerate(kept):
        below = np.diag(face)[None]  # the lower face of the last layer, if it has one
        for layer in reversed(stack):
            key = _identity(layer)
            if key not in known:
                known[key] = _layer(layer, mu, weight)
            above = known[key]
            below = above.reflect + above.transmit @ _divided(below @ above.reflect, below @ above.transmit)
        # By reciprocity what leaves of a beam is the radiance along it when light enters along all directions
        entering = (1 - face) * (weight > 0)
        down = _divided(face[:, None] * below, np.broadcast_to(entering[:, None], (*below.shape[:2], 1)))
        found[k] = (below @ down)[:, len(mu) - len(cosine) :, 0].T
    return found


def _directions(eta: float, cosine: Float) -> tuple[Float, Float]:
    """Cosines inside, those of quadrature and then those of the refracted beams, and weights; beams weigh nothing."""
    node, weight = np.polynomial.legendre.leggauss(GAUSS)
    node, weight = (node + 1) / 2, weight / 2
    beams = _inside(eta, np.maximum(cosine, SMALLEST_COSINE))
    if eta > 1:
        # What leaves, by its cosine outside, in which Fresnel's equation is smooth: mu dmu = c dc / eta^2
        split, upper = float(np.sqrt(1 - 1 / eta**2)), _inside(eta, node)
        upper_weight = weight * node / (eta**2 * upper)
    else:
        split, upper, upper_weight = 0.5, 0.5 + node / 2, weight / 2
    mu = np.concatenate([split * node, upper, beams])
    return mu, np.concatenate([split * weight, upper_weight, np.zeros(len(beams))])


def _inside(eta: float, cosine: Float) -> Float:
    """Cosines of refracted beams."""
    found: Float = np.sqrt(1 - (1 - cosine**2) / eta**2)
    return found


def _identity(layer: Layer) -> bytes:
    """What tells a layer from others of its index."""
    medium = layer.medium
    return b"".join(
        [medium.sigma_a_per_mm.tobytes(), medium.sigma_sp_per_mm.tobytes(), str(layer.thickness_mm).encode()]
    )


def _layer(layer: Layer, mu: Float, weight: Float) -> _Operators:
    """One layer, without faces."""
    extinction = layer.medium.sigma_a_per_mm + layer.medium.sigma_sp_per_mm
    infinite = np.isinf(layer.thickness_mm)
    depth = np.full_like(extinction, THINNEST) if infinite else extinction * layer.thickness_mm
    count = 0 if infinite else max(0, int(np.ceil(np.log2(depth.max() / THINNEST))))
    reflect, transmit = _thin(layer.medium.sigma_sp_per_mm / extinction, depth / 2.0**count, mu, weight)
    for doubling in range(MOST_DOUBLINGS if infinite else count):
        if infinite and doubling % 4 == 0 and transmit.max() < VANISHED:
            break
        inner = _divided(reflect @ reflect, transmit)
        reflect, transmit = reflect + transmit @ reflect @ inner, transmit @ inner
    return _Operators(reflect, transmit)


def _thin(albedo: Float, depth: Float, mu: Float, weight: Float) -> _Operators:
    """A layer of at most a four-thousandth of a free path, to second order; arguments by channel."""
    scale = (depth[:, None] / (4 * mu))[:, :, None]
    scattered = scale * albedo[:, None, None] * weight  # to both sides alike
    unit = np.eye(len(mu))
    kept = unit + 2 * scale * unit - scattered
    once = np.linalg.solve(kept, scattered)
    gain = np.linalg.inv(kept - scattered @ once)
    return _Operators(2 * gain @ scattered @ np.linalg.inv(kept), 2 * gain - unit)


def _divided(matrix: Float, by: Float) -> Float:
    """(1 - matrix)^-1 by: what goes to and fro without end."""
    return np.asarray(np.linalg.solve(np.eye(matrix.shape[-1]) - matrix, by), np.float64)
