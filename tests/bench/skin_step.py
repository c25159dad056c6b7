"""What a profile at the exit leaves out where skin changes: `truth` of a head whose halves are not of one skin.

`python -m tests.bench.skin_step OUT [--points N] [--walks N] [--ramp] [--even R] [--of melanin|haemoglobin]`
writes the map and measures. The profile of its left half is three times as wide as that of its right one; or it holds
six times the melanin, or blood. `--ramp` lets it change along the face instead of at one line, `--even` has it the same
everywhere.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from skinbake.atlas import interpolate, rasterize
from skinbake.cli import run
from skinbake.io.exr import Part, write_parts
from skinbake.io.mesh import read_mesh
from tests.conftest import ROOT

SIZE = 1024
RAMP_MM = 30.0  # on either side of the middle
BETWEEN = {"radius": (0.5, 1.5), "melanin": (0.01, 0.06), "haemoglobin": (0.002, 0.012)}  # right (x < 0) and left
SKINS = {"radius": ["skin.eta=1.0"]}
PHYSIOLOGY = ["skin={model: physiology, melanin: 0.03, haemoglobin: 0.005, normalise: none}"]


def write_map(out: Path, quantity: str, ramp: bool, even: float | None) -> Path:
    """A map of the sample head."""
    mesh = read_mesh(ROOT / "data" / "head.obj", 1.0)
    raster = rasterize(mesh, (SIZE, SIZE), 8)[0]
    x = interpolate(raster, mesh.corner_position_mm)[..., 0]
    share = np.clip(x / (2 * RAMP_MM) + 0.5, 0, 1) if ramp else (x > 0).astype(np.float32)
    low, high = BETWEEN[quantity]
    values = low + (high - low) * share if even is None else np.full_like(x, even)
    path = out / f"{quantity}.exr"
    write_parts(path, [Part("", {"Y": values.astype(np.float32)})], precision="float")
    return path


def main() -> None:
    """Write the map and measure."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--points", default="400")
    parser.add_argument("--walks", default="1600")
    parser.add_argument("--ramp", action="store_true")
    parser.add_argument("--even", type=float)
    parser.add_argument("--of", choices=tuple(BETWEEN), default="radius")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    path = write_map(options.out, options.of, options.ramp, options.even).resolve()
    skin = [f"--set={each}" for each in SKINS.get(options.of, PHYSIOLOGY)]
    look = [str(ROOT / "configs" / "truth.yaml"), "--out", str(options.out), f"--set=maps.{options.of}={path}", *skin]
    run(["truth", *look, "--points", options.points, "--walks", options.walks, "--no-terms"])


if __name__ == "__main__":
    main()
