"""What of a light gets to a place inside the skin, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from skinbake.irradiance.punctual_light import towards
from skinbake.kernels.compile import kernel
from skinbake.profile.photons import fresnel
from skinbake.transport.straight_line import MAX_CROSSINGS, fly, normal_at
from skinbake.transport.surface_rays import first_hit
from skinbake.transport.walk_medium import FAINT, add_optical_depth

PUNCTUAL, RECTANGLE, SKY = 0, 1, 2  # kinds of light
SNELL_STEPS = 4


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
def share_at(share, cosine):  # type: ignore[no-untyped-def]
    """Share of arriving light that enters, linear between the table's cosines."""
    x = min(max(cosine, 0.0), 1.0) * (len(share) - 1)
    i = min(int(x), len(share) - 2)
    return share[i] + (x - i) * (share[i + 1] - share[i])


@kernel(inner=True)
def _beyond(scene, line, distance, tau):  # type: ignore[no-untyped-def]
    """From outside to a light: whether skin is in the way, and what passes its faces; its optical depth goes to `tau`.

    The line goes straight on through skin, as through a plate.
    """
    rays, medium = scene.rays, scene.medium
    (px, py, pz), (dx, dy, dz) = line
    t, passes, depth, blocked = 0.0, 1.0, 0, False
    for _ in range(MAX_CROSSINGS):
        place = px + t * dx, py + t * dy, pz + t * dz
        step, f, _b1, _b2 = first_hit(rays, scene.buffer, place, (dx, dy, dz), distance - t)
        if f < 0:
            break
        cosine = rays.normal[f, 0] * dx + rays.normal[f, 1] * dy + rays.normal[f, 2] * dz
        if depth > 0:
            add_optical_depth(scene, (place, (dx, dy, dz)), step, tau)
        t += step + rays.step_mm
        if cosine < 0.0:
            blocked = True
            depth += 1
        elif depth > 0:
            depth -= 1
        if medium.eta > 1.0:
            passes *= 1.0 - fresnel(1.0, medium.eta, abs(cosine))[0]
        if min(tau[0], tau[1], tau[2]) > FAINT:
            return True, 0.0
    return blocked, passes


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
def look_for(scene, light, inside, uv, tau):  # type: ignore[no-untyped-def]
    """What a light sends to a place inside the skin.

    Parameters
    ----------
    scene : WalkScene
    light : int
    inside : InsideSkin
    uv : tuple of two floats
        Place on a rectangle.
    tau : ndarray of shape (2, 3), written
        Optical depth of the way inside, and of other skin that is in the way.

    Returns
    -------
    Irradiance on a plane that faces it before extinction (0: nothing comes, nor is `tau` written), direction to
    where it comes from inside the skin, whether other skin is in the way, and what passes its faces.
    """
    rays, buffer, medium, lights = scene.rays, scene.buffer, scene.medium, scene.lights
    kind, source, share = lights.kind[light], lights.source[light], lights.share
    px, py, pz = inside.at
    nx, ny, nz = inside.normal
    eta, faint_mm = medium.eta, medium.faint_mm
    u, v = uv
    depth = inside.depth
    wx, wy, wz, distance, sent = _to_light(kind, source, px, py, pz, u, v)
    nothing = 0.0, wx, wy, wz, False, 1.0
    if sent <= 0.0:
        return nothing
    ux, uy, uz, gain = wx, wy, wz, 1.0
    if eta == 1.0:
        way, f, b1, b2, _ = fly(rays, buffer, inside.at, (wx, wy, wz), depth, min(distance, faint_mm))
        if f < 0 and way >= faint_mm:
            return nothing
        if f >= 0:
            gain = share_at(share, wx * rays.normal[f, 0] + wy * rays.normal[f, 1] + wz * rays.normal[f, 2])
    else:
        # Where the beam enters so that it is bent towards here: by the normal where it would, until that stays
        for _ in range(SNELL_STEPS):
            cos_out = nx * wx + ny * wy + nz * wz
            if cos_out <= 0.0:  # of the side that the light does not reach: look straight towards the light for another
                nx, ny, nz, cos_out = wx, wy, wz, 1.0
            cos_in = math.sqrt(1.0 - (1.0 - cos_out * cos_out) / (eta * eta))
            turn = cos_in - cos_out / eta
            ux, uy, uz = wx / eta + turn * nx, wy / eta + turn * ny, wz / eta + turn * nz
            length = math.sqrt(ux * ux + uy * uy + uz * uz)
            ux, uy, uz = ux / length, uy / length, uz / length
            way, f, b1, b2, _ = fly(rays, buffer, inside.at, (ux, uy, uz), depth, faint_mm)
            if f < 0:
                return nothing
            mx, my, mz = normal_at(rays, f, b1, b2)
            change = abs(mx - nx) + abs(my - ny) + abs(mz - nz)
            nx, ny, nz = mx, my, mz
            wx, wy, wz, distance, sent = _to_light(kind, source, px + way * ux, py + way * uy, pz + way * uz, u, v)
            if change < 1e-4:
                break
        cos_out = nx * wx + ny * wy + nz * wz
        if cos_out <= 0.0 or rays.normal[f, 0] * wx + rays.normal[f, 1] * wy + rays.normal[f, 2] * wz <= 0.0:
            return nothing
        cos_in = math.sqrt(1.0 - (1.0 - cos_out * cos_out) / (eta * eta))
        gain = share_at(share, cos_out) * cos_out / cos_in
        gain *= _focus(rays, f, (nx, ny, nz), (wx, wy, wz), (cos_out, cos_in), eta, way)
        distance += way
    tau[:] = 0.0
    add_optical_depth(scene, (inside.at, (ux, uy, uz)), way, tau[0])
    if f < 0 or not lights.casts[light]:
        return sent * gain, ux, uy, uz, False, 1.0
    qx = px + way * ux + rays.step_mm * rays.normal[f, 0]
    qy = py + way * uy + rays.step_mm * rays.normal[f, 1]
    qz = pz + way * uz + rays.step_mm * rays.normal[f, 2]
    left_mm = max(distance - way - rays.step_mm, 0.0)
    blocked, passes = _beyond(scene, ((qx, qy, qz), (wx, wy, wz)), left_mm, tau[1])
    return sent * gain, ux, uy, uz, blocked, passes


@kernel(inner=True)
def radiance_from(sky, rotate, x, y, z, channel):  # type: ignore[no-untyped-def]
    """Radiance of a sky from a direction, as `direction_of` lays its map out.

    Parameters
    ----------
    sky : ndarray of shape (h, w, 3)
    rotate : float
        Radians by which it is turned.
    x, y, z : float
        Unit direction.
    channel : int
    """
    height, width = sky.shape[0], sky.shape[1]
    row = int(math.acos(min(max(y, -1.0), 1.0)) / math.pi * height)
    place = 0.5 - (math.atan2(x, z) - rotate) / (2.0 * math.pi)
    col = int((place - math.floor(place)) * width)
    return sky[min(row, height - 1), min(col, width - 1), channel]
