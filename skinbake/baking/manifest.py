"""What bake.json holds, and how it is put."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import skinbake
from skinbake.baking.folder_store import FolderStore
from skinbake.baking.inputs import BakeInputs
from skinbake.baking.stage_log import StageLog
from skinbake.io.irradiance import tile_path
from skinbake.io.lobes import lobe_name, stored_method
from skinbake.io.manifest import portable_config, transport_digest
from skinbake.io.output_names import RELIGHT
from skinbake.io.weight_table import KEY, table_record
from skinbake.machine import peak_memory_mib
from skinbake.pipeline import Baked
from skinbake.relight.transfer import Transfer
from skinbake.scene.budget import DIGITS
from skinbake.scene.decision import kept_of_any_light


def finish_manifest(results: FolderStore, manifest: dict[str, Any]) -> None:
    """Write bake.json. Its seconds and memory are those that it took to make what is in the folder, over several runs.

    What `truth` measured of the same look stays.

    A stage that was taken as it was keeps its seconds, and `total` is those and what else this run took; where nothing
    was left to do but reading, all seconds stay. The peak is the larger one, unless both light and lobes are new.
    """
    reused, seconds, earlier = manifest["reused"], manifest["timings"], results.before.get("timings", {})
    if set(seconds) <= {*reused, "read", "total"}:
        manifest["timings"] = earlier or seconds
    else:
        kept = {stage: earlier[stage] for stage in reused if stage in earlier}
        if "total" in seconds:  # a bake's
            seconds["total"] += sum(kept[stage] - seconds[stage] for stage in kept)
        seconds |= kept
    if "irradiance" in reused or "diffuse" in reused:
        manifest["peak_memory_mib"] = max(manifest["peak_memory_mib"], results.before.get("peak_memory_mib", 0.0))
    model = (results.before.get("error") or {}).get("model")
    if model and model["of"] == transport_digest(manifest):
        manifest["error"] = (manifest["error"] or {}) | {"model": model}
    results.finish(manifest)


def relight_record(transfer: Transfer | None) -> dict[str, Any] | None:
    """What bake.json says of textures for any light; relight.json has the rest."""
    if transfer is None:
        return None
    error = {kind: each.rms for kind, each in transfer.error.items()}
    return {"file": RELIGHT[-1], "basis": transfer.basis.kind, "textures": transfer.basis.textures, "rms": error}


def _other_errors(inputs: BakeInputs, baked: Baked) -> dict[str, Any]:
    """What is not measured at the probes: the fit's error, the estimated loss of a coarser texture, and the root of the
    squares of all that is left wrong.
    """
    return {
        "fit": baked.gaussians.relative_error_rgb.tolist(),
        "texture_size": round(inputs.texture_size.lost, 6),
        "left_wrong": round(baked.left_wrong or 0.0, DIGITS),
    }


def manifest_of(inputs: BakeInputs, results: FolderStore, log: StageLog, baked: Baked) -> dict[str, Any]:
    """What bake.json holds.

    Parameters
    ----------
    inputs : BakeInputs
    results : FolderStore
        The files.
    log : StageLog
        Seconds of the stages.
    baked : Baked
    """
    spec, udim, error = inputs.spec, inputs.spec.texture.udim, baked.diffuse.error
    lobes = []
    for index, lobe in enumerate(baked.diffuse.lobes):
        files = {tile: tile_path(results.folder / lobe_name(index, lobe), tile, udim).name for tile in lobe.rgb}
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
    return {
        "version": skinbake.__version__,
        "config": portable_config(spec, results.folder),
        "inputs": inputs.digests,
        "irradiance": [path.name for path in results.irradiance_paths().values()] if spec.lights else [],
        "lobes": lobes,
        **({} if baked.gaussians.table is None else {KEY: table_record(baked.gaussians.table)}),
        "lights": [light.name for light in spec.lights],
        "relight": relight_record(baked.relight),
        "texturing": spec.texturing.model_dump(),
        "terms": {
            "energy_conservation": baked.decisions.energy_conservation.enabled,
            **{
                term: kept_of_any_light(baked.of_lights, term)
                for term in ("incidence", "beam", "interreflection", "diffuse_profile")
            },
            "curvature": any(line.term == "curvature" and line.enabled for line in baked.of_lights),
            "transmission": any(lobe.transmitted for lobe in baked.diffuse.lobes),
        },
        "timings": dict(log.seconds),
        "reused": [stage for stage, reused in log.reused.items() if reused],
        "peak_memory_mib": round(peak_memory_mib(), 1),
        "error": asdict(error) | _other_errors(inputs, baked) if error else None,
        "plan": [line.record() for line in baked.plan],
        "tx": sorted(name for name in results.written if name.endswith(".tx")),
    }
