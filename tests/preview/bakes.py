"""A bake folder written by hand: what `skinbake bake` leaves, without baking."""

from pathlib import Path

import numpy as np
import yaml

from skinbake.io.config import load_look
from skinbake.io.exr import Part, rgb_channels, write_parts
from skinbake.io.manifest import portable_config, write_manifest
from skinbake.io.mesh import write_obj
from skinbake.io.png import write_png
from tests.preview.scenes import smooth_noise
from tests.shapes import sphere

LOOK = {
    "mesh": {"path": "ball.obj", "unit": "mm"},
    "maps": {"albedo": "albedo.png"},
    "texture": {"size": [48, 32]},
    "skin": {"model": "gaussians", "variance_mm2": [0.1, 2.0], "weight_rgb": [[0.4, 0.5, 0.7], [0.6, 0.5, 0.3]]},
    "lights": [
        {"name": "key", "type": "directional", "direction": [-1, -1, -1], "irradiance": [3, 3, 3]},
        {"name": "rim", "type": "point", "position_mm": [200, 100, -150], "intensity": [1e5, 1e5, 1e5]},
    ],
    "output": {"dir": "out"},
    "preview": {"size": [60, 80], "view": "front"},
}


def write_bake(folder: Path, lights="separate", precision="half", energy=True) -> Path:
    """Write look, mesh, map and a bake of them into `folder`; give the bake's folder."""
    rng = np.random.default_rng(5)
    folder.mkdir(parents=True, exist_ok=True)
    write_obj(folder / "ball.obj", sphere(90.0))
    write_png(folder / "albedo.png", rng.integers(60, 200, (16, 16, 3)).astype(np.uint8))
    look = LOOK | {"output": {"dir": "out", "lights": lights, "precision": precision}}
    (folder / "look.yaml").write_text(yaml.safe_dump(look))
    spec = load_look(folder / "look.yaml")
    out = Path(spec.output.dir)

    names = [light.name for light in spec.lights]
    rgb = smooth_noise(rng, (2, 32, 48, 3))
    seen = smooth_noise(rng, (2, 32, 48, 1))[..., 0]
    parts = [Part("irradiance", rgb_channels(rgb.sum(0)) | {"A": np.ones((32, 48), np.float32)})]
    parts += [Part(f"light.{n}", rgb_channels(rgb[i]) | {"visibility": seen[i]}) for i, n in enumerate(names)]
    write_parts(out / "irradiance.exr", parts, precision=precision)
    lobes = []
    for i, (variance, weight) in enumerate(zip(LOOK["skin"]["variance_mm2"], LOOK["skin"]["weight_rgb"], strict=True)):
        rgb = smooth_noise(rng, (2, 32 >> i, 48 >> i, 3))
        parts = [Part("irradiance", rgb_channels(rgb.sum(0)))]
        if lights == "separate":
            parts += [Part(f"light.{n}", rgb_channels(rgb[k])) for k, n in enumerate(names)]
        write_parts(out / f"lobe_{i}.exr", parts, precision=precision)
        entry = {"file": f"lobe_{i}.exr", "variance_mm2": variance, "weight_rgb": weight}
        lobes.append(entry | {"size": [48 >> i, 32 >> i], "method": "texture"})
    manifest = {
        "config": portable_config(spec, out),
        "irradiance": ["irradiance.exr"],
        "lobes": lobes,
        "lights": names,
        "terms": {"energy_conservation": energy, "transmission": False},
        "bytes": {path.name: path.stat().st_size for path in sorted(out.iterdir())},
    }
    write_manifest(out, manifest)
    return out
