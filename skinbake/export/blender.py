"""What Blender needs to show the head: its mesh, its textures, and a script that puts them together."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.api.baked_skin import BakedSkin
from skinbake.errors import InputError
from skinbake.export.layers import UDIM, layer_file, layer_names, lobe_layers, weight_file, write_layers
from skinbake.io.atomic import write_text
from skinbake.io.exr import Part, rgb_channels, write_parts
from skinbake.io.irradiance import tile_path
from skinbake.io.manifest import read_manifest
from skinbake.io.mesh import write_obj
from skinbake.io.scene_files import read_scene
from skinbake.irradiance.oil_albedo import oil_table
from skinbake.irradiance.oil_layer import ROUGHNESS_MIN
from skinbake.irradiance.scene_data import SceneData
from skinbake.preview.camera import camera_of
from skinbake.scene.spec import SceneSpec

SCRIPT, DATA, MESH = "skin_blender.py", "skin_blender.json", "skin.obj"
_TABLE, _AFTER = "oil_albedo.exr", "albedo_after.exr"
_MAPS = {"normal": "oil_normal.exr", "roughness": "oil_roughness.exr", "specular": "oil_specular.exr"}


def blender_names(baked: BakedSkin, folder: Path) -> list[str]:
    """Names of the files that `write_blender` writes.

    Parameters
    ----------
    baked : BakedSkin
    folder : Path
        Of the bake.

    Raises
    ------
    InputError
        Maps vary the reflectance of its oil.
    """
    conserves = _conserves(folder)
    refuse_varying_f0(baked.look, conserves)
    tiled = [_AFTER] if _after(baked) else []
    plain = [SCRIPT, DATA, MESH]
    if conserves:
        tiled += [_MAPS[name] for name in _oil_maps(baked)]
        plain.append(_TABLE)
    udim = baked.look.texture.udim
    return [*plain, *layer_names(baked), *(tile_path(Path(n), tile, udim).name for n in tiled for tile in baked.tiles)]


def refuse_varying_f0(look: SceneSpec, conserves: bool) -> None:
    """Stop at oil that Blender cannot be told of.

    Parameters
    ----------
    look : SceneSpec
    conserves : bool
        Whether its bake keeps back what the oil reflects.

    Raises
    ------
    InputError
        Maps vary the reflectance of its oil.
    """
    if look.maps.f0 is not None and conserves:
        raise InputError("export --blender: expected oil of one specular.f0, got maps.f0")


def write_blender(baked: BakedSkin, folder: Path, target: Path) -> None:
    """Write a script, its data, the mesh in mm, and the textures of `write_layers`.

    Where the bake keeps back what the oil reflects, its albedo and its maps go along, so that the same share is kept
    back of what leaves.

    Parameters
    ----------
    baked : BakedSkin
    folder : Path
        Of the bake.
    target : Path

    Raises
    ------
    InputError
        A file of the bake or of its look is missing or damaged, or `target` cannot be written to.
    MachineError
        Disk full.
    """
    scene, look = read_scene(baked.look, rays=False), baked.look
    write_layers(baked, target)
    write_obj(target / MESH, scene.mesh)
    if _after(baked):
        for tile in baked.tiles:
            _write(target, _AFTER, tile, baked, baked.albedo_after(tile))
    udim, width = look.texture.udim, look.preview.size[0]
    camera = camera_of(scene.mesh, look.preview, width / look.preview.size[1])
    about = {
        "mesh": MESH,
        "tiles": list(baked.tiles),
        "lights": [light or "all lights" for light in lobe_layers(baked)],
        "lobes": [
            {
                "weight_rgb": [float(w) for w in weight],
                "weight_image": weight_file(index, UDIM if udim else None) if baked.table else None,
                "variance_mm2": float(baked.variance_mm2[index]),
                "images": [layer_file(baked, index, light, UDIM if udim else None) for light in lobe_layers(baked)],
            }
            for index, weight in enumerate(baked.weight_rgb)
        ],
        "albedo_after": _file(_AFTER, udim) if _after(baked) else None,
        "oil": _write_oil(baked, scene, target) if _conserves(folder) else None,
        "camera": {
            "pose": camera.pose[:3].tolist(),
            "yfov_rad": float(np.radians(camera.yfov_deg)),
            "size": list(look.preview.size),
            "exposure": look.preview.exposure,
        },
    }
    write_text(target / DATA, json.dumps(about, indent=1, allow_nan=False) + "\n")
    write_text(target / SCRIPT, (Path(__file__).parent / SCRIPT).read_text(encoding="utf-8"))


def _write_oil(baked: BakedSkin, scene: SceneData, target: Path) -> dict[str, Any]:
    """Write the oil's albedo and maps; what the script is told of them."""
    oil, maps, udim = baked.look.specular, scene.maps, baked.look.texture.udim
    # Row 0 of a picture is v = 1: light that leaves along the normal
    table = oil_table(oil).astype(np.float32)[::-1]
    blue = np.zeros(table.shape[:2], np.float32)
    write_parts(target / _TABLE, [Part("", {"R": table[..., 0], "G": table[..., 1], "B": blue})], precision="float")
    written = {}
    for name in _oil_maps(baked):
        of: Mapping[int, NDArray[np.float32]] = getattr(maps, name)
        for tile in baked.tiles:
            if name == "normal":
                image = _as_colour(of.get(tile), maps.normal_strength if maps.normal_space == "tangent" else 1.0)
            else:
                plane = of.get(tile, np.full((1, 1), oil.roughness if name == "roughness" else 1.0, np.float32))
                image = np.repeat(np.asarray(plane, np.float32)[..., None], 3, axis=2)
            _write(target, _MAPS[name], tile, baked, image)
        written[name] = _file(_MAPS[name], udim)
    return {
        "table": _TABLE,
        "table_size": [table.shape[1], table.shape[0]],
        "f0": oil.f0,
        "strength": oil.strength,
        "roughness": written.get("roughness", oil.roughness),
        "roughness_min": ROUGHNESS_MIN,
        "specular": written.get("specular"),
        "normal": written.get("normal"),
        "normal_space": maps.normal_space,
    }


