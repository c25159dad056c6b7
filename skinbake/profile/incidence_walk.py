"""Inner loop of the incidence table: walks in a stack of layers, against the way that light goes, compiled."""

from __future__ import annotations

import math

import numpy as np

from skinbake.kernels.compile import kernel
from skinbake.profile.photons import GOLDEN, VERTICAL, fresnel, mixed, uniform

ROULETTE_BELOW = 0.02
MAX_EVENTS = 100_000
LATTICE = 0.7548776662466927, 0.5698402909980532  # R2 sequence [Roberts2018]


@kernel
def reflect_beams(seed, walks, medium, eta, cos_inside, out):  # type: ignore[no-untyped-def]
    """Share of the light that entered a stack under each of K slants and leaves it above.

    A walk begins with a cosine-distributed direction of leaving light; at each of its collisions all beams are looked
    for, so that one set of walks serves every slant and the noise of their ratios is small.

    Parameters
    ----------
    seed : uint64
    walks : int
    medium : WalkLayers
    eta : float
        Index of all layers over that of the outside.
    cos_inside : ndarray of shape (K,)
        Cosines of the beams once they have entered.
    out : ndarray of shape (K,), written

    References
    ----------
    [Wang1995]
    """
    out[:] = 0.0
    face, sigma_t, albedo, g = medium.face, medium.sigma_t, medium.albedo, medium.g
    layers = len(sigma_t)
    above = np.zeros(layers)  # optical depth of each layer's upper face
    for k in range(1, layers):
        above[k] = above[k - 1] + (face[k] - face[k - 1]) * sigma_t[k - 1]
    state = mixed(seed + GOLDEN)
    state += GOLDEN
    shift_0 = uniform(mixed(state))
    state += GOLDEN
    shift_1 = uniform(mixed(state))
    sin_inside = np.sqrt(1.0 - cos_inside * cos_inside)
    for n in range(walks):
        # Direction and first length from a lattice
        mu = math.sqrt((shift_0 + n * LATTICE[0]) % 1.0)
        depth = -math.log(min(max((shift_1 + n * LATTICE[1]) % 1.0, 1e-16), 1.0 - 1e-16))
        back, cos_in = fresnel(1.0, eta, mu)
        weight = math.pi * (1.0 - back) / (eta * eta)
        begun = weight
        uz = cos_in
        ux = math.sqrt(max(0.0, 1.0 - uz * uz))  # the azimuth is the beams' that is turned below
        state += GOLDEN
        turn = 2.0 * math.pi * uniform(mixed(state))
        ux, uy = ux * math.cos(turn), ux * math.sin(turn)
        z, layer = 0.0, 0
        for _ in range(MAX_EVENTS):
            leaves = False
            while True:
                if uz > 0.0:
                    distance = (face[layer + 1] - z) / uz
                elif uz < 0.0:
                    distance = (face[layer] - z) / uz
                else:
                    distance = np.inf
                if distance * sigma_t[layer] > depth:
                    z += uz * depth / sigma_t[layer]
                    break
                depth -= distance * sigma_t[layer]
                down = uz > 0.0
                z = face[layer + 1] if down else face[layer]
                if (down and layer + 1 == layers) or (not down and layer == 0):
                    back, _ = fresnel(eta, 1.0, abs(uz))
                    state += GOLDEN
                    if back == 0.0 or uniform(mixed(state)) >= back:
                        leaves = True
                        break
                    uz = -uz
                else:
                    layer += 1 if down else -1
            if leaves:
                break

            # All beams, attenuated down to here; a beam of unit entered flux is 1 / cos wide across
            weight *= albedo[layer]
            mean = g[layer]
            tau = above[layer] + (z - face[layer]) * sigma_t[layer]
            for k in range(len(out)):
                if mean == 0.0:
                    phase = 0.25 / math.pi
                else:
                    d = 1.0 + mean * mean - 2.0 * mean * (ux * sin_inside[k] - uz * cos_inside[k])
                    phase = 0.25 / math.pi * (1.0 - mean * mean) / (d * math.sqrt(d))
                out[k] += weight * phase * math.exp(-tau / cos_inside[k]) / cos_inside[k]

            if weight < ROULETTE_BELOW * begun:
                keep = weight / (ROULETTE_BELOW * begun)
                state += GOLDEN
                if uniform(mixed(state)) >= keep:
                    break
                weight /= keep
            state += GOLDEN
            u = uniform(mixed(state))
            if mean == 0.0:
                cosine = 2.0 * u - 1.0
            else:
                part = (1.0 - mean * mean) / (1.0 - mean + 2.0 * mean * u)
                cosine = min(1.0, max(-1.0, (1.0 + mean * mean - part * part) / (2.0 * mean)))
            sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
            state += GOLDEN
            turn = 2.0 * math.pi * uniform(mixed(state))
            c, s = sine * math.cos(turn), sine * math.sin(turn)
            if abs(uz) > VERTICAL:
                ux, uy, uz = c, s, math.copysign(cosine, cosine * uz)
            else:
                across = math.sqrt(1.0 - uz * uz)
                vx = (ux * uz * c - uy * s) / across + ux * cosine
                vy = (uy * uz * c + ux * s) / across + uy * cosine
                uz = -c * across + uz * cosine
                scale = 1.5 - 0.5 * (vx * vx + vy * vy + uz * uz)
                ux, uy, uz = vx * scale, vy * scale, uz * scale
            state += GOLDEN
            depth = -math.log(uniform(mixed(state)))
    out /= walks
