"""Make the sample head: `python data/make_head.py [--out data]`.

Writes head.obj (millimetres), albedo.png (8-bit sRGB), roughness.png (8-bit, Beckmann m), normal.png (tangent space,
see `paint.tangent_normals`), melanin.png and haemoglobin.png (16-bit volume fractions, white is `paint.MOST_MELANIN`
and `paint.MOST_BLOOD`), cavity.png (8-bit share of the oil that is seen) and registry.txt.
The same versions of the libraries give the same bytes.
Needs numpy, scipy, scikit-image, fast-simplification and pillow.
"""

import argparse
import hashlib
import sys
import time
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parent))

from sample_head import charts, paint, surface, texels, unwrap
from sample_head.anatomy import head_field
from sample_head.obj import write_obj

STEP_MM = 0.7
TRIANGLES = 60000
SIZE = 2048
LICENCE = "our own work, same licence as the project (MIT)"
FILES = ("head.obj", "albedo.png", "roughness.png", "normal.png", "melanin.png", "haemoglobin.png", "cavity.png")


def srgb(linear):
    """sRGB encoding of linear values 0 to 1."""
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def write_png(path, values, top=255):
    """PNG of values 0 to 1, of 8 bits, or of 16 where `top` is 65535."""
    kind = np.uint8 if top == 255 else np.uint16
    Image.fromarray(np.squeeze(np.round(np.clip(values, 0, 1) * top).astype(kind))).save(path, optimize=True)


def smaller(image, times):
    """Means of `times` x `times` texels."""
    height, width, channels = image.shape
    return image.reshape(height // times, times, width // times, times, channels).mean(axis=(1, 3))


def make(out, step_mm=STEP_MM, size=SIZE, say=print):
    """The whole head into folder `out`."""
    began = time.monotonic()
    vertices, faces = surface.build_mesh(head_field, step_mm, TRIANGLES)
    vertices, faces, label, seam = charts.cut_into_charts(vertices, faces)
    vertices = np.round(vertices, 3)
    normals = surface.unit_normals(head_field, vertices)
    corner = charts.texture_vertices(faces, seam)
    uv = np.round(unwrap.lay_out(vertices, faces, label, corner), 6)
    out.mkdir(parents=True, exist_ok=True)
    write_obj(out / "head.obj", vertices, uv, normals, faces, corner)
    say(f"head.obj: {len(faces)} triangles, {time.monotonic() - began:.0f} s")
    grid = texels.address(size, vertices, normals, faces, uv, corner)
    albedo, roughness, normal, melanin, blood, cavity = paint.paint(grid)
    write_png(out / "albedo.png", grid.image(srgb(albedo), srgb(paint.BASE)))
    write_png(out / "roughness.png", grid.image(roughness, 0.375))
    write_png(out / "normal.png", grid.image(normal * 0.5 + 0.5, (0.5, 0.5, 1.0)))
    for name, values, bare, most, times in (
        ("melanin", melanin, paint.LIGHT_MELANIN, paint.MOST_MELANIN, 4),
        ("haemoglobin", blood, paint.LIGHT_BLOOD, paint.MOST_BLOOD, 8),
        ("cavity", cavity, 1.0, 1.0, 2),
    ):
        write_png(
            out / f"{name}.png", smaller(grid.image(values / most, bare / most), times), 65535 if most < 1 else 255
        )
    lines = [f"{name} {hashlib.sha256((out / name).read_bytes()).hexdigest()} {LICENCE}" for name in FILES]
    (out / "registry.txt").write_text("# file sha256 licence\n" + "\n".join(lines) + "\n")
    say(f"maps: {len(grid.row)} texels, {time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).resolve().parent, help="folder to write")
    make(parser.parse_args().out)
