"""Seconds that the stages of a bake take, from what there is to do: texels, lights, directions, tolerance, triangles.

Fitted to bakes of the sample head and of a scan at 1024^2 and 2048^2, and tolerances of .05 to .003, on two cores of a
2.6 GHz server: it stands between the two, of which the scan takes up to twice as long at one size.
Another machine differs by a factor a stage, which `skinbake.baking.pace` learns from its own bakes.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import NamedTuple

from skinbake.diffuse.terms.interreflection import COARSE_ERROR, COARSENESS, LEAST_RAYS, MOST_RAYS, Bounced, Receivers
from skinbake.diffuse.terms.skin_view import RAYS
from skinbake.profile.skin_medium import skin_medium
from skinbake.relight.transfer import transfer_size
from skinbake.scene.budget import Budget
from skinbake.scene.spec import SceneSpec

# What is not known before the look's files are read
TRIANGLES = 60_000
SKIN_MM2 = 200_000.0  # of a head, more with its neck
BOUNCED = 0.037  # of its light that skin sends to skin; heads
NOISE = Bounced(BOUNCED, 0.018)
A_RAY_S, A_RECEIVER_S = 0.42e-6, 1.6e-6  # of light from skin to skin: of a ray, and of a texel and a light
PENUMBRA, NOISE_OF_36 = 0.2, 0.015  # texels that see a part of a rectangle; rms of what 36 rays leave of its light
A_LOBE_S, OWN_LIGHT = 1.25, 0.25  # of six lobes of a light, a megatexel; and what `terms.diffuse_profile` adds to them
ALONE = 0.3  # of processor time, that one core works while the others wait
START_S = 0.9  # of the process, until it reads


class Work(NamedTuple):
    """What there is to do.

    Attributes
    ----------
    tiles, lobes, triangles : int
        How many; triangles with those that only cast shadows.
    skin_mm2 : float
        Area of the skin.
    """

    tiles: int = 1
    lobes: int = 6
    triangles: int = TRIANGLES
    skin_mm2: float = SKIN_MM2


def stage_seconds(spec: SceneSpec, budget: Budget, work: Work) -> dict[str, float]:
    """Seconds of each stage by its name, once the machine code is compiled and the process runs.

    Parameters
    ----------
    spec : SceneSpec
        At the size that is worked at.
    budget : Budget
        Of its tolerance.
    work : Work
    """
    megatexels = spec.texture.size[0] * spec.texture.size[1] * work.tiles / 2**20
    triangles = work.triangles / 1e6
    lights = len(spec.lights) if spec.output.separate_lights else 1
    directions = sum(_directions(light.samples, budget) for light in spec.lights if light.type == "environment")
    lamps = sum(light.type != "environment" for light in spec.lights)
    rays = sum(_rays(light.samples, spec, budget, work) for light in spec.lights if light.type == "rectangle")
    cpu = {
        "read": 0.05 + 5 * triangles,
        "raster": 0.05 + 0.1 * megatexels + 0.5 * triangles,
        "profile": 0.02,
        # Directions that all around have settled are not asked: the more there are, the less another one takes
        "irradiance": 0.5
        + 4 * triangles
        + lamps * 0.17 * megatexels
        + rays * PENUMBRA * megatexels * 2**20 * A_RAY_S
        + directions**0.72 * (0.013 + 0.0075 * megatexels**0.75),
        "diffuse": 0.6
        + 3 * triangles
        + _of_lobes(spec) * (0.5 + 0.5 * lights) * megatexels * work.lobes / 6 * _exactness(budget)
        + _between_skin(spec, budget, work),
        "preview": 1.0 + 0.35 * megatexels**0.7,
        "write": 0.02 + 0.25 * megatexels,
    }
    if spec.relight is not None and not spec.relight.reuse:
        width, height = transfer_size(spec)
        textures = spec.relight.textures * width * height * work.tiles / 2**20
        cpu["relight"] = 25 + 1.6 * textures  # of 25: 47 on the sample head, 94 where light comes through ears
    if not spec.lights:
        cpu = {name: seconds for name, seconds in cpu.items() if name in ("read", "profile", "relight")}
    return {name: share_of_wall(2) * seconds for name, seconds in cpu.items()}


def share_of_wall(cores: int) -> float:
    """Seconds on some cores of one of processor time."""
    return ALONE + (1 - ALONE) / cores


def _directions(asked: int | None, budget: Budget) -> float:
    """About how many directions a sky's shadows take: four times as many halve the noise twice or less."""
    if asked is not None:
        return float(asked)
    ratio = 0.0076 / max(budget.sky, 1e-9)
    return float(min(max(256 * ratio ** (1.9 if ratio > 1 else 0.9), 16), 4096))


def _rays(asked: int | None, spec: SceneSpec, budget: Budget, work: Work) -> float:
    """About how many rays a texel a rectangle takes: skin that scatters by half a millimetre leaves their noise."""
    if asked is not None:
        return float(asked)
    texel_mm2 = work.skin_mm2 / (spec.texture.size[0] * spec.texture.size[1] * work.tiles)
    noise = NOISE_OF_36 / sqrt(1 + pi / texel_mm2)
    return float(min(max(36 * (noise / max(budget.sky, 1e-9)) ** (4 / 3), 36), 4096))


def _of_lobes(spec: SceneSpec) -> float:
    """Seconds of six lobes of one light, a megatexel: those with a light of their own make it, and what follows."""
    own = spec.terms.diffuse_profile == "on" and bool(skin_medium(spec.skin).layers)
    return A_LOBE_S * (1 + OWN_LIGHT * own)


def _exactness(budget: Budget) -> float:
    """How much longer lobes take whose sums are closer than those of a tolerance of .01: clusters are smaller."""
    return max((0.005 / max(budget.blur, 1e-9)) ** 0.3, 1.0)


def looking(spec: SceneSpec, budget: Budget, work: Work) -> tuple[float, float]:
    """About how many texels look for skin that lights them, and how many rays they send in all.

    Parameters
    ----------
    spec, budget, work
        As of `stage_seconds`.
    """
    limits = [budget.terms_left(light.name) for light in spec.lights] or [budget.left]
    if spec.terms.interreflection == "off" or (spec.terms.interreflection == "auto" and min(limits) > BOUNCED):
        return 0.0, 0.0
    coarser = min(max(min(limits) / (COARSE_ERROR * BOUNCED), COARSENESS[0]), COARSENESS[1])
    taken = Receivers(coarser, rays=min(max(NOISE.rays_for(min(limits)), LEAST_RAYS, RAYS / coarser), MOST_RAYS))
    texels = spec.texture.size[0] * spec.texture.size[1] * work.tiles
    receivers = min(0.8 * texels, 1.3 * work.skin_mm2 / taken.width_mm**2)
    return receivers, receivers * (4 + taken.rays * (0.22 if taken.with_neighbours else 0.85))


def _between_skin(spec: SceneSpec, budget: Budget, work: Work) -> float:
    """Seconds of light from skin to skin: to trace rays, and to gather what they bring of each light."""
    receivers, rays = looking(spec, budget, work)
    lights = len(spec.lights) if spec.output.separate_lights else 1
    return 0.1 + rays * A_RAY_S + receivers * lights * A_RECEIVER_S
