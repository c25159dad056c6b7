"""Lights that were baked, the same lights shown by the textures of `relight`, and four times the difference.

`python -m tests.bench.relit_picture LOOK OUT.jpg [--size 1024] [--textures 25] [--view V]` makes the textures of the
look's head once, and bakes by itself each of three lights: the two skies that are shipped and, as the hardest case, the
look's own first light, a sun. It prints how far the linear diffuse pictures are apart: rms, in percent of the baked
one's, and mean HDR-FLIP.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from skinbake.cli import run
from skinbake.io.config import load_look
from skinbake.io.exr import Part, rgb_channels, write_parts
from skinbake.io.image import read_radiance
from skinbake.preview.image_metrics import image_similarity
from skinbake.relight.skies import made_sky, sky_names

PIXELS, TIMES = 480, 4


def picture(folder: Path, out: Path, view: str, *light: str) -> tuple[np.ndarray, np.ndarray]:
    """The diffuse picture of a bake, linear and as a PNG, each (PIXELS, PIXELS, 3)."""
    options = ["--out", str(out), "--views", view, "--size", str(PIXELS), "--mode", "diffuse", "--exr", "--quiet"]
    _run("preview", str(folder), *options, *light)
    drawn = out / f"preview_{view}.png"
    return read_radiance(drawn.with_suffix(".exr")), np.asarray(Image.open(drawn).convert("RGB"))


def _run(*command: str) -> None:
    if run(list(command)) > 1:  # 1 is a tolerance that was missed
        raise SystemExit(2)


def main() -> None:
    """Bake, show, compare."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("look")
    parser.add_argument("out", type=Path)
    parser.add_argument("--size", type=int, default=1024)
    parser.add_argument("--textures", type=int, default=25)
    parser.add_argument("--view", default="three-quarter-right")
    options = parser.parse_args()
    sun = load_look(options.look).lights[0].model_dump(mode="json")
    cases: dict[str, tuple[dict, list[str]]] = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        for name in sky_names():
            write_parts(folder / f"{name}.exr", [Part(name, rgb_channels(made_sky(name)))])
            light = {"name": name, "type": "environment", "path": str(folder / f"{name}.exr")}
            cases[name] = light, ["--environment", name]
        towards, power = (",".join(map(str, sun[key])) for key in ("direction", "irradiance"))
        cases[sun["name"]] = sun, ["--sun", f"{towards}={power.replace(',', '/')}"]
        size = ["--set", f"texture.size={options.size}", "--set", "texture.reduce=off", "--quiet"]
        relight = {"textures": options.textures, "size": options.size, "basis": "fitted", "tolerance": 1e-4}
        keys = ["--set", f"relight={json.dumps(relight)}", "--set", "lights=[]", *size]
        _run("bake", options.look, "--out", str(folder / "relit"), *keys)
        rows = []
        for name, (light, arguments) in cases.items():
            _run("bake", options.look, "--out", str(folder / name), "--set", f"lights={json.dumps([light])}", *size)
            baked, seen = picture(folder / name, folder / name / "drawn", options.view)
            shown, drawn = picture(folder / "relit", folder / f"{name}_relit", options.view, *arguments)
            apart = np.sqrt(np.mean((shown - baked) ** 2) / np.mean(baked**2))
            print(f"{name}: {apart:.1%} rms, HDR-FLIP {image_similarity(shown, baked)[0]:.3f}", flush=True)
            change = np.clip(128 + TIMES * (drawn.astype(np.int16) - seen), 0, 255).astype(np.uint8)
            rows.append(np.hstack([seen, drawn, change]))
    Image.fromarray(np.vstack(rows)).save(options.out, quality=82, optimize=True)


if __name__ == "__main__":
    main()
