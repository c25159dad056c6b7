"""Weights of a bake's lobes over the skin, as its manifest and its maps say."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from skinbake.diffuse.skin_weights import SkinWeights
from skinbake.io.manifest import spec_of, table_of
from skinbake.io.scene_files import read_scene


def bake_weights(manifest: Mapping[str, Any], folder: Path) -> SkinWeights:
    """Weights of a bake's lobes; maps are read only where they vary the skin.

    Parameters
    ----------
    manifest : mapping
    folder : Path

    Raises
    ------
    InputError
        The table is damaged, or a map is missing.
    """
    alone = np.array([lobe["weight_rgb"] for lobe in manifest["lobes"]], np.float64)
    table = table_of(manifest, folder)
    if table is None:
        return SkinWeights(alone)
    return SkinWeights(alone, table, read_scene(spec_of(manifest, folder), rays=False).maps)
