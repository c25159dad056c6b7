"""Another skin on the lobes of a bake."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from skinbake.numerics import Float
from skinbake.preview.scene import PreviewScene
from skinbake.profile.gaussian_sum import GaussianSum


class OtherSkin(NamedTuple):
    """A skin that can be shown: its name, and what fits it to the lobes that are there."""

    name: str
    fit: Callable[[], GaussianSum]


def stored_variances(scene: PreviewScene) -> Float:
    """Variances of a scene's Gaussians, mm^2, (N,)."""
    return np.array([lobe.variance_mm2 for lobe in scene.lobes if lobe.variance_mm2 is not None], np.float64)


def with_skin(scene: PreviewScene, gaussians: GaussianSum) -> PreviewScene:
    """The scene with other weights on its lobes. Light through thin parts, and what terms added, stay as baked.

    Raises
    ------
    ValueError
        If the Gaussians are not the scene's.
    """
    if not np.array_equal(gaussians.variance_mm2, stored_variances(scene)):
        raise ValueError("with_skin: expected Gaussians of the variances of the lobes")
    lobes = list(scene.lobes)
    for i, (r, g, b) in enumerate(gaussians.weight_rgb.tolist()):
        lobes[i] = replace(lobes[i], weight_rgb=(r, g, b))
    return replace(scene, lobes=tuple(lobes), table=gaussians.table)


def skin_line(name: str, gaussians: GaussianSum) -> str:
    """What is shown, how far its weights are from its profile, and whether it should be baked."""
    error = float(gaussians.relative_error_rgb.max())
    wanted = "; bake again for this one" if gaussians.too_far_off() else ""
    return f"skin {name}: its fit on these lobes is off by {error:.2%}{wanted}"
