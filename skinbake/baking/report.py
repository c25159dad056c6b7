"""What a bake says at its end."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from skinbake.baking.plan_table import aligned, plan_rows
from skinbake.baking.stage_log import StageLog
from skinbake.errors import ToleranceMissedError
from skinbake.pipeline import Baked
from skinbake.scene.spec import SceneSpec
from skinbake.transport.model_error import rms_words


def report(log: StageLog, baked: Baked, model: Mapping[str, Any] | None = None, lost: float = 0.0) -> None:
    """The plan and the errors, on the terminal: the blur's, the texture size's, the model's where `truth` measured it.

    Parameters
    ----------
    log : StageLog
    baked : Baked
    model : mapping, optional
        The manifest's `error.model`.
    lost : float
        Estimated loss of a texture that is coarser than asked for; not told where it is 0.
    """
    for line in baked.plan:
        log.say(f"  {'+' if line.enabled else '-'} {line.term:<20} {line.why}", 2)
    for text in aligned(plan_rows(baked, log.parts)) if baked.diffuse.lobes else ():
        log.say(f"  {text}")
    if baked.diffuse.error:
        e = baked.diffuse.error
        log.say(
            f"  the blur's error, against the surface integral of the same Gaussians, {e.probes} probes: "
            f"rms {e.rms:.3%}, p95 {e.p95:.3%}, max {e.max:.3%} (method {e.method:.3%}, storage {e.storage:.3%})",
            2,
        )
    if lost:
        log.say(f"  the texture size's error, against the size asked for: {lost:.2%}, estimated", 2)
    if baked.relight:
        count, kind, (width, height) = baked.relight.basis.textures, baked.relight.basis.kind, baked.relight.judged_at
        log.say(f"  relighting by {count} textures ({kind}), against bakes of lights unseen at {width} x {height}:")
        for name, error in baked.relight.error.items():
            log.say(f"    {error.sentence(name)}")
    if not baked.diffuse.lobes:
        return
    if model:
        log.say(
            f"  the model's error, against light transport, {model['points']} points: "
            f"rms {rms_words(model['rms'], model['stderr'])} (skinbake truth)",
            2,
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
