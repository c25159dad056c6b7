"""Random walks from points of the skin, against the way that light goes: the light that leaves there, compiled.

A walk enters the skin at x against a direction of leaving light, flies exponentially distributed lengths and turns at
each end. There the lights are looked for: what of them gets to that place, times the phase function, is what the walk
brings. One walk serves the three channels: it is drawn by one channel's free paths and counted for all with the
balance heuristic over the three [Veach1995].

Where the medium's density varies, lengths are drawn for the greatest one, and an end counts as one with the probability
of the density there over the greatest, else the walk flies on [Woodcock1965]; that is the same for all channels.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.punctual_light import towards
from skinbake.kernels.compile import kernel
from skinbake.numerics import Float
from skinbake.profile.photons import GOLDEN, VERTICAL, fresnel, mixed, uniform
from skinbake.transport.density import DensityGrid, density_at, least_dense, most_dense, thickness
from skinbake.transport.surface_rays import first_hit, ray_buffer

HARD, THROUGH, WHOLE = 0, 1, 2  # estimates; see `walk_from`
PUNCTUAL, RECTANGLE, SKY = 0, 1, 2  # kinds of light
MAX_EVENTS = 20_000
MAX_CROSSINGS = 64  # of one straight line with the surface
ROULETTE_BELOW = 0.1  # of the weight that a walk began with
FAINT = 16.0  # optical depths, beyond which no light is looked for: exp(-16) = 1e-7
SNELL_STEPS = 4
LATTICE = 0.8191725133961645, 0.6710436067037893, 0.5497004779019703  # R3 sequence [Roberts2018]


class WalkMedium(NamedTuple):
    """A medium as the kernels take it: homogeneous, or as dense from place to place as a grid says.

    Attributes
    ----------
    sigma_t_per_mm, albedo : ndarrays of shape (3,)
        Extinction and single-scattering albedo.
    g : float
        Henyey-Greenstein mean cosine.
    eta : float
        Index inside over index outside, >= 1.
    density : DensityGrid or None
        Factor on `sigma_t_per_mm`.
    """

    sigma_t_per_mm: Float
    albedo: Float
    g: float
    eta: float
    density: DensityGrid | None = None


class WalkLights(NamedTuple):
    """Lights as the kernels take them, each of unit irradiance, intensity or radiance; skies hold their own.

    Attributes
    ----------
    kind : ndarray of shape (L,), int64
    source : ndarray of shape (L, 10)
        Of `emitter` for directional, point and spot lights, about the rays' centre; a rectangle's centre and edges.
    casts : ndarray of shape (L,), bool
    sky : ndarray of shape (L, h, w, 3), float32
        Radiance maps, all of one size; zero for lights that are no sky.
    rotate : ndarray of shape (L,)
        Radians by which each map is turned.
    share : ndarray of shape (n,)
        Share of arriving light that enters, at cosines 0, 1/(n-1), ... 1.
    """

    kind: NDArray[np.int64]
    source: Float
    casts: NDArray[np.bool_]
    sky: NDArray[np.float32]
    rotate: Float
    share: Float


class SkinPoint(NamedTuple):
    """A point of the skin.

    Attributes
    ----------
    at, normal : tuples of three floats
        Position, mm about the rays' centre, and unit normal.
    """

    at: tuple[float, float, float]
    normal: tuple[float, float, float]


class InsideSkin(NamedTuple):
    """A place inside the skin.

    Attributes
    ----------
    at : tuple of three floats
        Position, mm about the rays' centre.
    normal : tuple of three floats
        Of skin nearby, to begin with where the face refracts.
    depth : int
        How many closed parts hold the place.
    """

    at: tuple[float, float, float]
    normal: tuple[float, float, float]
    depth: int


@kernel(inner=True)
def _share_at(share, cosine):  # type: ignore[no-untyped-def]
    """Share of arriving light that enters, linear between the table's cosines."""
    x = min(max(cosine, 0.0), 1.0) * (len(share) - 1)
    i = min(int(x), len(share) - 2)
    return share[i] + (x - i) * (share[i + 1] - share[i])


