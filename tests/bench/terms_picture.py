"""A look without the terms of light transport, with them, and six times the difference, as one picture.

`python -m tests.bench.terms_picture LOOK OUT.jpg [--size 1024] [--views V,V,V] [--folder DIR]` bakes the look twice and
prints by view how far the two are apart, in parts of 255.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from skinbake.cli import run

TERMS = "incidence", "beam", "curvature", "interreflection", "diffuse_profile", "transmission"
PIXELS, TIMES = 480, 6


def pictures(look: str, folder: Path, texture: str, views: str, terms: str | None) -> list[np.ndarray]:
    """Views of the look's bake, (PIXELS, PIXELS, 3), with its terms as the look says or all of them switched."""
    keys = {"texture.size": texture, "texture.reduce": "off"} | {f"terms.{name}": terms for name in TERMS if terms}
    chosen = [part for key, value in keys.items() for part in ("--set", f"{key}={value}")]
    for command in (
        ["bake", look, "--out", str(folder), "--quiet", *chosen],
        ["preview", str(folder), "--out", str(folder / "views"), "--views", views, "--size", str(PIXELS), "--quiet"],
    ):
        if run(command) > 1:  # 1 is a tolerance that was missed
            raise SystemExit(2)
    return [
        np.asarray(Image.open(folder / "views" / f"preview_{view}.png").convert("RGB")) for view in views.split(",")
    ]


def main() -> None:
    """Bake, draw, compare."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("look")
    parser.add_argument("out", type=Path)
    parser.add_argument("--size", default="1024")
    parser.add_argument("--views", default="three-quarter-right,ear,lips")
    parser.add_argument("--folder", type=Path, help="keep the bakes here")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        without, with_terms = (
            pictures(options.look, folder / name, options.size, options.views, terms)
            for name, terms in (("off", "off"), ("look", None))
        )
    rows = []
    for view, before, after in zip(options.views.split(","), without, with_terms, strict=True):
        change = after.astype(np.int16) - before
        seen = np.abs(change).max(axis=2)
        seen = seen[seen > 0]
        middle, much = np.percentile(seen, (50, 99)) if seen.size else (0, 0)
        print(f"{view}: of 255, by pixels that change: half {middle:.0f} or more, a hundredth {much:.0f} or more")
        rows.append(np.hstack([before, after, np.clip(128 + TIMES * change, 0, 255).astype(np.uint8)]))
    Image.fromarray(np.vstack(rows)).save(options.out, quality=82, optimize=True)


if __name__ == "__main__":
    main()
