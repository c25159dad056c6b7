"""Other skins that a page shows on the lobes of its bake: a few weights each."""

from __future__ import annotations

from typing import Any

from skinbake.errors import InputError
from skinbake.io.bake_folder import BakeFolder
from skinbake.io.other_skins import other_skins
from skinbake.preview.other_skin import skin_line, with_skin


def page_skins(bake: BakeFolder) -> list[dict[str, Any]]:
    """Name, line, weights and their total of each skin that comes with skinbake and goes with the bake's lobes.

    Those whose fit is near come first. None where maps vary the skin: its weights are then a table, drawn as a texture.
    """
    found = []
    for skin in [] if bake.scene.table is not None else other_skins(bake):
        try:
            gaussians = skin.fit()
        except InputError:  # the bake has no lobe for its light that does not scatter, or it cannot be white
            continue
        scene = with_skin(bake.scene, gaussians)
        found.append(
            {
                "name": skin.name,
                "again": gaussians.too_far_off(),
                "line": skin_line(skin.name, gaussians),
                "weights": [[_digits(w) for w in lobe.weight_rgb] for lobe in scene.lobes],
                "total_weight": [_digits(w) for w in scene.total_weight_rgb],
            }
        )
    return sorted(found, key=lambda skin: skin["again"])


def _digits(value: float) -> float:
    """What a float of the shader keeps."""
    return float(f"{value:.8g}")