@kernel(inner=True)
def _normal_at(rays, f, b1, b2):  # type: ignore[no-untyped-def]
    """Unit normal of the smooth surface; the flat one's where the two disagree."""
    b0 = 1.0 - b1 - b2
    x = b0 * rays.corner_normal[f, 0, 0] + b1 * rays.corner_normal[f, 1, 0] + b2 * rays.corner_normal[f, 2, 0]
    y = b0 * rays.corner_normal[f, 0, 1] + b1 * rays.corner_normal[f, 1, 1] + b2 * rays.corner_normal[f, 2, 1]
    z = b0 * rays.corner_normal[f, 0, 2] + b1 * rays.corner_normal[f, 1, 2] + b2 * rays.corner_normal[f, 2, 2]
    length = math.sqrt(x * x + y * y + z * z)
    gx, gy, gz = rays.normal[f, 0], rays.normal[f, 1], rays.normal[f, 2]
    if x * gx + y * gy + z * gz <= 0.5 * length:
        return gx, gy, gz
    return x / length, y / length, z / length


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
def _fly(rays, buffer, at, direction, depth, reach):  # type: ignore[no-untyped-def]
    """Go straight until the skin ends or for `reach`.

    Where closed parts overlap, `depth` counts how many hold the place. Gives the distance, the triangle where the skin
    ends (-1: it did not), barycentrics 1 and 2 there, and the depth.
    """
    px, py, pz = at
    dx, dy, dz = direction
    t = 0.0
    for _ in range(MAX_CROSSINGS):
        place = px + t * dx, py + t * dy, pz + t * dz
        step, f, b1, b2 = first_hit(rays, buffer, place, direction, reach - t)
        if f < 0:
            return reach, -1, 0.0, 0.0, depth
        t += step
        if rays.normal[f, 0] * dx + rays.normal[f, 1] * dy + rays.normal[f, 2] * dz > 0.0:
            depth -= 1
            if depth <= 0:
                return t, f, b1, b2, 0
        else:
            depth += 1
        t += rays.step_mm
        if t >= reach:
            break
    return reach, -1, 0.0, 0.0, depth


@kernel(inner=True)
def _beyond(rays, buffer, density, at, direction, distance, optics):  # type: ignore[no-untyped-def]
    """From outside to a light: whether skin is in the way, its length in mm by density, and what passes its faces.

    The line goes straight on through skin, as through a plate.
    """
    eta, faint_mm = optics
    px, py, pz = at
    dx, dy, dz = direction
    t, inside, passes, depth, blocked = 0.0, 0.0, 1.0, 0, False
    for _ in range(MAX_CROSSINGS):
        place = px + t * dx, py + t * dy, pz + t * dz
        step, f, _b1, _b2 = first_hit(rays, buffer, place, direction, distance - t)
        if f < 0:
            break
        cosine = rays.normal[f, 0] * dx + rays.normal[f, 1] * dy + rays.normal[f, 2] * dz
        if depth > 0:
            inside += thickness(density, place, direction, step)
        t += step + rays.step_mm
        if cosine < 0.0:
            blocked = True
            depth += 1
        elif depth > 0:
            depth -= 1
        if eta > 1.0:
            passes *= 1.0 - fresnel(1.0, eta, abs(cosine))[0]
        if inside > faint_mm:
            return True, inside, 0.0
    return blocked, inside, passes


