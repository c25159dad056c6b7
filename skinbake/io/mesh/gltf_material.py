"""Materials of a glTF: by which UVs they read their textures, and the base colour, normals and roughness they hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from skinbake.errors import InputError
from skinbake.io.mesh.gltf_file import GltfFile, file_of
from skinbake.numerics import Float

TEXTURES = ("base", "normal", "roughness")
OTHER_TEXTURES = ("normalTexture", "occlusionTexture", "emissiveTexture")
SUFFIX = {"image/png": ".png", "image/jpeg": ".jpg", "image/webp": ".webp"}
# Extensions of a texture whose picture replaces a plain one
PICTURES = {"KHR_texture_basisu": "KTX2 pictures", "MSFT_texture_dds": "DDS pictures"}
REPEAT = 10497
WRAPS = {33071: "CLAMP_TO_EDGE", 33648: "MIRRORED_REPEAT"}


@dataclass(frozen=True)
class GltfMaterial:
    """What of a material is skin's; None where it says nothing.

    Attributes
    ----------
    name : str
        For messages.
    base_image, roughness_image, normal_image : int or None
        Index of an image: sRGB; roughness in its green; tangent space, green upwards.
    base_rgb : tuple of 3 floats or None
        Linear; multiplies the image, or stands alone.
    roughness : float or None
        The same of r, whose GGX lobe has alpha = r^2.
    normal_scale : float
        Multiplies x and y.
    alpha_mode : "OPAQUE", "MASK" or "BLEND"
    alpha, alpha_cutoff : float
        Multiplies the alpha of the base colour; what of it stops light where the mode is MASK.
    wrap : str
        How a texture goes on outside [0, 1], where it does not repeat; empty where all do.
    """

    name: str
    base_image: int | None = None
    base_rgb: tuple[float, float, float] | None = None
    roughness_image: int | None = None
    roughness: float | None = None
    normal_image: int | None = None
    normal_scale: float = 1.0
    alpha_mode: str = "OPAQUE"
    alpha: float = 1.0
    alpha_cutoff: float = 0.5
    wrap: str = ""

    def refuse_outside(self, path: Path, key: str) -> None:
        """Stop where UVs leave [0, 1] and a texture does not repeat there.

        Raises
        ------
        InputError
            By the name of the material, and how its texture goes on.
        """
        if self.wrap:
            raise InputError(
                f"{path}: {key}: {self.name}: expected textures that repeat (REPEAT) where UVs leave [0, 1], got"
                f" {self.wrap}; move the UVs into [0, 1], or export it with repeating textures"
            )


def uv_of_material(material: dict[str, Any], uv_set: int | None) -> tuple[int, Float]:
    """Which UV set is meant, and the KHR_texture_transform of the texture that reads it (in glTF's space, v down)."""
    physical = material.get("pbrMetallicRoughness", {})
    textures = [physical.get("baseColorTexture"), physical.get("metallicRoughnessTexture")]
    textures += [material.get(name) for name in OTHER_TEXTURES]
    for texture in textures:
        if texture is None:
            continue
        of_texture, transform = _uv_of_texture(texture)
        if uv_set is None or of_texture == uv_set:
            return of_texture, transform
    return uv_set or 0, np.eye(3)


def tangents_fit(material: dict[str, Any], chosen: int, transform: Float) -> bool:
    """Whether tangents of a file are those of the UVs that were chosen: those of its normal map, not transformed.

    Parameters
    ----------
    material : dict
        As the file has it.
    chosen : int
        UV set.
    transform : ndarray of shape (3, 3)
        Of these UVs.
    """
    of_normals, _ = _uv_of_texture(material.get("normalTexture") or {})
    return chosen == of_normals and bool((transform == np.eye(3)).all())


def read_materials(
    file: GltfFile, indices: Sequence[int], uv_set: int | None, textures: Sequence[str] = TEXTURES
) -> tuple[GltfMaterial, ...]:
    """Materials by their indices; -1 is the one of a primitive without any.

    Parameters
    ----------
    file : GltfFile
    indices : sequence of int
    uv_set : int or None
        Of the look: by which the mesh was read.
    textures : sequence of str
        Which are wanted, of TEXTURES; others are left out, whatever is wrong with them.

    Raises
    ------
    InputError
        A texture that is read by other UVs than the mesh has, or whose picture is of a kind that is not supported.
    """
    try:
        return tuple(_material(file, index, uv_set, textures) for index in indices)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{file.path}: damaged material ({type(error).__name__}: {str(error)[:120]})") from None


def _material(file: GltfFile, index: int, uv_set: int | None, textures: Sequence[str]) -> GltfMaterial:
    if index < 0:
        return GltfMaterial("none")
    entry = file.item("materials", index)
    name = str(entry.get("name") or f"material {index}")
    if "KHR_materials_pbrSpecularGlossiness" in entry.get("extensions", {}):
        raise InputError(
            f"{file.path}: {name} uses KHR_materials_pbrSpecularGlossiness, which is not supported;"
            " export it with metallic-roughness materials, or name the pictures in the look"
        )
    physical = entry.get("pbrMetallicRoughness", {})
    chosen = uv_of_material(entry, uv_set)
    wraps = []

    def image(texture: dict[str, Any] | None, of: str, key: str) -> int | None:
        """Index of a texture's image."""
        if texture is None or of not in textures:
            return None
        by = _uv_of_texture(texture)
        if by[0] != chosen[0] or not np.allclose(by[1], chosen[1]):
            raise InputError(
                f"{file.path}: {name}: its {key} is read by other UVs than the mesh (TEXCOORD_{by[0]}, the"
                f" mesh by TEXCOORD_{chosen[0]}, or another KHR_texture_transform); set mesh.uv_set, or name the"
                " pictures in the look"
            )
        wraps.append(_wrap_of(file, texture["index"]))
        return _image_of(file, texture["index"], f"{name}: {key}")

    rgb = physical.get("baseColorFactor")
    normal, roughness = entry.get("normalTexture"), physical.get("roughnessFactor")
    made = GltfMaterial(
        name,
        image(physical.get("baseColorTexture"), "base", "baseColorTexture"),
        None if rgb is None else (float(rgb[0]), float(rgb[1]), float(rgb[2])),
        image(physical.get("metallicRoughnessTexture"), "roughness", "metallicRoughnessTexture"),
        None if roughness is None else float(roughness),
        image(normal, "normal", "normalTexture"),
        1.0 if normal is None else float(normal.get("scale", 1.0)),
        str(entry.get("alphaMode", "OPAQUE")),
        1.0 if rgb is None else float(rgb[3]),
        float(entry.get("alphaCutoff", 0.5)),
    )
    return replace(made, wrap=next(filter(None, wraps), ""))


def _wrap_of(file: GltfFile, texture: Any) -> str:
    """How a texture goes on outside [0, 1], by name; empty where it repeats."""
    sampler = file.item("textures", texture).get("sampler")
    entry = {} if sampler is None else file.item("samplers", sampler)
    wraps = (entry.get(axis, REPEAT) for axis in ("wrapS", "wrapT"))
    return next((WRAPS.get(wrap, f"a wrap of {wrap}") for wrap in wraps if wrap != REPEAT), "")


def _image_of(file: GltfFile, texture: Any, what: str) -> int:
    entry = file.item("textures", texture)
    extensions = entry.get("extensions", {})
    source = entry.get("source", extensions.get("EXT_texture_webp", {}).get("source"))
    if source is None:
        kind = next((PICTURES[name] for name in extensions if name in PICTURES), "a texture without a picture")
        raise InputError(
            f"{file.path}: {what}: expected a PNG or JPEG, got {kind}, which is not supported;"
            " export it with PNG or JPEG textures, or name the pictures in the look"
        )
    return int(source)


def picture_of(file: GltfFile, index: int, folder: Path) -> tuple[Path, str]:
    """The file of an image, and what it is called in messages; one that lies inside the glTF is written to `folder`.

    Parameters
    ----------
    file : GltfFile
    index : int
        Of the image.
    folder : Path
        For pictures that are no files of their own; whoever gives it removes it.

    Raises
    ------
    InputError
        Its data are missing.
    """
    entry = file.item("images", index)
    uri = entry.get("uri")
    beside = file_of(file.path, uri)
    if beside is not None:
        return beside, str(beside)
    data = bytes(file.view(entry["bufferView"])[0]) if uri is None else file.resource(uri)
    kind = entry.get("mimeType") or str(uri or "").partition(";")[0].removeprefix("data:")
    path = folder / f"{index}{SUFFIX.get(kind, '.png')}"
    if not path.exists():
        path.write_bytes(data)
    named = f" ({entry['name']})" if entry.get("name") else ""
    return path, f"{file.path}: image {index}{named}"


def _uv_of_texture(texture: dict[str, Any]) -> tuple[int, Float]:
    """UV set of a texture, and its KHR_texture_transform."""
    extension = texture.get("extensions", {}).get("KHR_texture_transform", {})
    return int(extension.get("texCoord", texture.get("texCoord", 0))), _texture_transform(extension)


def _texture_transform(extension: dict[str, Any]) -> Float:
    angle = float(extension.get("rotation", 0.0))
    cos, sin = np.cos(angle), np.sin(angle)
    u, v = np.asarray(extension.get("scale", (1, 1)), dtype=np.float64)
    du, dv = np.asarray(extension.get("offset", (0, 0)), dtype=np.float64)
    return np.array([[cos * u, sin * v, du], [-sin * u, cos * v, dv], [0.0, 0.0, 1.0]])
