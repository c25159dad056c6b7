"""From a look to what follows from it before anything is computed."""

from __future__ import annotations

from skinbake.irradiance.oil_albedo import mean_specular_albedo, oil_table
from skinbake.scene.budget import Budget, budget_of
from skinbake.scene.decision import TOTAL_LIGHT, Decision, Decisions
from skinbake.scene.spec import SceneSpec


def decide(spec: SceneSpec, lost: float = 0.0) -> Decisions:
    """Every decision that needs the look only; those that need light or skin are made where these are known.

    Parameters
    ----------
    spec : SceneSpec
    lost : float
        Error of a texture that is coarser than asked for.
    """
    budget = budget_of(spec, lost)
    separate = spec.output.separate_lights
    names = tuple(light.name for light in spec.lights) if separate or not spec.lights else (TOTAL_LIGHT,)
    return Decisions(_energy_conservation(spec, budget), separate, names, budget)


def _energy_conservation(spec: SceneSpec, budget: Budget) -> Decision:
    """Whether the oil layer reflects enough of diffuse light to be taken off; the share that decides `auto`."""
    oil = spec.specular
    share = float(oil.strength * mean_specular_albedo(oil.roughness, oil.f0, oil_table(oil)))
    wanted = spec.terms.energy_conservation
    enabled = share > budget.negligible if wanted == "auto" else wanted == "on"
    why = f"{wanted}: the oil layer reflects {share:.2%} of diffuse light; left out below {{}}"
    error = share if wanted == "auto" and not enabled else 0.0
    return Decision("energy_conservation", enabled, why.format(f"{budget.negligible:.2%}"), error)
