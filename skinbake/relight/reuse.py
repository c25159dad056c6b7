"""Lights of a look shown by a transfer in place of blurring them, where its stated error allows that."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from skinbake.diffuse.diffuse_map import DiffuseMap, Lobe
from skinbake.irradiance.environment_map import Image
from skinbake.numerics import safe_div
from skinbake.profile import GaussianSum
from skinbake.relight.relit import light_coefficients, relit
from skinbake.relight.transfer import Transfer
from skinbake.scene.decision import TOTAL_LIGHT, Decision
from skinbake.scene.lights import DirectionalLight, EnvironmentLight, LightSpec
from skinbake.scene.spec import SceneSpec

METHOD = "relight"  # what files say of how such a lobe was made


def blurred_for_reuse(spec: SceneSpec) -> SceneSpec:
    """The look as the transfer of its batch is made, whatever its own tolerance is: to `relight.tolerance`."""
    assert spec.relight is not None
    diffusion = spec.diffusion.model_copy(update={"tolerance": spec.relight.tolerance})
    return spec.model_copy(update={"diffusion": diffusion})


def decide_reuse(
    spec: SceneSpec, make: Callable[[], Transfer], gaussians: GaussianSum, left: float
) -> tuple[Transfer | None, Decision]:
    """The transfer, where every light of a look comes from everywhere and is known to it well enough; and the line.

    Parameters
    ----------
    spec : SceneSpec
    make : callable
        Gives the transfer of the same look but for its lights; asked only where the lights are of such kinds.
    gaussians : GaussianSum
    left : float
        What the look's light may be wrong by: its tolerance less what its size takes.
    """
    why = _why_not(spec, gaussians)
    if why:
        return None, Decision("relight.reuse", False, why)
    assert spec.relight is not None
    # Its blur and the terms that it leaves out may be wrong by as much, which nothing measures: that is taken off
    aim = spec.relight.tolerance
    limit = sqrt(max(left**2 - aim**2, 0.0))
    if limit < aim:
        why = f"its textures and their blur are made for an error of {aim:.2%} each, together above {left:.2%}"
        return None, Decision("relight.reuse", False, why)
    transfer = make()
    # A look has these lights and no others: what is said of it holds for the worst of its kind
    told = {kind: transfer.error[kind].worst for kind in map(_kind, spec.lights) if kind}
    figures = ", ".join(f"{kind} {worst:.2%}" for kind, worst in told.items())
    kept = max(told.values(), default=0.0) <= limit
    verdict = "within" if kept else "above"
    why = (
        f"{transfer.basis.textures} textures state errors of up to {figures}, {verdict} {limit:.2%}, what their blur, "
        f"off by up to {aim:.2%}, leaves of {left:.2%}"
    )
    return transfer if kept else None, Decision("relight.reuse", kept, why)


def _why_not(spec: SceneSpec, gaussians: GaussianSum) -> str:
    """Why no transfer can show these lights on this skin; empty where one can."""
    if gaussians.table is not None:
        return "the skin varies by maps: its weights are of lobes"
    for light in spec.lights:
        if _kind(light) is None:
            return f"light {light.name} is near: only suns and skies come from afar"
        if light.shadows is not None and light.shadows != spec.shadows:
            return f"light {light.name} casts shadows otherwise than the look says"
    return ""


def _kind(light: LightSpec) -> str | None:
    """Kind of the lights by which such a light is judged; None for one that has a place."""
    if isinstance(light, DirectionalLight):
        return "suns"
    return "skies" if isinstance(light, EnvironmentLight) else None


def reused_lights(
    spec: SceneSpec,
    transfer: Transfer,
    gaussians: GaussianSum,
    environments: Mapping[str, Image],
    line: Decision,
) -> DiffuseMap:
    """The look's lights by the transfer: one lobe whose weight is what the profile gives back.

    Parameters
    ----------
    spec : SceneSpec
    transfer : Transfer
    gaussians : GaussianSum
    environments : mapping of light name to ndarray of shape (h, w, 3)
    line : Decision
        What `decide_reuse` said.
    """
    total = gaussians.weight_rgb.sum(axis=0)
    separate = spec.output.separate_lights
    rgb: dict[int, NDArray[np.float32]] = {}
    amounts = [_coefficients(transfer, light, environments) for light in spec.lights]
    shown = amounts if separate else [np.sum(amounts, axis=0)]
    for tile, textures in transfer.textures.items():
        rgb[tile] = np.stack([relit(textures, transfer.basis, each) for each in shown]) * safe_div(1.0, total).astype(
            np.float32
        )
    names = tuple(light.name for light in spec.lights) if separate else (TOTAL_LIGHT,)
    weight = (float(total[0]), float(total[1]), float(total[2]))
    return DiffuseMap(names, (Lobe(0.0, weight, METHOD, rgb),), None, (line,))


def _coefficients(transfer: Transfer, light: LightSpec, environments: Mapping[str, Image]) -> NDArray[np.float64]:
    """How much of each light of the basis a look's light is, (K, 3)."""
    if isinstance(light, DirectionalLight):
        return light_coefficients(transfer.basis, suns=[(light.direction, light.irradiance)])
    assert isinstance(light, EnvironmentLight)
    sky = np.full((8, 16, 3), light.radiance, np.float32) if light.radiance is not None else environments[light.name]
    return light.scale * light_coefficients(transfer.basis, sky, light.rotate_deg)
