"""What a bake says at its end."""

from __future__ import annotations

from skinbake.baking.stage_log import StageLog
from skinbake.errors import ToleranceMissedError
from skinbake.pipeline import Baked
from skinbake.scene.spec import SceneSpec


def report(log: StageLog, baked: Baked) -> None:
    """The plan and the measured error, on the terminal."""
    for line in baked.plan:
        log.say(f"  {'+' if line.enabled else '-'} {line.term:<20} {line.why}")
    if baked.diffuse.error:
        e = baked.diffuse.error
        log.say(
            f"  error against the surface integral, {e.probes} probes: "
            f"rms {e.rms:.3%}, p95 {e.p95:.3%}, max {e.max:.3%} (method {e.method:.3%}, storage {e.storage:.3%})"
        )


def refuse_missed(spec: SceneSpec, baked: Baked) -> None:
    """End as one that missed its tolerance.

    Raises
    ------
    ToleranceMissedError
        The measured error is above the tolerance, and there is a knob that would help.
    """
    if not baked.diffuse.tolerance_met:
        tolerance = spec.diffusion.tolerance
        raise ToleranceMissedError(f"{spec.output.dir}: tolerance {tolerance:g} missed: {baked.diffuse.advice}")
