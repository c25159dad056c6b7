"""A bake folder, read."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.api.baked_skin import BakedSkin
from skinbake.atlas import FIRST_TILE
from skinbake.atlas.look_atlas import look_atlas
from skinbake.diffuse import MeasuredError
from skinbake.diffuse.light_entering import albedo_of
from skinbake.errors import InputError
from skinbake.io.exr import channel_of, read_parts
from skinbake.io.irradiance import LIGHT, TOTAL
from skinbake.io.lobes import is_transmission
from skinbake.io.manifest import NAME, irradiance_files, read_manifest, spec_of, table_of
from skinbake.io.relight import read_use, transfer_of
from skinbake.io.scene_files import read_scene
from skinbake.relight.transfer import Transfer
from skinbake.scene.decision import Decision
from skinbake.scene.maps import SkinMaps
from skinbake.scene.spec import SceneSpec

Image = NDArray[np.float32]


def open_bake(folder: Path | str) -> BakedSkin:
    """Open what `skinbake bake` left; its textures are read when they are asked for.

    Parameters
    ----------
    folder : path
        A bake folder, or the bake.json in it.

    Raises
    ------
    InputError
        There is no bake, or it is damaged.
    """
    folder = Path(folder)
    folder = folder.parent if folder.name == NAME else folder
    manifest = read_manifest(folder)
    look, error = spec_of(manifest, folder), manifest["error"]
    pixels = _FolderPixels(folder, manifest, look)
    return BakedSkin(
        look,
        pixels,
        tuple(manifest["lights"] or [light.name for light in look.lights]),
        pixels.tiles,
        np.array([lobe["variance_mm2"] for lobe in manifest["lobes"]], np.float64),
        np.array([lobe["weight_rgb"] for lobe in manifest["lobes"]], np.float64).reshape(-1, 3),
        MeasuredError(**{name: error[name] for name in MeasuredError.__dataclass_fields__}) if error else None,
        tuple(Decision.from_record(line) for line in manifest["plan"]),
        bool(manifest["lobes"]) and is_transmission(manifest["lobes"][-1]["method"]),
        folder,
        table_of(manifest, folder),
    )


@dataclass(frozen=True)
class _FolderPixels:
    """Arrays of a bake folder."""

    folder: Path
    manifest: dict[str, Any]
    look: SceneSpec

    @property
    def tiles(self) -> tuple[int, ...]:
        """UDIM numbers, which the file names hold where there are tiles."""
        if not self.look.texture.udim:
            return (FIRST_TILE,)
        relight = self.manifest["relight"] is not None
        files = self.manifest["irradiance"] or (read_use(self.folder)["files"].values() if relight else ())
        files = files or self.manifest["lobes"][0].get("tiles", {}).values()
        try:
            return tuple(int(Path(file).stem.rpartition(".")[2]) for file in files)
        except ValueError as error:
            raise InputError(
                f"{self.folder / NAME}: expected a tile number in each file name; bake it again"
            ) from error

    def irradiance(self, tile: int, light: str | None) -> Image:
        return self._read(irradiance_files(self.manifest, self.folder)[self.tiles.index(tile)], light)

    def lobe(self, index: int, tile: int, light: str | None) -> Image:
        entry = self.manifest["lobes"][index]
        try:
            name = entry["tiles"][str(tile)] if self.look.texture.udim else entry["file"]
        except KeyError as error:
            raise InputError(f"{self.folder / NAME}: lobe {index} has no tile {tile}; bake it again") from error
        return self._read(name, light)

    def albedo(self, tile: int) -> Image:
        scene, atlas = self._scene
        return albedo_of(scene.maps, next(of for of in atlas if of.tile == tile), scene.mesh)

    def transfer(self) -> Transfer:
        return transfer_of(self.folder)

    def maps(self) -> SkinMaps:
        maps: SkinMaps = self._scene[0].maps
        return maps

    @cached_property
    def _scene(self) -> Any:
        scene = read_scene(self.look, rays=False)
        return scene, look_atlas(self.look.texture, scene.mesh)

    def _read(self, name: str, light: str | None) -> Image:
        path, part = self.folder / name, TOTAL if light is None else LIGHT + light
        parts = read_parts(path, [part])
        return np.stack([channel_of(path, parts, part, c) for c in "RGB"], axis=-1).astype(np.float32)
