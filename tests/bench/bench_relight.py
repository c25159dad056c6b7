"""Relighting: error on lights unseen against the number of textures, by both bases.

`python -m tests.bench.bench_relight LOOK CHART.png` also draws it, of another look.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from skinbake.baking.incidence_table import entered_skin
from skinbake.io.config import load_look
from skinbake.io.scene_files import read_scene
from skinbake.irradiance.decide import decide
from skinbake.profile import fit_skin
from skinbake.profile.skin_medium import skin_medium
from skinbake.relight import transfer
from skinbake.relight.basis import LightBasis
from skinbake.relight.choose_basis import first
from skinbake.relight.grey_lights import keep_light, summed
from skinbake.relight.judge_basis import judge_bases
from tests.conftest import ROOT

COUNTS = (9, 16, 25, 32, 36, 49, 64)
KINDS = ("skies", "soft_boxes", "suns")


def run(quick: bool, look: Path = ROOT / "configs" / "head_plain.yaml") -> list[dict]:
    """Rms of each kind of light, a row a basis and number of textures."""
    spec = load_look(look, ["texture.size=512" if quick else "texture.size=1024"])
    skin = entered_skin(fit_skin(spec.skin, None).gaussians, skin_medium(spec.skin), spec.terms)
    rows: list[dict] = []
    judged = transfer.judge_basis
    kept: list = []

    def judge(bake, basis, textures, lights, say):
        """The prefixes of both bases by the same bakes, once both are there."""
        kept.append((basis, textures))
        if len(kept) == 2:
            lights = lights[::4] if quick else lights
            cut = [_first(*each, count) for each in kept for count in COUNTS if _has(each[0], count)]
            for (one, _), errors in zip(cut, judge_bases(bake, cut, lights), strict=True):
                figures = {kind: round(100 * error.rms, 2) for kind, error in errors.items()}
                rows.append({"name": f"{one.textures} {one.kind}", **{f"{k}_percent": v for k, v in figures.items()}})
        return {}

    transfer.judge_basis = judge
    try:
        for kind in ("harmonics", "fitted"):
            relight = {"textures": max(COUNTS), "basis": kind, "size": 256, "tolerance": 1e-4}
            each = load_look(look, ["texture.size=256", f"relight={relight}".replace("'", "")])
            scene = read_scene(each)
            transfer.make_transfer(each, decide(each), scene, skin)
    finally:
        transfer.judge_basis = judged
    return rows


def _has(basis: LightBasis, count: int) -> bool:
    """Whether so many textures of a basis are one: harmonics go by whole orders."""
    return count <= basis.textures and (basis.kind == "fitted" or count in (9, 16, 25, 36, 49))


def _first(basis: LightBasis, textures: dict, count: int) -> tuple[LightBasis, dict]:
    """The first lights of a basis, as many as so many textures hold, with these."""
    if basis.kind == "harmonics":
        cut = replace(basis, of_harmonics=basis.of_harmonics[:count, :count], radiance=basis.radiance[:count, :count])
        return cut, {tile: image[:count] for tile, image in textures.items()}
    cut, alone = first(basis, count), np.eye(len(basis))
    tiles = {tile: np.zeros((count, *image.shape[1:]), np.float32) for tile, image in textures.items()}
    for tile, image in textures.items():
        for k in range(len(cut)):
            keep_light(tiles[tile], cut, k, summed(image, basis, np.repeat(alone[k][:, None], 3, axis=1)))
    return cut, tiles


def chart(rows: list[dict], path: Path, title: str) -> None:
    """Error against the number of textures, a line a basis and kind of light."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7.2, 4.2), dpi=110)
    colours = {"skies": "#2a6fb0", "soft_boxes": "#c9822b", "suns": "#a93226"}
    words = {"skies": "skies", "soft_boxes": "soft boxes of 10°", "suns": "hard suns"}
    for kind in KINDS:
        for basis, style in (("fitted", "-o"), ("harmonics", "--s")):
            mine = [row for row in rows if row["name"].endswith(basis)]
            counts, rms = [int(row["name"].split()[0]) for row in mine], [row[f"{kind}_percent"] for row in mine]
            axes.plot(counts, rms, style, color=colours[kind], markersize=4, label=f"{words[kind]}, {basis}")
    axes.set(xlabel="textures", ylabel="error on lights unseen, % rms", xticks=COUNTS, yscale="log", title=title)
    ticks = [0.5, 1, 2, 3, 5, 8, 12, 20]
    axes.set_yticks(ticks, [str(tick) for tick in ticks])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.14), frameon=False)
    figure.savefig(path, bbox_inches="tight", metadata={"Software": None})


if __name__ == "__main__":
    found = run(False, Path(sys.argv[1]))
    for line in found:
        print(line)
    chart(found, Path(sys.argv[2]), Path(sys.argv[1]).stem.replace("_", " "))
