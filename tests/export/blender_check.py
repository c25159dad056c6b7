"""Cycles against the preview: `python -m tests.export.blender_check BAKE --python PYTHON_WITH_BPY`.

Not part of the suite, for bpy takes a gigabyte and Python 3.11:

    python3.11 -m venv /tmp/bpy && /tmp/bpy/bin/pip install bpy==5.0.1
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from skinbake.cli import run
from skinbake.io.exr import read_parts

LARGEST = 0.01  # rms, of what is within the outline


def difference(bake, python, size, folder):
    """Root mean square difference of the diffuse light, relative, where skin covers whole pixels."""
    assert run(["export", bake, "--to", str(folder), "--blender", "--quiet"]) == 0
    data = folder / "skin_blender.json"
    about = json.loads(data.read_text())
    about["camera"]["size"] = size
    data.write_text(json.dumps(about))
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    script = [python, str(folder / "skin_blender.py"), "--render", str(folder / "cycles.exr")]
    subprocess.run(script, check=True, env=environment, stdout=subprocess.DEVNULL)
    picture = ["--png", str(folder / "ours.png"), "--size", "x".join(map(str, size)), "--supersample", "8"]
    assert run(["preview", bake, "--exr", "--mode", "diffuse", *picture, "--quiet"]) == 0
    cycles, ours = (next(iter(read_parts(folder / name).values())) for name in ("cycles.exr", "ours.exr"))
    whole = (np.asarray(cycles.channels["A"]) > 0.9999) & (np.asarray(ours.channels["A"]) > 0.9999)
    assert whole.mean() > 0.1
    return float(np.sqrt(np.mean((cycles.rgb - ours.rgb)[whole] ** 2) / np.mean(ours.rgb[whole] ** 2)))


def main():
    """Print the difference; 1 where it is too large."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bake")
    parser.add_argument("--python", required=True, help="Python with bpy.")
    parser.add_argument("--size", type=int, nargs=2, default=[300, 375])
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = difference(asked.bake, asked.python, asked.size, Path(folder))
    print(f"Cycles against the preview, diffuse light: rms {found:.3%}")
    return int(found > LARGEST)


if __name__ == "__main__":
    sys.exit(main())
