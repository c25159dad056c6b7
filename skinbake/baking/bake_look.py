"""A whole bake into a folder: the stages, the picture, the textures for renderers, the manifest."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from skinbake import pipeline
from skinbake.baking.folder_bake import FolderBake, folder_bake
from skinbake.baking.look_stages import put_aside, refuse_spoilt_look
from skinbake.baking.manifest import finish_manifest, manifest_of
from skinbake.baking.pace import STAGES, expected_seconds, keep_pace
from skinbake.baking.preview_worker import PreviewWorker
from skinbake.baking.report import refuse_missed, report
from skinbake.baking.session import BakeSession
from skinbake.baking.stage_log import StageLog
from skinbake.baking.stages.preview import PreviewStage
from skinbake.baking.stages.textures import TexturesStage
from skinbake.baking.verdict import last_lines, marked, worst_place
from skinbake.baking.warnings import EMPTY_PICTURE, bake_warnings
from skinbake.machine import return_freed
from skinbake.pipeline import Baked
from skinbake.scene.spec import SceneSpec


def bake_look(
    spec: SceneSpec,
    force: bool = False,
    preview: bool = True,
    verbosity: int = 1,
    session: BakeSession | None = None,
    then: Callable[[dict[str, Any], StageLog], dict[str, Any]] | None = None,
) -> dict[str, Any]:
    """Bake a look into `spec.output.dir` and give its manifest.

    One process at a time writes to the folder; what one that was killed has left there is used, and its litter removed.

    Parameters
    ----------
    spec : SceneSpec
    force : bool
        Run every stage, also those whose results are there.
    preview : bool
        End with a picture.
    verbosity : int
        0 says nothing, 1 a line a stage, 2 more.
    session : BakeSession, optional
        What this look shares with others.
    then : callable, optional
        What follows in the same folder, before the last lines are said; given the manifest, it gives what that is then.

    Raises
    ------
    InputError
        A file of the look is missing or cannot be used, or the folder cannot be written to.
    MachineError
        Disk full, too little memory, no OpenGL for the picture.
    ToleranceMissedError
        Everything is written, but the measured error is above `diffusion.tolerance`.
    """
    start = time.perf_counter()
    bake = folder_bake(spec, force, verbosity, session, f"baking into {Path(spec.output.dir)}")
    log, folder = bake.log, bake.results.folder
    expected = expected_seconds(bake.inputs, bake.stages(), STAGES if preview else STAGES - {"preview"})
    with log.telling_of_compiling() as compiling, log.whole("baking", expected):
        manifest, baked = _bake_into_folder(bake, preview, start, expected)
    keep_pace(bake.inputs, log)
    about = f", about {sum(expected.values()):.1f} were expected" if expected else ""
    about = f", {compiling.seconds:.1f} of it compiling{about} of the rest" if compiling.seconds and about else about
    try:
        manifest = then(manifest, log) if then else manifest
    finally:  # the bake itself is whole
        log.say(f"done in {time.perf_counter() - start:.1f} s{about}")
        for line in (*last_lines(folder, manifest, bake.results.holds_picture), *marked(manifest["warnings"])):
            log.say(line)
    refuse_missed(spec, baked)
    return manifest


def _bake_into_folder(
    bake: FolderBake, preview: bool, start: float, expected: Mapping[str, float]
) -> tuple[dict[str, Any], Baked]:
    """Run the stages and write their files, the picture among them; the manifest, and what was baked.

    Parameters
    ----------
    bake : FolderBake
    preview : bool
        End with a picture.
    start : float
        When the bake began, by `time.perf_counter`.
    expected : mapping of stage name to float
        Seconds that were expected of what runs.
    """
    inputs, results, log = bake.inputs, bake.results, bake.log
    stages = bake.stages()
    uv = refuse_spoilt_look(inputs, stages)
    if preview and not inputs.spec.lights:
        preview = False
        log.say("  no lights yet, no picture")
    with results.open(preview), PreviewWorker() as worker:
        if not inputs.reduced:
            put_aside(inputs, stages, results.spool)
        picture = PreviewStage(inputs, stages, results, worker, log)
        if preview:
            picture.prepare()
        baked = pipeline.bake(stages)
        return_freed()
        warnings = bake_warnings(inputs, stages, baked, results.before, uv)
        worst = worst_place(inputs, baked, results.before)
        try:
            if preview:
                picture.result()  # while the files are written
        finally:  # what was baked is whole, also without a picture
            results.finish_writing()
            if inputs.spec.output.tx and inputs.spec.lights:
                TexturesStage(stages, results, log).result()
            if not preview and inputs.spec.lights:
                picture.load()  # a picture of these very lobes stays
            results.remove_others()
            if results.picture_is_empty:
                warnings.append(EMPTY_PICTURE)
            manifest = manifest_of(inputs, results, log, baked)
            manifest["warnings"] = warnings
            if worst:
                manifest["error"]["worst"] = worst
            manifest["timings_expected"] = expected or results.before.get("timings_expected", {})
            manifest["timings"]["total"] = time.perf_counter() - start
            finish_manifest(results, manifest)
            report(log, baked, (manifest["error"] or {}).get("model"), inputs.texture_size.lost)
    return manifest, baked