@kernel(inner=True)
def _focus(rays, f, normal, light, cosines, eta, way_mm):  # type: ignore[no-untyped-def]
    """How much a curved face concentrates a beam on its way of `way_mm` below it; 1 for a plane.

    The area of a pencil of rays, from the change of the refracted direction with the normal along the triangle's edges.

    Parameters
    ----------
    f : int
        Triangle that the beam enters.
    normal, light : tuples of three floats
        Of the face, and towards the light.
    cosines : tuple of two floats
        Of the beam to the normal, outside and inside.
    """
    nx, ny, nz = normal
    wx, wy, wz = light
    cos_out, cos_in = cosines
    a = np.empty((2, 3))  # displacements on the face
    b = np.empty((2, 3))  # where they are after the way
    ux, uy, uz = wx / eta, wy / eta, wz / eta
    turn = cos_in - cos_out / eta
    ux, uy, uz = ux + turn * nx, uy + turn * ny, uz + turn * nz
    for k in range(2):
        ex = rays.corner_mm[f, k + 1, 0] - rays.corner_mm[f, 0, 0]
        ey = rays.corner_mm[f, k + 1, 1] - rays.corner_mm[f, 0, 1]
        ez = rays.corner_mm[f, k + 1, 2] - rays.corner_mm[f, 0, 2]
        mx = rays.corner_normal[f, k + 1, 0] - rays.corner_normal[f, 0, 0]
        my = rays.corner_normal[f, k + 1, 1] - rays.corner_normal[f, 0, 1]
        mz = rays.corner_normal[f, k + 1, 2] - rays.corner_normal[f, 0, 2]
        d_out = mx * wx + my * wy + mz * wz
        d_turn = d_out * cos_out / (eta * eta * cos_in) - d_out / eta
        a[k, 0], a[k, 1], a[k, 2] = ex, ey, ez
        b[k, 0] = ex - way_mm * (turn * mx + d_turn * nx)
        b[k, 1] = ey - way_mm * (turn * my + d_turn * ny)
        b[k, 2] = ez - way_mm * (turn * mz + d_turn * nz)
    before = _across(a, ux, uy, uz)
    after = _across(b, ux, uy, uz)
    if before <= 0.0:
        return 1.0
    return min(max(before / max(after, 1e-12 * before), 0.25), 4.0)


@kernel(inner=True)
def _across(v, ux, uy, uz):  # type: ignore[no-untyped-def]
    """Area of two edges' parallelogram as seen along a direction."""
    return abs(
        (v[0, 1] * v[1, 2] - v[0, 2] * v[1, 1]) * ux
        + (v[0, 2] * v[1, 0] - v[0, 0] * v[1, 2]) * uy
        + (v[0, 0] * v[1, 1] - v[0, 1] * v[1, 0]) * uz
    )


@kernel(inner=True)
def _to_light(kind, source, px, py, pz, u, v):  # type: ignore[no-untyped-def]
    """Unit direction to a light or to a point (u, v) of it, distance, and irradiance on a plane that faces it."""
    if kind == PUNCTUAL:
        return towards(source, px, py, pz)
    nx = source[4] * source[8] - source[5] * source[7]
    ny = source[5] * source[6] - source[3] * source[8]
    nz = source[3] * source[7] - source[4] * source[6]
    x = source[0] + (u - 0.5) * source[3] + (v - 0.5) * source[6] - px
    y = source[1] + (u - 0.5) * source[4] + (v - 0.5) * source[7] - py
    z = source[2] + (u - 0.5) * source[5] + (v - 0.5) * source[8] - pz
    distance = max(math.sqrt(x * x + y * y + z * z), 1e-3)
    x, y, z = x / distance, y / distance, z / distance
    # The cross product of the edges is as long as the rectangle is large
    return x, y, z, distance, max(0.0, -(x * nx + y * ny + z * nz)) / (distance * distance)


