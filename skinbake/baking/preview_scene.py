"""What the picture of a bake is drawn of: its arrays in memory, or a stand-in for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from skinbake.diffuse import DiffuseMap
from skinbake.io.bake_folder import half_maps
from skinbake.io.lobes import StoredLobe
from skinbake.irradiance import IrradianceMap
from skinbake.irradiance.scene_data import SceneData
from skinbake.preview.scene import PreviewLobe, PreviewScene, Texture
from skinbake.profile.weight_table import WeightTable
from skinbake.scene.decision import Decisions
from skinbake.scene.maps import IMAGES, SkinMaps
from skinbake.scene.spec import SceneSpec
from skinbake.stored_precision import as_stored

MOST_TEXELS = 4096  # of a texture along a side: a picture shows no more, and software OpenGL has them in memory


def picture_bytes(size: tuple[int, ...], lights: int, tiles: int = 1) -> int:
    """Memory of the textures of a bake's picture with software OpenGL, without maps; fitted to the sample head.

    Parameters
    ----------
    size : (height, width)
        Of the baked textures.
    lights, tiles : int
        How many of them.
    """
    return min(size[0], MOST_TEXELS) * min(size[1], MOST_TEXELS) * tiles * (53 + 15 * lights)


def scene_of(
    spec: SceneSpec,
    decisions: Decisions,
    scene: SceneData,
    irradiance: Sequence[IrradianceMap],
    result: DiffuseMap,
    table: WeightTable | None,
    separate: bool = False,
    halves: SkinMaps | None = None,
) -> PreviewScene:
    """What `read_bake_folder` would read, without waiting for the files.

    Parameters
    ----------
    spec : SceneSpec
    decisions : Decisions
    scene : SceneData
    irradiance : sequence of IrradianceMap
    result : DiffuseMap
        With `StoredLobe`s.
    table : WeightTable, optional
        Of the profile.
    separate : bool
        Each light on its own, as a window wants them, instead of their sum.
    halves : SkinMaps, optional
        The maps as half floats, where they are there already.
    """
    precision = spec.output.precision
    lobes = tuple(
        PreviewLobe(
            dict(lobe.rgb) if separate else {tile: total[None] for tile, total in lobe.total.items()},
            lobe.weight_rgb,
            None if lobe.transmitted else lobe.variance_mm2,
        )
        for lobe in result.lobes
        if isinstance(lobe, StoredLobe)
    )
    return _scene(
        spec,
        decisions,
        scene,
        lobes,
        {tile.tile: as_stored(tile.rgb, precision) for tile in irradiance},
        {tile.tile: as_stored(tile.visibility[..., None], precision)[..., 0] for tile in irradiance},
        table,
        separate,
        halves,
    )


def stand_in_of(
    spec: SceneSpec, decisions: Decisions, scene: SceneData, tiles: Sequence[int], lobes: int, with_maps: bool = False
) -> PreviewScene:
    """A scene that the same shader draws as that of `scene_of`, with textures of one texel.

    Parameters
    ----------
    spec : SceneSpec
    decisions : Decisions
    scene : SceneData
    tiles : sequence of int
    lobes : int
        How many there will be, as far as is known.
    with_maps : bool
        Maps are whole.
    """
    lights, maps = len(spec.lights), scene.maps
    if not with_maps:
        small: dict[str, Any] = {n: {tile: image[:1, :1] for tile, image in getattr(maps, n).items()} for n in IMAGES}
        maps = replace(maps, **small)
    lobe = PreviewLobe({tile: np.zeros((1, 1, 1, 3), np.float16) for tile in tiles}, (0, 0, 0), 1.0)
    return _scene(
        spec,
        decisions,
        replace(scene, maps=maps),
        (lobe,) * lobes,
        {tile: np.zeros((lights, 1, 1, 3), np.float16) for tile in tiles},
        {tile: np.zeros((lights, 1, 1), np.float16) for tile in tiles},
    )


def _scene(
    spec: SceneSpec,
    decisions: Decisions,
    scene: SceneData,
    lobes: tuple[PreviewLobe, ...],
    irradiance: Mapping[int, Texture],
    visibility: Mapping[int, Texture],
    table: WeightTable | None = None,
    separate: bool = False,
    halves: SkinMaps | None = None,
) -> PreviewScene:
    return PreviewScene(
        scene.mesh,
        spec.lights,
        lobes,
        irradiance,
        visibility,
        halves or half_maps(scene.maps),
        spec.texturing,
        spec.specular,
        decisions.energy_conservation.enabled,
        separate=separate,
        table=table,
        most_texels=max(MOST_TEXELS, 4 * max(spec.preview.size)),
    )
