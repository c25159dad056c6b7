"""Straight lines through closed skin: to where it ends, and normals there."""

from __future__ import annotations

import math

from skinbake.kernels.compile import kernel
from skinbake.transport.surface_rays import first_hit

MAX_CROSSINGS = 64  # of one straight line with the surface


@kernel(inner=True)
def normal_at(rays, f, b1, b2):  # type: ignore[no-untyped-def]
    """Unit normal of the smooth surface; the flat one's where the two disagree.

    Parameters
    ----------
    rays : RayScene
    f : int
        Triangle.
    b1, b2 : float
        Barycentrics 1 and 2 in it.
    """
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
def fly(rays, buffer, at, direction, depth, reach):  # type: ignore[no-untyped-def]
    """Go straight until the skin ends or for `reach`.

    Parameters
    ----------
    rays : RayScene
    buffer
        Of `ray_buffer`.
    at, direction : tuples of three floats
        Where it begins, mm about the rays' centre, and unit direction.
    depth : int
        How many closed parts hold the place: they may overlap.
    reach : float
        mm.

    Returns
    -------
    The distance, the triangle where the skin ends (-1: it did not), barycentrics 1 and 2 there, and the depth.
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
