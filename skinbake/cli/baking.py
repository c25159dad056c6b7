"""A whole bake: the stages in order, then the manifest, then the picture."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import Any

import skinbake
from skinbake import pipeline
from skinbake.cli.stages import Stages, peak_memory_mib
from skinbake.diffuse import DiffuseMap
from skinbake.errors import ToleranceMissedError
from skinbake.io.irradiance import tile_path
from skinbake.io.lobes import lobe_name
from skinbake.io.manifest import portable_config, write_manifest
from skinbake.profile import GaussianSum
from skinbake.scene.spec import SceneSpec


def bake_look(spec: SceneSpec, force: bool = False, preview: bool = True, verbosity: int = 1) -> dict[str, Any]:
    """Bake a look into `spec.output.dir` and give its manifest.

    Raises
    ------
    ToleranceMissedError
        Everything is written, but the measured error is above `diffusion.tolerance`.
    """
    start = time.perf_counter()
    stages = Stages(spec, force, verbosity)
    stages.say(f"baking into {stages.out}")
    gaussians = stages.profile()
    irradiance = stages.irradiance()
    result = stages.diffuse(gaussians, irradiance, stages.light_keys)
    manifest = manifest_of(stages, gaussians, result, tuple(light.name for light in spec.lights))
    manifest["timings"]["total"] = time.perf_counter() - start
    write_manifest(stages.out, manifest)
    report(stages, result)
    if preview:
        from skinbake.cli.preview import render_still

        with stages.timed("preview"):
            render_still(stages.out)
    stages.say(f"done in {time.perf_counter() - start:.2f} s: {stages.out}")
    if not result.tolerance_met:
        raise ToleranceMissedError(f"{stages.out}: tolerance {spec.diffusion.tolerance:g} missed: {result.advice}")
    return manifest


def manifest_of(stages: Stages, gaussians: GaussianSum, result: DiffuseMap, lights: tuple[str, ...]) -> dict[str, Any]:
    """What bake.json holds."""
    spec, udim = stages.spec, stages.spec.texture.udim
    energy = pipeline.energy_conservation(spec)
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
                "method": lobe.method,
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
            "energy_conservation": energy.kept,
            "transmission": any(lobe.method == "transmission" for lobe in result.lobes),
        },
        "timings": dict(stages.timings),
        "reused": [stage for stage, reused in stages.reused.items() if reused],
        "peak_memory_mib": round(peak_memory_mib(), 1),
        "error": error,
        "plan": [asdict(line) for line in (energy, *result.plan)],
    }


def report(stages: Stages, result: DiffuseMap) -> None:
    """The plan and the measured error, on the terminal."""
    for line in (pipeline.energy_conservation(stages.spec), *result.plan):
        stages.say(f"  {'+' if line.kept else '-'} {line.term:<20} {line.why}")
    if result.error:
        e = result.error
        stages.say(
            f"  error against the surface integral, {e.probes} probes: "
            f"rms {e.rms:.3%}, p95 {e.p95:.3%}, max {e.max:.3%} (method {e.method:.3%}, storage {e.storage:.3%})"
        )