@kernel(inner=True)
def _look_for(rays, buffer, lights, light, inside, optics, uv):  # type: ignore[no-untyped-def]
    """What a light sends to a place inside the skin.

    Parameters
    ----------
    lights : WalkLights
    light : int
    inside : InsideSkin
    optics : (float, float, DensityGrid or None)
        Index inside over index outside, the length in mm beyond which no light is looked for, and the medium's density.
    uv : tuple of two floats
        Place on a rectangle.

    Returns
    -------
    Irradiance on a plane that faces it before extinction (0: nothing comes), direction to where it comes from inside
    the skin, length of the way inside, whether other skin is in the way, length of that, both times the density, and
    what passes its faces.
    """
    kind, source, share = lights.kind[light], lights.source[light], lights.share
    px, py, pz = inside.at
    nx, ny, nz = inside.normal
    eta, faint_mm, density = optics
    u, v = uv
    depth = inside.depth
    wx, wy, wz, distance, sent = _to_light(kind, source, px, py, pz, u, v)
    nothing = 0.0, wx, wy, wz, 0.0, False, 0.0, 1.0
    if sent <= 0.0:
        return nothing
    ux, uy, uz, gain = wx, wy, wz, 1.0
    if eta == 1.0:
        way, f, b1, b2, _ = _fly(rays, buffer, inside.at, (wx, wy, wz), depth, min(distance, faint_mm))
        if f < 0 and way >= faint_mm:
            return nothing
        if f >= 0:
            gain = _share_at(share, wx * rays.normal[f, 0] + wy * rays.normal[f, 1] + wz * rays.normal[f, 2])
    else:
        # Where the beam enters so that it is bent towards here: by the normal where it would, until that stays
        for _ in range(SNELL_STEPS):
            cos_out = max(nx * wx + ny * wy + nz * wz, 0.0)
            cos_in = math.sqrt(1.0 - (1.0 - cos_out * cos_out) / (eta * eta))
            turn = cos_in - cos_out / eta
            ux, uy, uz = wx / eta + turn * nx, wy / eta + turn * ny, wz / eta + turn * nz
            length = math.sqrt(ux * ux + uy * uy + uz * uz)
            ux, uy, uz = ux / length, uy / length, uz / length
            way, f, b1, b2, _ = _fly(rays, buffer, inside.at, (ux, uy, uz), depth, faint_mm)
            if f < 0:
                return nothing
            mx, my, mz = _normal_at(rays, f, b1, b2)
            change = abs(mx - nx) + abs(my - ny) + abs(mz - nz)
            nx, ny, nz = mx, my, mz
            wx, wy, wz, distance, sent = _to_light(kind, source, px + way * ux, py + way * uy, pz + way * uz, u, v)
            if change < 1e-4:
                break
        cos_out = nx * wx + ny * wy + nz * wz
        if cos_out <= 0.0 or rays.normal[f, 0] * wx + rays.normal[f, 1] * wy + rays.normal[f, 2] * wz <= 0.0:
            return nothing
        cos_in = math.sqrt(1.0 - (1.0 - cos_out * cos_out) / (eta * eta))
        gain = _share_at(share, cos_out) * cos_out / cos_in
        gain *= _focus(rays, f, (nx, ny, nz), (wx, wy, wz), (cos_out, cos_in), eta, way)
        distance += way
    own = thickness(density, inside.at, (ux, uy, uz), way)
    if f < 0 or not lights.casts[light]:
        return sent * gain, ux, uy, uz, own, False, 0.0, 1.0
    qx = px + way * ux + rays.step_mm * rays.normal[f, 0]
    qy = py + way * uy + rays.step_mm * rays.normal[f, 1]
    qz = pz + way * uz + rays.step_mm * rays.normal[f, 2]
    left_mm = max(distance - way - rays.step_mm, 0.0)
    at, towards_it = (qx, qy, qz), (wx, wy, wz)
    blocked, other, passes = _beyond(rays, buffer, density, at, towards_it, left_mm, (eta, faint_mm))
    return sent * gain, ux, uy, uz, own, blocked, other, passes


