"""The whole bake and each stage, scaling over size, lobes, lights and triangles; each case in a process of its own.

`python -m tests.bench stages`. Ratios first: seconds over copying the bytes that the diffusion reads and writes, taken
in the same process right after it, and seconds a unit (texel, lobe, light, triangle) over those of the smallest.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from skinbake.cli.child_process import Child
from skinbake.cli.measuring import own_peak_mib
from skinbake.diffuse import memory_needed_bytes
from tests.shapes import relief

BASE = {"size": 1024, "lobes": 6, "lights": 3, "segments": 200}
STAGES = ("raster", "irradiance", "diffuse", "write")


def cases(quick: bool) -> list[tuple[str, dict[str, int]]]:
    """Which axis is stretched, and the case."""
    steps = {
        "size": (512, 1024) if quick else (512, 1024, 2048, 4096, 8192),
        "lobes": (1, 6) if quick else (1, 3, 6, 12),
        "lights": (1, 3) if quick else (1, 2, 4, 8),
        "segments": (50, 200) if quick else (25, 100, 400, 800),
    }
    small = BASE | ({"size": 512} if quick else {})
    # One light and one method while the size grows: 8192^2 is to fit
    return [
        (axis, small | {axis: value} | ({"lights": 1} if axis == "size" else {}))
        for axis, values in steps.items()
        for value in values
    ]


def bake_stages(size: int, lobes: int, lights: int, segments: int, method: str, repeats: int) -> dict:
    """Shortest seconds of each stage, those of copying its bytes, and the peak memory of this process."""
    from skinbake.atlas import rasterize
    from skinbake.diffuse import diffuse
    from skinbake.io.lobes import as_stored_lobes, write_lobes
    from skinbake.irradiance import light_texels
    from skinbake.profile.gaussian_sum import GaussianSum
    from skinbake.scene.lights import DirectionalLight
    from skinbake.scene.maps import SkinMaps
    from skinbake.scene.spec import DiffusionSpec

    suns = [
        DirectionalLight(name=f"l{i}", type="directional", direction=(np.cos(i), np.sin(i), -1.0), irradiance=(1, 1, 1))
        for i in range(lights)
    ]
    names = tuple(sun.name for sun in suns)
    skin = GaussianSum(np.geomspace(0.01, 8, lobes), np.full((lobes, 3), 1 / lobes), np.zeros(3), np.ones(3))
    spec = DiffusionSpec(method=method, probes=0)
    found: dict[str, float] = {}

    def once(mesh, size, keep):
        marks = [time.perf_counter()]
        atlas = rasterize(mesh, (size, size))
        marks.append(time.perf_counter())
        light = light_texels(atlas, mesh, SkinMaps(), suns)[0].rgb
        marks.append(time.perf_counter())
        baked = diffuse({1001: light}, names, atlas, mesh, skin, spec, 0)
        marks.append(time.perf_counter())
        copies = [light.copy(), *(lobe.rgb[1001].copy() for lobe in baked.lobes)]
        copied, copied_mib = time.perf_counter() - marks[-1], sum(copy.nbytes for copy in copies) / 2**20
        del copies
        writing = time.perf_counter()
        with TemporaryDirectory() as folder:
            write_lobes(Path(folder), as_stored_lobes(baked, "half"), "", {}, "half", "zip")
        took = [*np.diff(marks), time.perf_counter() - writing]
        if not keep:
            return
        for stage, seconds in zip((*STAGES, "copy"), (*took, copied), strict=True):
            found[stage] = min(found.get(stage, np.inf), float(seconds))
        found["copied_mib"] = copied_mib

    once(relief(segments=16), 64, keep=False)
    mesh = relief(segments=segments)
    for _ in range(repeats):
        once(mesh, size, keep=True)
    return found | {"peak_mib": own_peak_mib(), "triangles": len(mesh.faces)}


def available_bytes() -> int:
    """Memory that this machine can give without swapping."""
    return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def run(quick: bool) -> list[dict]:
    """A row a case and stage."""
    rows = []
    for method in ("texture", "surface"):
        first: dict[str, dict[str, float]] = {}
        for axis, case in cases(quick):
            units = {axis: case[axis] ** (2 if axis in ("size", "segments") else 1)}
            name = f"{method}, {axis} {case[axis]}"
            needed = memory_needed_bytes((case["size"],) * 2, case["lights"], 1, case["lobes"], method)
            if needed > available_bytes():
                rows.append({"name": name, "note": f"left out: needs {needed / 2**30:.0f} GiB of memory"})
                continue
            with Child() as child:
                found = child(bake_stages, *case.values(), method, 1 if case["size"] > 2048 else 3)
            for stage in STAGES:
                each = found[stage] / units[axis]
                row = {
                    "name": f"{name}: {stage}",
                    "over_first": each / first.setdefault(axis, {}).setdefault(stage, each),
                }
                if stage == "diffuse":
                    row["over_copy"] = found[stage] / found["copy"]
                row |= {"seconds": found[stage], "mtexels_per_s": case["size"] ** 2 / found[stage] / 1e6}
                rows.append(row | {"peak_mib": found["peak_mib"], "triangles": found["triangles"]})
    return rows
