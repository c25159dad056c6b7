"""Random walks from points of the skin, against the way that light goes: the light that leaves there, compiled.

A walk enters the skin at x against a direction of leaving light, flies exponentially distributed lengths and turns at
each end. There the lights are looked for: what of them gets to that place, times the phase function, is what the walk
brings. One walk serves three channels, R, G and B or three wavelengths: it is drawn by one channel's free paths and
counted for all with the balance heuristic over the three [Veach1995].

Where the medium varies, lengths are drawn for the greatest extinction that there may be, and an end counts as one with
the probability of the extinction there over the greatest, else the walk flies on [Woodcock1965]. In the lowest of
several layers that is the greatest of this layer, as far as the walk cannot have left it.
"""

from __future__ import annotations

import math

import numpy as np

from skinbake.irradiance.embree import ray_buffer
from skinbake.kernels.compile import kernel
from skinbake.profile.photons import GOLDEN, VERTICAL, fresnel, mixed, uniform
from skinbake.transport.depth import depth_at
from skinbake.transport.skin_grid import value_at
from skinbake.transport.straight_line import fly
from skinbake.transport.walk_face import at_face
from skinbake.transport.walk_light import RECTANGLE, SKY, InsideSkin, look_for
from skinbake.transport.walk_medium import (
    BANDS,
    BELOW,
    EVERYWHERE,
    GOLDEN_RATIO,
    choose_bands,
    empty_bands,
    layer_at,
    pigment_at,
)
from skinbake.transport.walk_scene import HARD, THROUGH, WHOLE, Place, Tally, WalkScene

MAX_EVENTS = 20_000
ROULETTE_BELOW = 0.1  # of the weight that a walk began with
LATTICE = 0.8191725133961645, 0.6710436067037893, 0.5497004779019703  # R3 sequence [Roberts2018]


@kernel(inner=True)
def _turned(ux, uy, uz, cosine, azimuth):  # type: ignore[no-untyped-def]
    """Unit direction at an angle to another."""
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    c, s = sine * math.cos(azimuth), sine * math.sin(azimuth)
    if abs(uz) > VERTICAL:
        return c, s, math.copysign(cosine, cosine * uz)
    across = math.sqrt(1.0 - uz * uz)
    vx = (ux * uz * c - uy * s) / across + ux * cosine
    vy = (uy * uz * c + ux * s) / across + uy * cosine
    vz = -c * across + uz * cosine
    scale = 1.5 - 0.5 * (vx * vx + vy * vy + vz * vz)
    return vx * scale, vy * scale, vz * scale


@kernel(inner=True)
def _phase(g, cosine):  # type: ignore[no-untyped-def]
    """Henyey-Greenstein, per steradian."""
    if g == 0.0:
        return 0.25 / math.pi
    d = 1.0 + g * g - 2.0 * g * cosine
    return 0.25 / math.pi * (1.0 - g * g) / (d * math.sqrt(d))


@kernel(inner=True)
def _add(tally, estimate, light, band, value):  # type: ignore[no-untyped-def]
    """Count what a band brings in R, G and B."""
    for c in range(3):
        tally.out[estimate, light, c] += tally.mix[c, band] * value


@kernel(inner=True)
def _look_around(scene, tally, place, layer, weight, first_stay, state):  # type: ignore[no-untyped-def]
    """Count what every light but a sky sends to a place where the walk has turned; gives the state of the numbers.

    Parameters
    ----------
    scene : WalkScene
    tally : Tally, written
    place : Place
    layer : int
    weight : ndarray of shape (3,)
    first_stay : bool
        Whether the walk has never left the skin.
    state : uint64
    """
    lights, tau = scene.lights, tally.tau
    here = InsideSkin(place.at, place.normal, place.depth)
    dx, dy, dz = place.direction
    for light in range(len(lights.kind)):
        if lights.kind[light] == SKY:
            continue
        u, v = 0.5, 0.5
        if lights.kind[light] == RECTANGLE:
            state += GOLDEN
            u = uniform(mixed(state))
            state += GOLDEN
            v = uniform(mixed(state))
        sent, ux, uy, uz, blocked, passes = look_for(scene, light, here, (u, v), tau)
        if sent <= 0.0:
            continue
        sent *= _phase(scene.medium.g[layer], ux * dx + uy * dy + uz * dz)
        for c in range(BANDS):
            brings = sent * weight[c] * math.exp(-tau[0, c])
            through = brings * passes * math.exp(-tau[1, c])
            _add(tally, WHOLE, light, c, through)
            if first_stay:
                _add(tally, THROUGH, light, c, through)
                if not blocked:
                    _add(tally, HARD, light, c, brings)
    return state


