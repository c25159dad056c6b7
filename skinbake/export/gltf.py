"""The head with its baked light as one GLB that any viewer shows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.api.baked_skin import BakedSkin
from skinbake.io.image_values import filled
from skinbake.io.mesh.write_glb import GlbMaterial, GlbPrimitive, write_glb
from skinbake.io.scene_files import read_scene
from skinbake.preview.geometry import vertex_buffers
from skinbake.preview.tonemap import srgb_encode, tonemap
from skinbake.profile.layers import Layer
from skinbake.profile.skin_medium import skin_medium
from skinbake.scene.maps import SkinMaps
from skinbake.scene.skin import SkinSpec

NAME = "skin.glb"
VARIANTS = ("baked light", "medium")
_MM_PER_METRE = 1000.0


def write_gltf(baked: BakedSkin, folder: Path) -> None:
    """Write `skin.glb`: the mesh in metres, a material a tile that shows M / pi without lights (KHR_materials_unlit).

    Normal map and roughness go along where the look has them; variances, weights, lights and the measured error stand
    in the file's extras, and the layers of the skin's medium where it names one. Where that is one layer, the file has
    a second variant (KHR_materials_variants), for renderers that scatter: the albedo, over the medium as
    KHR_materials_diffuse_transmission, KHR_materials_volume and KHR_materials_ior say it. A normal map in object space
    is left out, since glTF has none.

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
    scene, volume = read_scene(baked.look, rays=False), _volume(_medium(baked.look.skin))
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
        other = None
        if volume:
            albedo = maps.albedo.get(tile, np.asarray(maps.albedo_rgb, np.float32).reshape(1, 1, 3))
            colour = np.rint(255 * srgb_encode(np.clip(albedo, 0, 1))).astype(np.uint8)
            other = replace(material, name=f"{material.name} medium", colour=colour, extensions=volume)
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
                other,
            )
        )
    write_glb(folder / NAME, primitives, _extras(baked), VARIANTS if volume else ())


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


def _medium(skin: SkinSpec) -> tuple[Layer, ...]:
    """Layers of a skin that are given for R, G and B; none where it names no such medium."""
    found = skin_medium(skin)
    return found.layers if found.to_rgb is None else ()


def _volume(layers: tuple[Layer, ...]) -> dict[str, Any]:
    """A medium of one layer as glTF says it: absorption over a distance, in metres; all light that enters is scattered.

    The thickness, for programs that draw surfaces only, is how deep light goes: 1 / sigma_tr of the green.
    """
    if len(layers) != 1:
        return {}
    (layer,) = layers
    absorbed, scattered = layer.medium.sigma_a_per_mm, layer.medium.sigma_sp_per_mm
    distance_mm = 1 / max(float(np.mean(absorbed)), 1e-6)
    deep_mm = 1 / np.sqrt(3 * max(float(absorbed[1]), 1e-6) * float(absorbed[1] + scattered[1]))
    return {
        "KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 1.0},
        "KHR_materials_volume": {
            "thicknessFactor": float(deep_mm) / _MM_PER_METRE,
            "attenuationDistance": distance_mm / _MM_PER_METRE,
            "attenuationColor": [float(x) for x in np.exp(-absorbed * distance_mm)],
        },
        "KHR_materials_ior": {"ior": float(layer.eta)},
    }


def _extras(baked: BakedSkin) -> dict[str, Any]:
    """What a program needs to know of the light in the textures."""
    layers = [
        {
            "sigma_a_per_mm": [float(x) for x in layer.medium.sigma_a_per_mm],
            "sigma_sp_per_mm": [float(x) for x in layer.medium.sigma_sp_per_mm],
            "thickness_mm": float(layer.thickness_mm) if np.isfinite(layer.thickness_mm) else None,
            "eta": float(layer.eta),
            "g": float(layer.g),
        }
        for layer in _medium(baked.look.skin)
    ]
    return {
        "exposure": baked.look.preview.exposure,
        "lights": list(baked.lights),
        "variance_mm2": [float(v) for v in baked.variance_mm2],
        "weight_rgb": [[float(w) for w in row] for row in baked.weight_rgb],
        "medium": layers,
        "blur_error_rms": None if baked.error is None else float(baked.error.rms),
    }
