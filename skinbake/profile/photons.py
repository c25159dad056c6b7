"""Inner loop of transport: photon packets through layers, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skinbake.kernels.compile import kernel
from skinbake.numerics import Float

ROULETTE_BELOW = 1e-3
ROULETTE_SURVIVAL = 0.1
VERTICAL = 1 - 1e-12  # above this |u_z| the rotation of a direction needs its own branch
MAX_EVENTS = (
    1_000_000  # without absorption a walk in a half-space has no mean length; what is left then is counted as lost
)

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


class WalkLayers(NamedTuple):
    """Layers as the kernels take them.

    Attributes
    ----------
    face : ndarray of shape (L + 1,)
        Depths of the faces, mm; the last may be infinite.
    sigma_t, albedo, g : ndarrays of shape (L,)
        Of each layer: extinction 1/mm, single-scattering albedo, Henyey-Greenstein mean cosine.
    """

    face: Float
    sigma_t: Float
    albedo: Float
    g: Float


class Annuli(NamedTuple):
    """Where what leaves is counted: a disc of radius exp(`log_first`) mm, then annuli about it.

    Attributes
    ----------
    log_first, per_log : float
        The disc, and annuli an e-fold.
    bins : int
        In all; the last one holds all beyond.
    """

    log_first: float
    per_log: float
    bins: int


@kernel(inline=True)
def mixed(state):  # type: ignore[no-untyped-def]
    """Random 64 bits from a counter: the output function of splitmix64 [Steele2014]."""
    z = (state ^ (state >> _S30)) * _MIX_1
    z = (z ^ (z >> _S27)) * _MIX_2
    return z ^ (z >> _S31)


@kernel(inline=True)
def uniform(bits):  # type: ignore[no-untyped-def]
    """Number inside (0, 1) from 64 random bits; 0 and 1 never occur, so a logarithm is always finite."""
    return (np.float64(bits >> _S11) + 0.5) * (1.0 / 9007199254740992.0)


@kernel(inline=True)
def fresnel(n_from, n_to, cos_from):  # type: ignore[no-untyped-def]
    """Unpolarised Fresnel reflectance, and the cosine beyond the face (0 at total reflection).

    Parameters
    ----------
    n_from, n_to : float
        Refractive indices before and behind the face.
    cos_from : float
        Cosine of the direction to the face's normal, >= 0.
    """
    if n_from == n_to:
        return 0.0, cos_from
    # Snell's law gives the direction beyond, Fresnel's equations each polarisation
    ratio = n_from / n_to
    sin2 = ratio * ratio * (1.0 - cos_from * cos_from)
    if sin2 >= 1.0:
        return 1.0, 0.0
    cos_to = math.sqrt(1.0 - sin2)
    s = (n_from * cos_from - n_to * cos_to) / (n_from * cos_from + n_to * cos_to)
    p = (n_from * cos_to - n_to * cos_from) / (n_from * cos_to + n_to * cos_from)
    return 0.5 * (s * s + p * p), cos_to


@kernel
def trace(seed, photons, layers, index, annuli, diffuse):  # type: ignore[no-untyped-def]
    """Sums of the weights, and of their squares, that leave through each annulus; theory.md 9.1.

    Parameters
    ----------
    seed : uint64
    photons : int
        Packets of weight 1 that have already entered the top face at the origin.
    layers : WalkLayers
    index : ndarray of shape (L + 2,)
        Refractive indices, with the outside above and below.
    annuli : Annuli
    diffuse : bool
        Entered from all directions, as light of a constant sky; else along the normal.

    Returns
    -------
    tally : ndarray of shape (2, 2, bins)
        [above or below, sum w or sum w^2, annulus].
    other : ndarray of shape (2,)
        Weight that left below without scattering, weight lost to the limit of events.

    References
    ----------
    [Wang1995]
    """
    face, sigma_t, albedo, g = layers.face, layers.sigma_t, layers.albedo, layers.g
    bins = annuli.bins
    tally = np.zeros((2, 2, bins))
    other = np.zeros(2)
    count = len(sigma_t)
    state = mixed(seed + GOLDEN)
    for _ in range(photons):
        x, y, z = 0.0, 0.0, 0.0
        ux, uy, uz = 0.0, 0.0, 1.0
        if diffuse:
            # Flux arrives cosine distributed; what the face reflects has not entered
            while True:
                state += GOLDEN
                reflected, uz = fresnel(index[0], index[1], math.sqrt(uniform(mixed(state))))
                state += GOLDEN
                if reflected == 0.0 or uniform(mixed(state)) >= reflected:
                    break
            ux = math.sqrt(max(0.0, 1.0 - uz * uz))  # annuli do not know the azimuth
        weight = 1.0
        layer = 0
        events = 0
        leaves = -1
        while weight > 0.0:
            # Optical depth to the next event, spent across as many layers as it lasts
            state += GOLDEN
            depth = -math.log(uniform(mixed(state)))
            while True:
                if uz > 0.0:
                    distance = (face[layer + 1] - z) / uz
                elif uz < 0.0:
                    distance = (face[layer] - z) / uz
                else:
                    distance = np.inf
                if distance * sigma_t[layer] > depth:
                    step = depth / sigma_t[layer]
                    x += ux * step
                    y += uy * step
                    z += uz * step
                    break
                x += ux * distance
                y += uy * distance
                depth -= distance * sigma_t[layer]
                # At a face: reflected by chance F, else refracted by Snell's law
                down = uz > 0.0
                z = face[layer + 1] if down else face[layer]
                beyond = layer + 1 if down else layer - 1
                reflected, cos_to = fresnel(index[layer + 1], index[beyond + 1], abs(uz))
                state += GOLDEN
                if reflected > 0.0 and uniform(mixed(state)) < reflected:
                    uz = -uz
                    continue
                if beyond < 0 or beyond == count:
                    leaves = 1 if down else 0
                    break
                ratio = index[layer + 1] / index[beyond + 1]
                ux *= ratio
                uy *= ratio
                uz = cos_to if down else -cos_to
                layer = beyond
            if leaves >= 0:
                break

            # Absorb a part, then scatter
            weight *= albedo[layer]
            events += 1
            if events >= MAX_EVENTS:
                other[1] += weight
                weight = 0.0
                break
            if weight < ROULETTE_BELOW:
                state += GOLDEN
                weight = weight / ROULETTE_SURVIVAL if uniform(mixed(state)) < ROULETTE_SURVIVAL else 0.0
            state += GOLDEN
            u = uniform(mixed(state))
            # Polar angle of Henyey and Greenstein's phase function, azimuth even
            mean = g[layer]
            if mean == 0.0:
                cos_theta = 2.0 * u - 1.0
            else:
                part = (1.0 - mean * mean) / (1.0 - mean + 2.0 * mean * u)
                cos_theta = min(1.0, max(-1.0, (1.0 + mean * mean - part * part) / (2.0 * mean)))
            sin_theta = math.sqrt(1.0 - cos_theta * cos_theta)
            state += GOLDEN
            phi = 2.0 * math.pi * uniform(mixed(state))
            cos_phi, sin_phi = math.cos(phi), math.sin(phi)
            # Turn the direction by both angles; along the normal the general form is 0/0
            if abs(uz) > VERTICAL:
                ux, uy, uz = sin_theta * cos_phi, sin_theta * sin_phi, math.copysign(cos_theta, cos_theta * uz)
            else:
                across = math.sqrt(1.0 - uz * uz)
                vx = sin_theta * (ux * uz * cos_phi - uy * sin_phi) / across + ux * cos_theta
                vy = sin_theta * (uy * uz * cos_phi + ux * sin_phi) / across + uy * cos_theta
                uz = -sin_theta * cos_phi * across + uz * cos_theta
                ux, uy = vx, vy
                # Keep the direction a unit vector over a million turns
                scale = 1.5 - 0.5 * (ux * ux + uy * uy + uz * uz)
                ux *= scale
                uy *= scale
                uz *= scale

        if leaves >= 0:
            # Score what leaves into the annulus of its radius
            if leaves == 1 and events == 0:
                other[0] += weight
            radius = math.sqrt(x * x + y * y)
            k = 0
            if radius > 0.0:
                k = max(0, min(bins - 1, math.floor((math.log(radius) - annuli.log_first) * annuli.per_log) + 1))
            tally[leaves, 0, k] += weight
            tally[leaves, 1, k] += weight * weight
    return tally, other
