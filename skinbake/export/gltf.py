"""The head with its baked light as one GLB that any viewer shows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.api.baked_skin import BakedSkin
from skinbake.io.image import filled
from skinbake.io.mesh.write_glb import GlbMaterial, GlbPrimitive, write_glb
from skinbake.io.scene_files import read_scene
from skinbake.preview.geometry import vertex_buffers
from skinbake.preview.tonemap import tonemap
from skinbake.scene.maps import SkinMaps

NAME = "skin.glb"
_MM_PER_METRE = 1000.0


def write_gltf(baked: BakedSkin, folder: Path) -> None:
    """Write `skin.glb`: the mesh in metres, a material a tile that shows M / pi without lights (KHR_materials_unlit).

    Normal map and roughness go along where the look has them; variances, weights, lights and the measured error stand
    in the file's extras. A normal map in object space is left out, since glTF has none.

    Parameters
    ----------
    baked : BakedSkin
    folder : Path

    Raises
    ------
    InputError
        A file of the bake or of its look is missing or damaged, or the folder cannot be written to.
    MachineError
        Disk full.
    """
    scene = read_scene(baked.look, rays=False)
    primitives = []
    for tile, buffers in vertex_buffers(scene.mesh, baked.tiles).items():
        radiance = baked.radiant_exitance(tile=tile) / np.float32(np.pi)
        radiance = filled(radiance, ~np.any(radiance, axis=-1))  # a viewer's mip levels mix texels across chart borders
        maps = scene.maps
        material = GlbMaterial(
            f"skin.{tile}" if baked.look.texture.udim else "skin",
            tonemap(radiance, baked.look.preview.exposure),
            _normal(maps, tile),
            maps.normal_strength,
            _roughness(maps.roughness.get(tile)),
            float(np.sqrt(baked.look.specular.roughness)),
        )
        # glTF counts v downwards
        uv = np.stack([buffers.uv[:, 0], 1 - buffers.uv[:, 1]], axis=1)
        primitives.append(
            GlbPrimitive(
                buffers.position_mm / np.float32(_MM_PER_METRE),
                buffers.normal,
                buffers.tangent,
                uv,
                buffers.faces,
                material,
            )
        )
    write_glb(folder / NAME, primitives, _extras(baked))


def _normal(maps: SkinMaps, tile: int) -> NDArray[np.uint8] | None:
    """Tangent-space normals as a picture; None where there are none."""
    if tile not in maps.normal or maps.normal_space != "tangent":
        return None
    normal = maps.normal[tile]
    length = np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), np.float32(1e-6))
    return np.rint(255 * (0.5 + 0.5 * normal / length)).astype(np.uint8)


def _roughness(beckmann: NDArray[np.float32] | None) -> NDArray[np.uint8] | None:
    """Beckmann m as glTF's perceptual roughness, sqrt(m), in the green channel; nothing is metal."""
    if beckmann is None:
        return None
    picture = np.zeros((*beckmann.shape, 3), np.uint8)
    picture[..., 1] = np.rint(255 * np.sqrt(np.clip(beckmann, 0, 1)))
    return picture


def _extras(baked: BakedSkin) -> dict[str, Any]:
    """What a program needs to know of the light in the textures."""
    return {
        "exposure": baked.look.preview.exposure,
        "lights": list(baked.lights),
        "variance_mm2": [float(v) for v in baked.variance_mm2],
        "weight_rgb": [[float(w) for w in row] for row in baked.weight_rgb],
        "blur_error_rms": None if baked.error is None else float(baked.error.rms),
    }
