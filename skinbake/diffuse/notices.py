"""What a person is told about a bake that may not be what they wanted, and what to change."""

from __future__ import annotations

from skinbake.diffuse.diffuse_map import MeasuredError
from skinbake.diffuse.draw_probes import squeezed_share
from skinbake.diffuse.methods import RAISE_SIZE, method_asked_for
from skinbake.diffuse.skin_geometry import SkinGeometry
from skinbake.scene.decision import Decision
from skinbake.scene.spec import DiffusionSpec


def advice(spec: DiffusionSpec, error: MeasuredError, precision: str) -> str:
    """What to change where the measured error is above the tolerance.

    Parameters
    ----------
    spec : DiffusionSpec
    error : MeasuredError
    precision : "half" or "float"
        What the lobes are written as.
    """
    head = f"measured rms {100 * error.rms:.3g}% is above diffusion.tolerance {100 * spec.tolerance:.3g}%: "
    if error.storage > error.method:
        rounding = ", or set output.precision to float" if precision == "half" else ""
        return f"{head}storage is the larger part; raise texture.size{rounding}"
    fixed = method_asked_for(spec.method)
    return f"{head}the method is the larger part; {fixed.advice if fixed else RAISE_SIZE}"


def squeezed_skin(geometry: SkinGeometry) -> list[Decision]:
    """Skin that the UVs squeeze into almost no texture: no probe judges it."""
    share = squeezed_share(geometry.points)
    if share <= 0:
        return []
    return [Decision("squeezed skin", False, f"{share:.2%} of the skin has no texture to speak of: not judged")]
