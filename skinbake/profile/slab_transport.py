"""Transport through slabs of one medium by doubling: what of a beam comes back, and what comes through, scattered.

Diffusion theory lets unscattered light through a thin slab as if it shone to all sides, and next to nothing through a
dark one. Here the equation of transport itself is solved for a plane-parallel slab: two equal layers make one of twice
the thickness (theory.md 7.5).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.numerics import Float, monotone_cubic
from skinbake.profile.fresnel import reflectance_from_inside
from skinbake.profile.medium import Medium

COSINES = 17  # of incidence
GAUSS = 16  # directions on either side of the critical angle
THINNEST = 1e-5  # free paths of the layers that doubling begins with
LADDERS = 3  # sequences of thicknesses, each doubled: their union is in steps of the cube root of 2
MOST_DOUBLINGS = 60
VANISHED = 1e-9  # transmittance below which a slab is as good as infinite
SMALLEST_COSINE = 1e-4


class SlabTransport(NamedTuple):
    """Light of a beam that entered a slab, has scattered, and leaves it.

    Attributes
    ----------
    thickness_mm : ndarray of shape (K,)
        Ascending.
    cosine : ndarray of shape (M,)
        Of incidence, outside; ascending from 0 to 1 in even steps.
    through : ndarray of shape (K, M, C)
        Share that leaves by the far face, without what passed unscattered.
    back : ndarray of shape (M, C)
        Share that an infinitely thick slab sends back.
    """

    thickness_mm: Float
    cosine: Float
    through: Float
    back: Float


def diffuse_mean(cosine: Float, values: Float) -> Float:
    """Mean over light from everywhere, 2 int f(mu) mu dmu: exact for `values` (M, ...) linear between nodes."""
    left, right = cosine[:-1], cosine[1:]
    weight = np.zeros(len(cosine))
    weight[:-1] += (right - left) * (2 * left + right) / 3
    weight[1:] += (right - left) * (left + 2 * right) / 3
    return np.tensordot(weight, values, axes=1)


def slab_transport(medium: Medium, eta: float, thickness_mm: Float, g: float = 0.0) -> SlabTransport:
    """Solve transport in slabs of one medium.

    Parameters
    ----------
    medium : Medium
    eta : float
        Index inside over that of the outside, on both sides; >= 1.
    thickness_mm : ndarray of shape (K,)
        Ascending, above 0.
    g : float
        Henyey-Greenstein mean cosine; sigma_s = sigma_s' / (1 - g).

    Raises
    ------
    ValueError
        If eta is below 1 or the thicknesses do not ascend from above 0.

    References
    ----------
    [vandeHulst1980]
    """
    if not eta >= 1:
        raise ValueError(f"eta: expected a number >= 1, got {eta}")
    thickness_mm = np.asarray(thickness_mm, np.float64)
    if np.any(thickness_mm <= 0) or np.any(np.diff(thickness_mm) <= 0):
        raise ValueError("thickness_mm: expected ascending numbers above 0")
    outside = np.linspace(0, 1, COSINES)
    streams = _streams(eta, outside)
    through = np.empty((len(thickness_mm), COSINES, len(medium.albedo)))
    back = np.empty((COSINES, len(medium.albedo)))
    for c, (absorbed, reduced) in enumerate(zip(medium.sigma_a_per_mm, medium.sigma_sp_per_mm, strict=True)):
        scattered = reduced / (1 - g)
        extinction = absorbed + scattered
        depth, found, back[:, c] = _ladders(streams, scattered / extinction, g, extinction * thickness_mm)
        # Between the thicknesses in the logarithm of both, where transmittance is nearly straight
        logarithm = np.log(np.maximum(found, 1e-300))
        through[:, :, c] = np.exp(monotone_cubic(np.log(depth), logarithm, np.log(extinction * thickness_mm)))
    return SlabTransport(thickness_mm, outside, through, back)


class _Streams(NamedTuple):
    """Directions in a slab: those of quadrature, then those of the beams, which weigh nothing.

    Attributes
    ----------
    mu, weight : ndarrays of shape (n,)
        Cosines inside and weights of an integral over them from 0 to 1.
    reflected : ndarray of shape (n,)
        By a face, from inside.
    """

    mu: Float
    weight: Float
    reflected: Float


def _streams(eta: float, outside: Float) -> _Streams:
    """Gauss-Legendre on either side of the critical angle, and the refracted beams."""
    node, weight = np.polynomial.legendre.leggauss(GAUSS)
    critical = np.sqrt(1 - 1 / eta**2)
    parts = [(0.0, critical), (critical, 1.0)] if eta > 1 else [(0.0, 0.5), (0.5, 1.0)]
    mu = np.concatenate([(a + b) / 2 + (b - a) / 2 * node for a, b in parts])
    weight = np.concatenate([(b - a) / 2 * weight for a, b in parts])
    beams = np.sqrt(1 - (1 - np.maximum(outside, SMALLEST_COSINE) ** 2) / eta**2)
    mu = np.concatenate([mu, beams])
    return _Streams(mu, np.concatenate([weight, np.zeros(len(beams))]), reflectance_from_inside(eta, mu))


def _phase(mu: Float, g: float) -> tuple[Float, Float]:
    """Henyey-Greenstein, averaged over the azimuth, from direction j to i: into the same half and into the other."""
    orders = 2 * GAUSS if g > 0 else 1
    polynomial = np.polynomial.legendre.legvander(mu, orders - 1)
    degree = np.arange(orders)
    moment = (2 * degree + 1) * g**degree
    same = (polynomial * moment) @ polynomial.T
    return same, (polynomial * moment * (-1.0) ** degree) @ polynomial.T


def _ladders(streams: _Streams, albedo: float, g: float, wanted: Float) -> tuple[Float, Float, Float]:
    """Optical depths (J,) around the wanted ones, what comes through at each (J, COSINES), and R of a half-space."""
    found: dict[float, NDArray[np.float64]] = {}
    back = np.zeros(COSINES)
    first = np.log2(wanted[0] / THINNEST) - 1  # doublings after which slabs are wanted
    last = np.log2(wanted[-1] / THINNEST)
    for ladder in range(LADDERS):
        depth = THINNEST * 2 ** (ladder / LADDERS)
        reflect, transmit = _thin(streams, albedo, g, depth)
        for doubling in range(MOST_DOUBLINGS):
            if doubling >= first:
                through, sent_back = _with_faces(streams, reflect, transmit)
                found[depth] = through[-COSINES:]
                back = sent_back[-COSINES:] if ladder == 0 else back
            if doubling > last + 1 and (ladder > 0 or found[depth].max() < VANISHED):
                break
            inner = np.linalg.solve(np.eye(len(reflect)) - reflect @ reflect, transmit)
            reflect, transmit = reflect + transmit @ reflect @ inner, transmit @ inner
            depth *= 2
    order = np.array(sorted(found))
    return order, np.array([found[depth] for depth in order]), back


def _thin(streams: _Streams, albedo: float, g: float, depth: float) -> tuple[Float, Float]:
    """Reflection and transmission of radiance by a layer of a hundred-thousandth of a free path, to second order."""
    same, other = _phase(streams.mu, g)
    scale = depth / (4 * streams.mu[:, None])
    kept = 2 * np.diag(np.ones(len(streams.mu))) - albedo * same * streams.weight
    lost, turned = scale * kept, scale * albedo * other * streams.weight
    unit = np.eye(len(streams.mu))
    once = np.linalg.solve(unit + lost, turned)
    gain = np.linalg.inv(unit + lost - turned @ once)
    return 2 * gain @ turned @ np.linalg.inv(unit + lost), 2 * gain - unit


def _with_faces(streams: _Streams, reflect: Float, transmit: Float) -> tuple[Float, Float]:
    """What leaves by the far face, scattered, and by the near one, of each beam that entered; both (n,).

    By reciprocity that is the radiance that comes to the faces along each beam when light enters along all directions
    of the quadrature by what the faces let out of them. Beams have no weight, so that none of it is unscattered.
    """
    face, unit = streams.reflected, np.eye(len(streams.mu))
    entering = (1 - face) * (streams.weight > 0)
    # down = entering + face up, up = R down + T face far, far = T down + R face far
    to_far = np.linalg.solve(unit - reflect * face, transmit)
    to_near = reflect + (transmit * face) @ to_far
    down = np.linalg.solve(unit - face[:, None] * to_near, entering)
    return to_far @ down, to_near @ down
