"""Walks at the surface, from inside, compiled: they turn back, leave, and may enter skin elsewhere."""

from __future__ import annotations

import numpy as np

from skinbake.kernels.compile import kernel
from skinbake.profile.photons import GOLDEN, fresnel, mixed, uniform
from skinbake.transport.straight_line import normal_at
from skinbake.transport.surface_rays import first_hit
from skinbake.transport.walk_light import SKY, radiance_from, share_at
from skinbake.transport.walk_medium import BANDS
from skinbake.transport.walk_scene import HARD, THROUGH, WHOLE, Place


@kernel(inner=True)
def _see_skies(lights, tally, weight, opened, direction, hidden, first_stay):  # type: ignore[no-untyped-def]
    """Count what skies send against a direction in which a walk may leave.

    Parameters
    ----------
    lights : WalkLights
    tally : Tally, written
    weight : ndarray of shape (3,)
    opened : float
        Share of the sky's light that enters there, per unit radiance inside.
    direction : tuple of three floats
    hidden : bool
        Whether other skin is in the way.
    first_stay : bool
    """
    out, mix = tally.out, tally.mix
    ox, oy, oz = direction
    for light in range(len(lights.kind)):
        if lights.kind[light] != SKY or (hidden and lights.casts[light]):
            continue
        for rgb in range(3):
            sky = opened * radiance_from(lights.sky[light], lights.rotate[light], ox, oy, oz, rgb)
            for c in range(BANDS):
                brings = mix[rgb, c] * weight[c] * sky
                out[WHOLE, light, rgb] += brings
                if first_stay:
                    out[THROUGH, light, rgb] += brings
                    out[HARD, light, rgb] += brings


@kernel(inner=True)
def at_face(scene, tally, place, hit, weight, counts, state):  # type: ignore[no-untyped-def]
    """A walk at the surface, from inside: it turns back, leaves for good, or enters skin elsewhere.

    What does not come back goes on outside, where a sky may be.

    Parameters
    ----------
    scene : WalkScene
    tally : Tally, written
    place : Place
        `at` on the surface.
    hit : (int, float, float)
        Triangle there, and barycentrics 1 and 2.
    weight : ndarray of shape (3,)
    counts : (int, int, bool)
        How often it has turned inside and left the skin, and whether there are skies.
    state : uint64

    Returns
    -------
    Place, the factor on its weights (0: the walk has ended), whether it has left the skin, and the state of the
    numbers.
    """
    rays, buffer, lights, eta = scene.rays, scene.buffer, scene.lights, scene.medium.eta
    f, b1, b2 = hit
    collisions, left, has_sky = counts
    x, y, z = place.at
    dx, dy, dz = place.direction
    ax, ay, az = rays.normal[f, 0], rays.normal[f, 1], rays.normal[f, 2]
    ox, oy, oz, reflected = dx, dy, dz, 0.0
    mx, my, mz = ax, ay, az
    if eta > 1.0:
        mx, my, mz = normal_at(rays, f, b1, b2)
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
        opened = eta * eta * share_at(lights.share, cos_out)
    else:
        opened = share_at(lights.share, ax * dx + ay * dy + az * dz)
    state += GOLDEN
    goes_out = reflected == 0.0 or uniform(mixed(state)) >= reflected
    qx, qy, qz = x + rays.step_mm * ax, y + rays.step_mm * ay, z + rays.step_mm * az
    again = 0.0
    if reflected < 1.0 and (goes_out or has_sky):
        again, f, b1, b2 = first_hit(rays, buffer, (qx, qy, qz), (ox, oy, oz), np.inf)
        if collisions > 0 and has_sky:
            _see_skies(lights, tally, weight, opened, (ox, oy, oz), f >= 0, left == 0)
    if goes_out:
        if f < 0:
            return place, 0.0, True, state
        ax, ay, az = rays.normal[f, 0], rays.normal[f, 1], rays.normal[f, 2]
        facing = -(ax * ox + ay * oy + az * oz)
        if facing <= 0.0:
            return place, 0.0, True, state
        x, y, z = qx + again * ox, qy + again * oy, qz + again * oz
        gain = opened / (1.0 - reflected)
        dx, dy, dz = ox, oy, oz
        if eta > 1.0:
            mx, my, mz = normal_at(rays, f, b1, b2)
            cos_out = -(mx * ox + my * oy + mz * oz)
            if cos_out <= 0.0:
                mx, my, mz, cos_out = ax, ay, az, facing
            back, cos_in = fresnel(1.0, eta, min(cos_out, 1.0))
            gain *= (1.0 - back) / (eta * eta)
            dx = ox / eta - (cos_in - cos_out / eta) * mx
            dy = oy / eta - (cos_in - cos_out / eta) * my
            dz = oz / eta - (cos_in - cos_out / eta) * mz
    else:
        gain = 1.0
        along = dx * mx + dy * my + dz * mz
        dx, dy, dz = dx - 2.0 * along * mx, dy - 2.0 * along * my, dz - 2.0 * along * mz
    if dx * ax + dy * ay + dz * az >= 0.0:
        return place, 0.0, goes_out, state
    x, y, z = x - rays.step_mm * ax, y - rays.step_mm * ay, z - rays.step_mm * az
    return Place((x, y, z), (dx, dy, dz), (ax, ay, az), 1), gain, goes_out, state
