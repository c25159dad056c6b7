"""What a profile at the exit leaves out where skin changes: `truth` of a head whose right half is wider than its left.

`python -m tests.bench.bench_skin_step OUT [--points N] [--walks N] [--ramp] [--even R]` writes the map and measures;
`--ramp` lets the width go from 0.5 to 1.5 along the face instead of at one line, `--even` has it the same everywhere.
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


def width_map(out: Path, ramp: bool, even: float | None) -> Path:
    """A map of the sample head: 0.5 at its right (x < 0), 1.5 at its left."""
    mesh = read_mesh(ROOT / "data" / "head.obj", 1.0)
    raster = rasterize(mesh, (SIZE, SIZE), 8)[0]
    x = interpolate(raster, mesh.corner_position_mm)[..., 0]
    share = np.clip(x / (2 * RAMP_MM) + 0.5, 0, 1) if ramp else (x > 0).astype(np.float32)
    width = 0.5 + share if even is None else np.full_like(x, even)
    path = out / "width.exr"
    write_parts(path, [Part("", {"Y": width.astype(np.float32)})], precision="float")
    return path


def main() -> None:
    """Write the map and measure."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--points", default="400")
    parser.add_argument("--walks", default="1600")
    parser.add_argument("--ramp", action="store_true")
    parser.add_argument("--even", type=float)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    path = width_map(options.out, options.ramp, options.even).resolve()
    look = [str(ROOT / "configs" / "truth.yaml"), "--out", str(options.out), "--set", f"maps.radius={path}"]
    run(["truth", *look, "--points", options.points, "--walks", options.walks, "--no-terms", "--set", "skin.eta=1.0"])


if __name__ == "__main__":
    main()
