"""The one knob: seconds, memory, bytes and error of whole bakes by tolerance, and what the cost model had said.

Each bake has a process of its own; errors are those of the light that leaves the skin, at the same points, against the
exact integral of a look that leaves nothing out (`skinbake tradeoff`), and those of the picture.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skinbake.cli.child_process import in_child
from skinbake.cli.exact_values import Probed
from skinbake.cli.measuring import measure_bake, measure_reference
from skinbake.io.config import load_look
from skinbake.preview.image_metrics import image_similarity
from skinbake.tradeoff import difference, plan_sweep
from tests.conftest import ROOT

LOOKS = {"head": ROOT / "configs" / "head_plain.yaml", "scan": ROOT / "configs" / "lee_perry_smith.yaml"}
TOLERANCES = (0.05, 0.03, 0.02, 0.01, 0.005, 0.003)
POINTS, RUNS = 4000, 3


def run(quick: bool) -> list[dict]:
    """A row a look, size and tolerance; seconds are medians."""
    sizes, tolerances, runs = ((512,), (0.05, 0.01), 1) if quick else ((1024, 2048), TOLERANCES, RUNS)
    rows = []
    for name, path in LOOKS.items():
        if not Path(load_look(path).mesh.path).exists() or (quick and name != "head"):
            continue
        for size in sizes:
            reference = plan_sweep(load_look(path), (size, size), "quick").references[0].overrides
            wanted = in_child(measure_reference, load_look(path, reference), POINTS, True)
            at = Probed(*(wanted[key] for key in ("place", "tile", "position_mm", "normal", "texture_mm2")))
            found: dict[float, list[dict]] = {tolerance: [] for tolerance in tolerances}
            for turn in range(runs):  # in turn, so that a slow spell hits none alone
                for tolerance in tolerances if turn % 2 == 0 else tolerances[::-1]:
                    spec = load_look(path, (f"texture.size={size}", f"tolerance={tolerance}"))
                    found[tolerance].append(in_child(measure_bake, spec, None if turn else at, not turn))
            slowest = _median(found[0.01], "seconds")
            for tolerance, bakes in found.items():
                first, seconds = bakes[0], _median(bakes, "seconds")
                rms, p95, _ = difference(first["values"], wanted["values"])
                row = {
                    "name": f"{name} {size} {tolerance:g}",
                    "seconds_over_those_of_0.01": seconds / slowest,
                    "predicted_over_taken": first["expected"] / seconds,
                    "seconds": seconds,
                    "cpu": _median(bakes, "cpu_seconds"),
                    "MiB": first["peak_mib"],
                    "EXR_MiB": first["bytes"] / 2**20,
                    "rms": rms,
                    "p95": p95,
                }
                if first.get("picture") is not None and wanted.get("picture") is not None:
                    row["FLIP"] = image_similarity(first["picture"], wanted["picture"])[0]
                rows.append(row)
    return rows


def _median(bakes: list[dict], key: str) -> float:
    return float(np.median([bake[key] for bake in bakes]))
