"""The one knob: seconds, memory, bytes and error of whole bakes by tolerance, and what the cost model had said.

Each bake has a process of its own. Its light is compared, at the same points, with that of a bake at a tenth to a
fiftieth of the tolerance: the same Gaussians, every light's directions, terms and bounces, as floats, at the size that
was asked for. The exact integral (`skinbake tradeoff`) is dearer by a factor of three to six, and such a bake is nearer
to it than half of what the tightest row leaves: the sample head at 256^2 and 512^2, `NEAR_EXACT_RMS`. What a fit of so
many Gaussians leaves is no matter of the knob, and in no row. Beside it stands what scikit-image takes, in the same
run, for the blurs of six Gaussians alone, of one texture.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from skinbake.cli.child_process import in_child
from skinbake.cli.exact_values import Probed
from skinbake.cli.measuring import measure_bake, measure_near_exact
from skinbake.io.config import load_look
from skinbake.preview.image_metrics import image_similarity
from skinbake.tradeoff import difference
from skinbake.tradeoff.plan import NEAR_EXACT_RMS, near_exact
from tests.bench.bench_diffuse import VARIANCE_MM2
from tests.conftest import ROOT

LOOKS = {"head": ROOT / "configs" / "head.yaml", "scan": ROOT / "configs" / "lee_perry_smith.yaml"}
TOLERANCES = (0.05, 0.02, 0.01, 0.005, 0.003)
POINTS, RUNS = 4000, 2
TIGHT = 0.01  # below it one run tells enough: it takes the longer the tighter it is


def run(quick: bool) -> list[dict]:
    """A row a look, size and tolerance; seconds are medians. Each look and size begins with its reference."""
    sizes, tolerances, runs = ((256,), (0.05, 0.01), 1) if quick else ((1024, 2048), TOLERANCES, RUNS)
    rows = []
    for name, path in LOOKS.items():
        if not Path(load_look(path, files=False).mesh.path).exists() or (quick and name != "head"):
            continue
        for size in sizes:
            asked = (f"texture.size={size}",)
            start = time.perf_counter()
            wanted = in_child(measure_near_exact, load_look(path, (*asked, *near_exact(load_look(path)))), POINTS)
            note = f"reference: a bake at 0.001, itself wrong by about {NEAR_EXACT_RMS:.2%} and what it leaves out"
            rows.append({"name": f"{name} {size} reference", "seconds": time.perf_counter() - start, "note": note})
            found: dict[float, list[dict]] = {tolerance: [] for tolerance in tolerances}
            blurs = _six_blurs(size)
            for turn in range(runs):  # in turn, so that a slow spell hits none alone
                for tolerance in tolerances if turn % 2 == 0 else tolerances[::-1]:
                    if turn and tolerance < TIGHT:
                        continue
                    spec = load_look(path, (*asked, f"tolerance={tolerance}"))
                    at = None if turn else Probed.of(wanted)
                    found[tolerance].append(in_child(measure_bake, spec, at, not turn))
            blurs = min(blurs, _six_blurs(size))
            rows.append({"name": f"{name} {size} scikit-image, six blurs", "seconds": blurs})
            rows += [_row(f"{name} {size}", tolerance, found, wanted, blurs) for tolerance in tolerances]
    return rows


def _six_blurs(size: int) -> float:
    """Seconds that scikit-image takes for six Gaussians on a texture of texels of .22 mm at 2048^2."""
    from skimage.filters import gaussian

    light = np.random.default_rng(0).random((size, size, 3)).astype(np.float32)
    start = time.perf_counter()
    for variance in VARIANCE_MM2 / 0.05 * (size / 2048) ** 2:
        gaussian(light, np.sqrt(variance), channel_axis=-1)
    return time.perf_counter() - start


def _row(name: str, tolerance: float, found: dict[float, list[dict]], wanted: dict, blurs: float) -> dict:
    """Figures of the bakes at one tolerance.

    Parameters
    ----------
    name : str
        Look and size.
    tolerance : float
    found : dict of float to list of dict
        Measured bakes by tolerance, the first one with its light.
    wanted : dict
        The reference.
    blurs : float
        Seconds of `_six_blurs`.
    """
    bakes = found[tolerance]
    first, seconds, cpu = bakes[0], _median(bakes, "seconds"), _median(bakes, "cpu_seconds")
    rms, p95, _ = difference(first["values"], wanted["values"])
    row = {
        "name": f"{name} {tolerance:g}",
        "seconds_over_those_of_0.01": seconds / _median(found[0.01], "seconds"),
        "cpu_over_that_of_0.01": cpu / _median(found[0.01], "cpu_seconds"),
        "over_six_blurs": seconds / blurs,
        "predicted_over_taken": first["expected"] / seconds,
        "seconds": seconds,
        "cpu": cpu,
        "MiB": first["peak_mib"],
        "EXR_MiB": first["bytes"] / 2**20,
        "rms": rms,
        "p95": p95,
        "stages": first["stages"],
    }
    if first.get("picture") is not None and wanted.get("picture") is not None:
        row["FLIP"] = image_similarity(first["picture"], wanted["picture"])[0]
    return row


def _median(bakes: list[dict], key: str) -> float:
    return float(np.median([bake[key] for bake in bakes]))