@kernel(inner=True)
def _radiance(sky, rotate, x, y, z, channel):  # type: ignore[no-untyped-def]
    """Radiance of a sky from a direction, as `direction_of` lays its map out."""
    height, width = sky.shape[0], sky.shape[1]
    row = int(math.acos(min(max(y, -1.0), 1.0)) / math.pi * height)
    place = 0.5 - (math.atan2(x, z) - rotate) / (2.0 * math.pi)
    col = int((place - math.floor(place)) * width)
    return sky[min(row, height - 1), min(col, width - 1), channel]


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
    [Veach1995], [Wang1995]
    """
    buffer = ray_buffer()
    count = len(lights.kind)
    px, py, pz = point.at
    nx, ny, nz = point.normal
    out[:] = 0.0
    sigma_t, eta, g = medium.sigma_t_per_mm, medium.eta, medium.g
    most = most_dense(medium.density)  # free paths are drawn for it
    faint_mm = FAINT / (min(sigma_t[0], sigma_t[1], sigma_t[2]) * least_dense(medium.density))
    has_sky = False
    for light in range(count):
        has_sky = has_sky or lights.kind[light] == SKY
    state = mixed(seed + GOLDEN)
    state += GOLDEN
    shift_0 = uniform(mixed(state))
    state += GOLDEN
    shift_1 = uniform(mixed(state))
    state += GOLDEN
    shift_2 = uniform(mixed(state))
    weight, density = np.empty(3), np.empty(3)
    px, py, pz = px - rays.step_mm * nx, py - rays.step_mm * ny, pz - rays.step_mm * nz

    for n in range(walks):
        for drawn_by in range(3):
            # First direction and first length from a lattice: every third of the skin below is looked at alike
            place = n + drawn_by / 3.0
            u0, u1 = (shift_0 + place * LATTICE[0]) % 1.0, (shift_1 + place * LATTICE[1]) % 1.0
            u2 = min(max((shift_2 + place * LATTICE[2]) % 1.0, 1e-16), 1.0 - 1e-16)
            mu = math.sqrt(u0)
            entered = 1.0
            if eta > 1.0:
                reflected, cos_in = fresnel(1.0, eta, mu)
                entered = (1.0 - reflected) / (eta * eta)
                mu = cos_in
            dx, dy, dz = _turned(-nx, -ny, -nz, mu, 2.0 * math.pi * u1)
            x, y, z = px, py, pz
            for c in range(3):
                weight[c] = entered * math.pi / 3.0
                density[c] = 1.0 / 3.0
            begun = entered * math.pi
            length = -math.log(u2) / (most * sigma_t[drawn_by])
            depth, collisions, left = 1, 0, 0
            hx, hy, hz = nx, ny, nz  # normal where the walk was last at the surface

            for _ in range(MAX_EVENTS):
                way, f, b1, b2, depth = _fly(rays, buffer, (x, y, z), (dx, dy, dz), depth, length)
                meets = f < 0
                if meets and most != least_dense(medium.density):
                    state += GOLDEN
                    dense = density_at(medium.density, x + way * dx, y + way * dy, z + way * dz)
                    meets = most * uniform(mixed(state)) < dense
                # Balance heuristic over the channels whose free paths could have led here
                total = 0.0
                for c in range(3):
                    passed = math.exp(-most * sigma_t[c] * way)
                    if f < 0:
                        passed *= sigma_t[c]
                    if meets:
                        weight[c] *= medium.albedo[c]
                    weight[c] *= passed
                    density[c] *= passed
                    total += density[c]
                if not total > 0.0:
                    break
                for c in range(3):
                    weight[c] /= total
                    density[c] /= total
                x, y, z = x + way * dx, y + way * dy, z + way * dz

                if meets:
                    collisions += 1
                    for light in range(count):
                        if lights.kind[light] == SKY:
                            continue
                        u, v = 0.5, 0.5
                        if lights.kind[light] == RECTANGLE:
                            state += GOLDEN
                            u = uniform(mixed(state))
                            state += GOLDEN
                            v = uniform(mixed(state))
                        here = InsideSkin((x, y, z), (hx, hy, hz), depth)
                        sent, ux, uy, uz, inside, blocked, other, passes = _look_for(
                            rays, buffer, lights, light, here, (eta, faint_mm, medium.density), (u, v)
                        )
                        if sent <= 0.0:
                            continue
                        sent *= _phase(g, ux * dx + uy * dy + uz * dz)
                        for c in range(3):
                            brings = sent * weight[c] * math.exp(-sigma_t[c] * inside)
                            through = brings * passes * math.exp(-sigma_t[c] * other)
                            out[WHOLE, light, c] += through
                            if left == 0:
                                out[THROUGH, light, c] += through
                                if not blocked:
                                    out[HARD, light, c] += brings
                    state += GOLDEN
                    t = uniform(mixed(state))
                    if g == 0.0:
                        cosine = 2.0 * t - 1.0
                    else:
                        part = (1.0 - g * g) / (1.0 - g + 2.0 * g * t)
                        cosine = min(1.0, max(-1.0, (1.0 + g * g - part * part) / (2.0 * g)))
                    state += GOLDEN
                    dx, dy, dz = _turned(dx, dy, dz, cosine, 2.0 * math.pi * uniform(mixed(state)))
                elif f >= 0:
                    # At the face from inside: what does not come back goes on outside, where a sky may be
                    ax, ay, az = rays.normal[f, 0], rays.normal[f, 1], rays.normal[f, 2]
                    ox, oy, oz, reflected = dx, dy, dz, 0.0
                    mx, my, mz = ax, ay, az
                    if eta > 1.0:
                        mx, my, mz = _normal_at(rays, f, b1, b2)
                        cos_in = mx * dx + my * dy + mz * dz
                        if cos_in <= 0.0:
                            mx, my, mz = ax, ay, az
                            cos_in = max(ax * dx + ay * dy + az * dz, 1e-9)
                        reflected, cos_out = fresnel(eta, 1.0, min(cos_in, 1.0))
                        if reflected < 1.0:
                            ox = eta * dx + (cos_out - eta * cos_in) * mx
                            oy = eta * dy + (cos_out - eta * cos_in) * my
                            oz = eta * dz + (cos_out - eta * cos_in) * mz
                            if ox * ax + oy * ay + oz * az <= 0.0:
                                reflected = 1.0
                        opened = eta * eta * _share_at(lights.share, cos_out)
                    else:
                        opened = _share_at(lights.share, ax * dx + ay * dy + az * dz)
                    state += GOLDEN
                    goes_out = reflected == 0.0 or uniform(mixed(state)) >= reflected
                    qx, qy, qz = x + rays.step_mm * ax, y + rays.step_mm * ay, z + rays.step_mm * az
                    if reflected < 1.0 and (goes_out or has_sky):
                        again, f, b1, b2 = first_hit(rays, buffer, (qx, qy, qz), (ox, oy, oz), np.inf)
                        if f < 0 and collisions > 0 and has_sky:
                            for light in range(count):
                                if lights.kind[light] == SKY:
                                    for c in range(3):
                                        brings = (
                                            weight[c]
                                            * opened
                                            * _radiance(lights.sky[light], lights.rotate[light], ox, oy, oz, c)
                                        )
                                        out[WHOLE, light, c] += brings
                                        if left == 0:
                                            out[THROUGH, light, c] += brings
                                            out[HARD, light, c] += brings
                    if goes_out:
                        if f < 0:
                            break
                        ax, ay, az = rays.normal[f, 0], rays.normal[f, 1], rays.normal[f, 2]
                        facing = -(ax * ox + ay * oy + az * oz)
                        if facing <= 0.0:
                            break
                        x, y, z = qx + again * ox, qy + again * oy, qz + again * oz
                        gain = opened / (1.0 - reflected)
                        dx, dy, dz = ox, oy, oz
                        if eta > 1.0:
                            mx, my, mz = _normal_at(rays, f, b1, b2)
                            cos_out = -(mx * ox + my * oy + mz * oz)
                            if cos_out <= 0.0:
                                mx, my, mz, cos_out = ax, ay, az, facing
                            back, cos_in = fresnel(1.0, eta, min(cos_out, 1.0))
                            gain *= (1.0 - back) / (eta * eta)
                            dx = ox / eta - (cos_in - cos_out / eta) * mx
                            dy = oy / eta - (cos_in - cos_out / eta) * my
                            dz = oz / eta - (cos_in - cos_out / eta) * mz
                            if dx * ax + dy * ay + dz * az >= 0.0:
                                break
                        hx, hy, hz = ax, ay, az
                        x, y, z = x - rays.step_mm * ax, y - rays.step_mm * ay, z - rays.step_mm * az
                        for c in range(3):
                            weight[c] *= gain
                        depth = 1
                        left += 1
                    else:
                        hx, hy, hz = ax, ay, az
                        along = dx * mx + dy * my + dz * mz
                        dx, dy, dz = dx - 2.0 * along * mx, dy - 2.0 * along * my, dz - 2.0 * along * mz
                        if dx * ax + dy * ay + dz * az >= 0.0:
                            break
                        x, y, z = x - rays.step_mm * ax, y - rays.step_mm * ay, z - rays.step_mm * az
                        depth = 1

                # A walk that hardly counts any more goes on with a chance that keeps the mean
                left_over = max(weight[0], weight[1], weight[2]) / begun
                if left_over < ROULETTE_BELOW / 3.0:
                    keep = left_over / (ROULETTE_BELOW / 3.0)
                    state += GOLDEN
                    if uniform(mixed(state)) >= keep:
                        break
                    for c in range(3):
                        weight[c] /= keep
                state += GOLDEN
                length = -math.log(uniform(mixed(state))) / (most * sigma_t[drawn_by])
    out /= walks