def _as_colour(normal: NDArray[np.float32] | None, strength: float) -> NDArray[np.float32]:
    """Normals of length 1 as colours 0 ... 1, flat where there is no map."""
    if normal is None:
        return np.array([[[0.5, 0.5, 1.0]]], np.float32)
    bent = normal * np.array([strength, strength, 1.0], np.float32)
    return np.float32(0.5) + np.float32(0.5) * bent / np.maximum(
        np.linalg.norm(bent, axis=-1, keepdims=True), np.float32(1e-6)
    )


def _write(target: Path, name: str, tile: int, baked: BakedSkin, image: NDArray[np.float32]) -> None:
    """One tile of a texture that holds no colour.

    Parameters
    ----------
    target : Path
    name : str
        Without the tile.
    tile : int
    baked : BakedSkin
    image : ndarray of shape (h, w, 3)
    """
    write_parts(tile_path(target / name, tile, baked.look.texture.udim), [Part("", rgb_channels(image))])


def _file(name: str, udim: bool) -> str:
    """What the script loads: `<UDIM>` stands for the tile's number."""
    return f"{Path(name).stem}.{UDIM}.exr" if udim else name


def _after(baked: BakedSkin) -> bool:
    return baked.look.texturing.exponent_before < 1


def _conserves(folder: Path) -> bool:
    return bool(read_manifest(folder)["terms"].get("energy_conservation", False))


def _oil_maps(baked: BakedSkin) -> Iterator[str]:
    """Maps of the oil that the look has; details bend normals, and what is finer than a texel roughens."""
    maps = baked.look.maps
    bends, rough = maps.normal or maps.height or maps.detail, maps.roughness or maps.detail
    for name, there in (("normal", bends), ("roughness", rough), ("specular", maps.specular or maps.cavity)):
        if there or (maps.source and name != "specular"):
            yield name
