"""What a person is told about a bake that may not be what they wanted, and what to change."""

from __future__ import annotations

from collections.abc import Sequence

from skinbake.diffuse.diffuse_map import MeasuredError
from skinbake.diffuse.draw_probes import squeezed_share
from skinbake.diffuse.methods import RAISE_SIZE, method_asked_for
from skinbake.diffuse.skin_geometry import SkinGeometry
from skinbake.scene.budget import FIT
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
    head = f"measured rms {100 * error.rms:.3g}% is above the blur's {100 * spec.tolerance:.3g}% of the tolerance: "
    if error.storage > error.method:
        rounding = ", or set output.precision to float" if precision == "half" else ""
        return f"{head}storage is the larger part; raise texture.size{rounding}"
    fixed = method_asked_for(spec.method)
    return f"{head}the method is the larger part; {fixed.advice if fixed else RAISE_SIZE}"


def too_much(plan: Sequence[Decision], left_wrong: float, tolerance: float) -> str:
    """What to change where the blur is within its part, and all that is left wrong is not within the tolerance.

    Parameters
    ----------
    plan : sequence of Decision
    left_wrong, tolerance : float
    """
    largest = max((line for line in plan if line.term != FIT), key=lambda line: line.error)
    return (
        f"all that is left wrong comes to {100 * left_wrong:.3g}%, tolerance {100 * tolerance:.3g}%; the largest part "
        f"is {largest.term} with {100 * largest.error:.3g}%: set it yourself, or raise the tolerance"
    )


def squeezed_skin(geometry: SkinGeometry) -> list[Decision]:
    """Skin that the UVs squeeze into almost no texture: no probe judges it."""
    share = squeezed_share(geometry.points)
    if share <= 0:
        return []
    return [Decision("squeezed skin", False, f"{share:.2%} of the skin has no texture to speak of: not judged")]
