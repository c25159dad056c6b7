"""Twelve looks, two heads by two skins by three rigs: what the cache, processes and a farm save.

CPU seconds are told beside the wall's, since a busy machine moves them least; the first column is their ratio to a
batch without a cache. A small batch goes first, so that no row pays for compiling.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.conftest import ASSETS, ROOT

SCANS = (ASSETS / "lee_perry_smith", ROOT / "data" / "lee_perry_smith")
KEY = "{name: key, type: directional, direction: [-0.62, -0.55, -0.56], irradiance: [3.2, 3.0, 2.75]}"
RIM = "{name: rim, type: directional, direction: [0.62, -0.25, 0.74], irradiance: [1.3, 1.5, 1.8]}"
SKY = "{name: sky, type: environment, radiance: [0.16, 0.18, 0.21]}"
LAMP = "{name: lamp, type: point, position_mm: [-260, 40, 240], intensity: [140000, 92000, 50000]}"
BATCH = f"""\
defaults:
  base: CONFIGS/head_plain.yaml
  texture: {{size: SIZE}}
  preview: {{size: [480, 600]}}
  output: {{dir: out}}
matrix:
  head:
    sample:
    other: OTHER
  skin:
    classic: {{skin: {{preset: gpugems3-six-gaussians}}}}
    layered: {{skin: {{preset: donner-three-layer}}}}
  rig:
    renderer: {{lights: [{KEY}, {RIM}, {SKY}]}}
    warm: {{lights: [{KEY.replace("3.0, 2.75", "2.4, 1.5")}, {RIM}, {SKY}]}}
    back: {{lights: [{RIM}, {LAMP}]}}
"""


def run(quick: bool = False) -> list[dict]:
    """One row a way to bake them."""
    scan = next((folder for folder in SCANS if (folder / "head.obj").is_file()), None)
    other = "{base: CONFIGS/lee_perry_smith.yaml}" if scan else "{mesh: {mm_per_unit: 1.25}}"
    text = BATCH.replace("OTHER", other).replace("CONFIGS", str(ROOT / "configs"))
    environment = os.environ | ({"SKINBAKE_LPS": str(scan)} if scan else {})
    environment.pop("SKINBAKE_CACHE", None)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "looks.yaml").write_text(text.replace("SIZE", "256" if quick else "1024"))

        def batch(name: str, *more: str, out: str = "out") -> dict:
            command = [sys.executable, "-m", "skinbake", "batch", f"{folder}/looks.yaml", "--quiet", "--json"]
            before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            done = subprocess.run(
                [*command, "--out", f"{folder}/{out}", *more],
                env=environment,
                cwd=ROOT,
                capture_output=True,
                text=True,
                check=False,
            )
            seconds, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
            assert done.returncode in (0, 1), f"{name}: exit code {done.returncode}: {done.stderr}"
            report = json.loads(done.stdout)
            ran = [job for job in report["jobs"] if job["selected"]]
            assert {job["status"] for job in ran} <= {"done", "fresh", "missed"}, done.stderr
            return {
                "name": name,
                "looks": len(ran),
                "seconds": round(seconds, 1),
                "cpu_seconds": round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, 1),
                "traced": sum(len(job["traced"]) for job in ran),
                "from_cache": report["cache"]["hits"],
                "made": report["cache"]["misses"],
                "peak_mib": report["peak_memory_mib"],
            }

        batch("compile", "--no-cache", "--set", "texture.size=256", out="warm-up")
        rows = [
            batch("no cache", "--no-cache", out="apart"),
            batch("cold"),
            batch("warm"),
            batch("another rim light", "--only", "*-renderer", "--set", "lights.rim.irradiance=[0.9, 1.2, 1.6]"),
            batch("the same, no cache", "--no-cache", "--force", "--only", "*-renderer", out="apart"),
            batch("cold, -j 2", "-j", "2", out="two"),
            batch("cold, two dask workers", "-j", "2", "--dask", "local", out="farm"),
        ]
    for row in rows:
        against = rows[4 if row["looks"] == 4 else 0]
        row["cpu_over_no_cache"] = round(row["cpu_seconds"] / against["cpu_seconds"], 2)
    return rows


if __name__ == "__main__":
    for line in run("--quick" in sys.argv):
        print(line)
