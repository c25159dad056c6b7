"""A whole bake: the stages in order, then the manifest, then the picture."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import skinbake
from skinbake import pipeline
from skinbake.bake.keys import preview_key
from skinbake.bake.machine import peak_memory_mib
from skinbake.bake.preview_worker import PreviewWorker, render, scene_of, stand_in_of
from skinbake.bake.session import BakeSession
from skinbake.bake.stage_runner import StageRunner
from skinbake.diffuse import Decision, DiffuseMap
from skinbake.errors import InputError, ToleranceMissedError
from skinbake.io.atomic import write_text
from skinbake.io.fingerprint import sha256_of
from skinbake.io.irradiance import tile_path
from skinbake.io.lobes import lobe_name, stored_method
from skinbake.io.manifest import portable_config, write_manifest
from skinbake.irradiance import IrradianceMap
from skinbake.preview.draw import OffscreenRenderer
from skinbake.profile import GaussianSum
from skinbake.scene.spec import SceneSpec

PREVIEW, PREVIEW_KEY = "preview.png", ".preview"


def bake_look(
    spec: SceneSpec,
    force: bool = False,
    preview: bool = True,
    verbosity: int = 1,
    session: BakeSession | None = None,
) -> dict[str, Any]:
    """Bake a look into `spec.output.dir` and give its manifest.

    One process at a time writes to the folder; what one that was killed has left there is used, and its litter removed.

    Raises
    ------
    ToleranceMissedError
        Everything is written, but the measured error is above `diffusion.tolerance`.
    """
    start = time.perf_counter()
    stages = StageRunner(spec, force, verbosity, session)
    stages.say(f"baking into {stages.out}")
    stages.refuse_spoilt()
    with stages.locked():
        gaussians = stages.profile()
        with PreviewWorker() as preview_worker:
            if preview:
                _prepare(preview_worker, stages, gaussians)
            irradiance = stages.irradiance()
            result = stages.diffuse(gaussians, irradiance, stages.light_keys)
            try:
                if preview and _in_memory(result):
                    _draw(stages, gaussians, lambda: _draw_held(preview_worker, stages, irradiance, result))
            finally:  # what was baked is whole, also without a picture
                stages.finish_writing()
                textures = stages.textures(irradiance, result) if spec.output.tx else []
                plan = pipeline.plan_of(spec, irradiance, result)
                manifest = manifest_of(stages, gaussians, result, plan, tuple(light.name for light in spec.lights))
                manifest["tx"] = [path.name for path in textures]
                manifest["timings"]["total"] = time.perf_counter() - start
                put_manifest(stages, manifest)
                report(stages, result, plan)
        if preview and not _in_memory(result):
            _draw(stages, gaussians, lambda: _render_folder(stages))
    stages.say(f"done in {time.perf_counter() - start:.2f} s: {stages.out}")
    if not result.tolerance_met:
        raise ToleranceMissedError(f"{stages.out}: tolerance {spec.diffusion.tolerance:g} missed: {result.advice}")
    return manifest


def put_manifest(stages: StageRunner, manifest: dict[str, Any]) -> None:
    """Write bake.json. Its seconds and memory are those that it took to make what is in the folder, over several runs.

    A stage that was taken as it was keeps its seconds, and `total` is those and what else this run took; where nothing
    was left to do but reading, all seconds stay. The peak is the larger one, unless both light and lobes are new.
    """
    reused, seconds, earlier = manifest["reused"], manifest["timings"], stages.before.get("timings", {})
    if set(seconds) <= {*reused, "read", "total"}:
        manifest["timings"] = earlier or seconds
    else:
        kept = {stage: earlier[stage] for stage in reused if stage in earlier}
        if "total" in seconds:  # a bake's
            seconds["total"] += sum(kept[stage] - seconds[stage] for stage in kept)
        seconds |= kept
    if "irradiance" in reused or "diffuse" in reused:
        manifest["peak_memory_mib"] = max(manifest["peak_memory_mib"], stages.before.get("peak_memory_mib", 0.0))
    named = [*manifest["irradiance"], *(name for lobe in manifest["lobes"] for name in _files(lobe))]
    paths = [stages.out / name for name in (*named, *manifest.get("tx", []))]
    manifest["bytes"] = {path.name: path.stat().st_size for path in paths if path.exists()}
    write_manifest(stages.out, manifest)


def _files(lobe: dict[str, Any]) -> list[str]:
    return list(lobe["tiles"].values()) if "tiles" in lobe else [lobe["file"]]


def _in_memory(result: DiffuseMap) -> bool:
    """Whether the lobes have pixels; those of a bake that was taken as it was are in its folder only."""
    return all(len(rgb) for lobe in result.lobes for rgb in lobe.rgb.values())


def _prepare(preview_worker: PreviewWorker, stages: StageRunner, gaussians: GaussianSum) -> None:
    """Make ready for a picture, if lobes will be computed and one is to be drawn of them."""
    lobes = stages.diffuse_key(gaussians, stages.light_keys)
    if stages.kept_lobes(lobes) is None and not _is_current(stages, _key(stages, gaussians)):
        through = stages.spec.terms.transmission != "off"  # likely: a lobe more
        count = len(gaussians.variance_mm2) + through
        preview_worker.prepare(stand_in_of(stages.spec, stages.scene, stages.tiles, count), stages.spec.preview)


def _draw(stages: StageRunner, gaussians: GaussianSum, draw: Callable[[], None]) -> None:
    """preview.png, unless it shows what is in the folder."""
    key = _key(stages, gaussians)
    picture, note = stages.out / PREVIEW, stages.out / PREVIEW_KEY
    current = _is_current(stages, key)
    with stages.timed("preview", reused=current):
        if not current:
            note.unlink(missing_ok=True)
            draw()
            write_text(note, f"{key} {sha256_of(picture)}\n")


def _key(stages: StageRunner, gaussians: GaussianSum) -> str:
    return preview_key(stages.spec, stages.inputs, stages.diffuse_key(gaussians, stages.light_keys))


def _is_current(stages: StageRunner, key: str) -> bool:
    return not stages.force and preview_is_current(stages.out, key)


def _draw_held(
    preview_worker: PreviewWorker, stages: StageRunner, irradiance: tuple[IrradianceMap, ...], result: DiffuseMap
) -> None:
    """From memory, while the files are written; the same picture."""
    scene = scene_of(stages.spec, stages.scene, irradiance, result)
    stages.let_go()
    preview_worker.draw(scene, stages.spec.preview, stages.out)


def _render_folder(stages: StageRunner) -> None:
    from skinbake.io.bake_folder import read_bake_folder

    with OffscreenRenderer(read_bake_folder(stages.out, summed=True).scene) as renderer:
        render(renderer, stages.spec.preview, stages.out)


def preview_is_current(folder: Path, key: str) -> bool:
    """Whether preview.png is the one that was drawn under `key`, and nobody has drawn another since."""
    try:
        return (folder / PREVIEW_KEY).read_text(encoding="utf-8").split() == [key, sha256_of(folder / PREVIEW)]
    except (OSError, InputError):
        return False


def manifest_of(
    stages: StageRunner, gaussians: GaussianSum, result: DiffuseMap, plan: tuple[Decision, ...], lights: tuple[str, ...]
) -> dict[str, Any]:
    """What bake.json holds."""
    spec, udim = stages.spec, stages.spec.texture.udim
    lobes = []
    for index, lobe in enumerate(result.lobes):
        files = {tile: tile_path(stages.out / lobe_name(index, lobe), tile, udim).name for tile in lobe.rgb}
        height, width = next(iter(lobe.rgb.values())).shape[1:3]
        lobes.append(
            {
                "file": next(iter(files.values())),
                **({"tiles": files} if udim else {}),
                "variance_mm2": lobe.variance_mm2,
                "weight_rgb": list(lobe.weight_rgb),
                "size": [width, height],
                "method": stored_method(lobe),
            }
        )
    error = asdict(result.error) | {"fit": gaussians.relative_error_rgb.tolist()} if result.error else None
    return {
        "version": skinbake.__version__,
        "config": portable_config(spec, stages.out),
        "inputs": stages.inputs,
        "irradiance": [tile_path(stages.out / "irradiance.exr", tile, udim).name for tile in stages.tiles],
        "lobes": lobes,
        "lights": list(lights),
        "texturing": spec.texturing.model_dump(),
        "terms": {
            "energy_conservation": pipeline.energy_conservation(spec).kept,
            "transmission": any(lobe.transmitted for lobe in result.lobes),
        },
        "timings": dict(stages.timings),
        "reused": [stage for stage, reused in stages.reused.items() if reused],
        "peak_memory_mib": round(peak_memory_mib(), 1),
        "error": error,
        "plan": [asdict(line) for line in plan],
    }


def report(stages: StageRunner, result: DiffuseMap, plan: tuple[Decision, ...]) -> None:
    """The plan and the measured error, on the terminal."""
    for line in plan:
        stages.say(f"  {'+' if line.kept else '-'} {line.term:<20} {line.why}")
    if result.error:
        e = result.error
        stages.say(
            f"  error against the surface integral, {e.probes} probes: "
            f"rms {e.rms:.3%}, p95 {e.p95:.3%}, max {e.max:.3%} (method {e.method:.3%}, storage {e.storage:.3%})"
        )
