"""Irradiance of a look: `light_texels` with what the look says."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas
from skinbake.irradiance.irradiance_map import IrradianceMap
from skinbake.irradiance.light_texels import light_texels
from skinbake.irradiance.scene_data import SceneData
from skinbake.numerics import Zeros
from skinbake.profile import GaussianSum
from skinbake.scene.decision import Decisions
from skinbake.scene.spec import SceneSpec


def light_skin(
    spec: SceneSpec,
    decisions: Decisions,
    scene: SceneData,
    atlas: Atlas,
    names: tuple[str, ...] | None = None,
    rounded: Callable[[NDArray[np.float32]], NDArray[np.floating]] = lambda image: image,
    tell: Callable[[str], None] = lambda text: None,
    zeros: Zeros = np.zeros,
    gaussians: GaussianSum | None = None,
) -> tuple[IrradianceMap, ...]:
    """Irradiance of the look's lights, one map a tile; a light's values do not depend on the other lights.

    Parameters
    ----------
    spec : SceneSpec
    decisions : Decisions
        Of the look.
    scene : SceneData
    atlas : Atlas
    names : tuple of str, optional
        Lights to compute; all of them by default.
    rounded : callable
        Makes of a light's (H, W, 4), irradiance and unshadowed share, what is kept of it, before the next is computed.
    tell : callable
        Told in words which light begins.
    zeros : callable, optional
        Makes images that stay for longer.
    gaussians : GaussianSum, optional
        Of the skin, which smooths a rectangle's noise.
    """
    return light_texels(
        atlas,
        scene.mesh,
        scene.maps,
        tuple(light for light in spec.lights if names is None or light.name in names),
        shadows=spec.shadows,
        specular=spec.specular,
        energy_conservation=decisions.energy_conservation.enabled,
        environments=scene.environments,
        seed=spec.output.seed,
        tolerance=decisions.budget.sky_directions,
        occluder=scene.occluder,
        seen=scene.sky_texels(spec.texture),
        gaussians=gaussians,
        rounded=rounded,
        tell=tell,
        zeros=zeros,
    )
