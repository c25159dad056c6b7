"""From a look to what follows from it before anything is computed."""

from __future__ import annotations

from skinbake.irradiance.oil_albedo import mean_specular_albedo
from skinbake.scene.decision import TOTAL_LIGHT, Decision, Decisions
from skinbake.scene.spec import SceneSpec


def decide(spec: SceneSpec) -> Decisions:
    """Every decision that needs the look only; those that need light or skin are made where these are known."""
    separate = spec.output.separate_lights
    names = tuple(light.name for light in spec.lights) if separate else (TOTAL_LIGHT,)
    return Decisions(_energy_conservation(spec), separate, names)


def _energy_conservation(spec: SceneSpec) -> Decision:
    """Whether the oil layer reflects enough of diffuse light to be taken off; the share that decides `auto`."""
    share = float(spec.specular.strength * mean_specular_albedo(spec.specular.roughness, spec.specular.f0))
    wanted = spec.terms.energy_conservation
    enabled = share > spec.diffusion.tolerance if wanted == "auto" else wanted == "on"
    reason = f"the oil layer reflects {share:.2%} of diffuse light"
    return Decision("energy_conservation", enabled, f"{wanted}: {reason}, tolerance {spec.diffusion.tolerance:.2%}")