@kernel
def walk_from(rays, medium, lights, seed, walks, point, out):  # type: ignore[no-untyped-def]
    """Light that leaves at a point of the skin, by `walks` walks for each channel's free paths.

    Parameters
    ----------
    rays : RayScene
    medium : WalkMedium
    lights : WalkLights
    seed : uint64
        The same seed gives the same result, whatever runs beside it.
    walks : int
        A channel.
    point : SkinPoint
    out : ndarray of shape (3, L, 3), written
        Radiant exitance by estimate, light and channel. `HARD`: the walk ends where it first leaves the skin, and a
        light that other skin hides is not seen; `THROUGH`: a light also shines through other skin, unscattered;
        `WHOLE`: walks enter again, all of transport.

    References
    ----------
    [Veach1995], [Wang1995], [Woodcock1965]
    """
    buffer = ray_buffer()
    px, py, pz = point.at
    nx, ny, nz = point.normal
    out[:] = 0.0
    eta, layers = medium.eta, len(medium.g)
    bands, mix = empty_bands(medium)
    if not medium.spectral:
        choose_bands(medium, 0.0, bands, mix)
    has_sky = False
    for light in range(len(lights.kind)):
        has_sky = has_sky or lights.kind[light] == SKY
    state = mixed(seed + GOLDEN)
    state += GOLDEN
    shift_0 = uniform(mixed(state))
    state += GOLDEN
    shift_1 = uniform(mixed(state))
    state += GOLDEN
    shift_2 = uniform(mixed(state))
    shift_3 = uniform(mixed(seed + state))
    weight, density = np.empty(BANDS), np.empty(BANDS)
    scene, tally = WalkScene(rays, buffer, medium, bands, lights), Tally(out, mix, np.empty((2, BANDS)))
    px, py, pz = px - rays.step_mm * nx, py - rays.step_mm * ny, pz - rays.step_mm * nz

    for n in range(walks):
        if medium.spectral:
            choose_bands(medium, (shift_3 + n * GOLDEN_RATIO) % 1.0, bands, mix)
        for drawn_by in range(BANDS):
            # First direction and first length from a lattice: every third of the skin below is looked at alike
            number = n + drawn_by / 3.0
            u0, u1 = (shift_0 + number * LATTICE[0]) % 1.0, (shift_1 + number * LATTICE[1]) % 1.0
            u2 = min(max((shift_2 + number * LATTICE[2]) % 1.0, 1e-16), 1.0 - 1e-16)
            mu = math.sqrt(u0)
            entered = 1.0
            if eta > 1.0:
                reflected, cos_in = fresnel(1.0, eta, mu)
                entered = (1.0 - reflected) / (eta * eta)
                mu = cos_in
            begins = _turned(-nx, -ny, -nz, mu, 2.0 * math.pi * u1)
            place = Place((px, py, pz), begins, (nx, ny, nz), 1)
            for c in range(BANDS):
                weight[c] = entered * math.pi / 3.0
                density[c] = 1.0 / 3.0
            begun = entered * math.pi
            paths = -math.log(u2)  # that are left to fly, free ones of the channel that draws
            collisions, left = 0, 0
            deep, clear = 0.0, 0.0  # below the surface, and from any face; lower bounds where they are large

            for _ in range(MAX_EVENTS):
                # How far until something may be met, and whether the surface comes first
                zone, valid = EVERYWHERE, np.inf
                if layers > 1 and deep - medium.outer_mm > medium.fine_mm:
                    zone, valid = BELOW, deep - medium.outer_mm
                length = paths / bands.most[zone, drawn_by]
                ends = length <= valid
                length = min(length, valid)
                f, b1, b2 = -1, 0.0, 0.0
                (x, y, z), (dx, dy, dz) = place.at, place.direction
                if length < clear - rays.step_mm:
                    way, depth = length, place.depth
                else:
                    way, f, b1, b2, depth = fly(rays, buffer, place.at, place.direction, place.depth, length)
                x, y, z = x + way * dx, y + way * dy, z + way * dz
                ends = ends and f < 0

                # What is there, and whether the walk meets it
                layer, factor, pigment, meets = 0, 1.0, 0.0, ends
                if f < 0 and not medium.uniform:
                    if medium.density >= 0:
                        factor = value_at(medium.grid, medium.density, x, y, z)
                    if layers > 1:
                        deep, clear = depth_at(medium.depth, rays, x, y, z)
                        layer = layer_at(medium, deep * factor)
                    if ends:
                        pigment = pigment_at(medium, layer, x, y, z)
                    if ends and medium.ranges:
                        extinction = bands.sigma_t[layer, drawn_by] + pigment * bands.pigment[layer, drawn_by]
                        state += GOLDEN
                        meets = bands.most[zone, drawn_by] * uniform(mixed(state)) < factor * extinction
                # Balance heuristic over the channels whose free paths could have led here
                total = 0.0
                for c in range(BANDS):
                    passed = math.exp(-bands.most[zone, c] * way)
                    if ends:
                        extinction = factor * (bands.sigma_t[layer, c] + pigment * bands.pigment[layer, c])
                        if meets:
                            weight[c] *= factor * bands.sigma_s[layer, c] / extinction
                            passed *= extinction
                        else:
                            passed *= max(bands.most[zone, c] - extinction, 0.0)
                    weight[c] *= passed
                    density[c] *= passed
                    total += density[c]
                if not total > 0.0:
                    break
                for c in range(BANDS):
                    weight[c] /= total
                    density[c] /= total

                if f >= 0:
                    counts = collisions, left, has_sky
                    here = Place((x, y, z), place.direction, place.normal, depth)
                    place, gain, goes_out, state = at_face(scene, tally, here, (f, b1, b2), weight, counts, state)
                    if gain == 0.0:
                        break
                    if goes_out:
                        left += 1
                    for c in range(BANDS):
                        weight[c] *= gain
                    deep, clear = 0.0, 0.0
                elif meets:
                    collisions += 1
                    here = Place((x, y, z), place.direction, place.normal, depth)
                    state = _look_around(scene, tally, here, layer, weight, left == 0, state)
                    state += GOLDEN
                    t = uniform(mixed(state))
                    g = medium.g[layer]
                    if g == 0.0:
                        cosine = 2.0 * t - 1.0
                    else:
                        part = (1.0 - g * g) / (1.0 - g + 2.0 * g * t)
                        cosine = min(1.0, max(-1.0, (1.0 + g * g - part * part) / (2.0 * g)))
                    state += GOLDEN
                    turned = _turned(dx, dy, dz, cosine, 2.0 * math.pi * uniform(mixed(state)))
                    place = Place((x, y, z), turned, place.normal, depth)
                else:
                    place = Place((x, y, z), place.direction, place.normal, depth)

                # A walk that hardly counts any more goes on with a chance that keeps the mean
                left_over = max(weight[0], weight[1], weight[2]) / begun
                if left_over < ROULETTE_BELOW / 3.0:
                    keep = left_over / (ROULETTE_BELOW / 3.0)
                    state += GOLDEN
                    if uniform(mixed(state)) >= keep:
                        break
                    for c in range(BANDS):
                        weight[c] /= keep
                if not ends and f < 0:
                    paths -= bands.most[zone, drawn_by] * way
                else:
                    state += GOLDEN
                    paths = -math.log(uniform(mixed(state)))
    out /= walks
