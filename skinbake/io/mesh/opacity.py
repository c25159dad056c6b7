"""Pictures that say where what casts shadows lets light pass: hair cards, lashes, lace."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError, SkinbakeError
from skinbake.io.image import read_opacity
from skinbake.io.mesh.gltf_file import GltfFile
from skinbake.io.mesh.gltf_material import GltfMaterial, picture_of, read_materials
from skinbake.io.mesh.parts import parts_matching
from skinbake.io.mesh.raw_mesh import RawMesh
from skinbake.scene.casters import Casters
from skinbake.scene.mesh_files import OF_FILE

Image = NDArray[np.float32]
PAST_THE_EDGE = 1e-3  # of a texture: UVs are drawn to its edge by hand


def with_opacity(
    path: Path,
    raw: RawMesh,
    cast: NDArray[np.bool_],
    casters: Casters,
    pictures: Mapping[str, str],
    uv_set: int | None,
    key: str,
) -> Casters:
    """Casters with their pictures.

    Parameters
    ----------
    path : Path
        Of the mesh.
    raw : RawMesh
    cast : ndarray of shape (F,), bool
        Triangles that became the casters, in their order.
    casters : Casters
        Opaque.
    pictures : mapping of str to str
        Paths by names or patterns of parts; `file` stands for the alpha of a glTF's own materials.
    uv_set : int or None
        Of the look.
    key : str
        Of the look, for messages.

    Raises
    ------
    InputError
        A picture cannot be read, no part that casts has the name, or there are no UVs for it.
    """
    image, opacity = casters.image.copy(), list(casters.opacity)
    part = raw.part[cast]
    known: dict[str, int] = {}
    for pattern, picture in pictures.items():
        chosen = sorted(parts_matching(path, raw, key, [pattern]) & set(np.unique(part).tolist()))
        if not chosen:
            raise InputError(f"{path}: {key}: expected parts that cast shadows, {pattern!r} names none; see mesh.cast")
        of_part = _of_materials(path, raw, chosen, uv_set, key) if picture == OF_FILE else {}
        for number in chosen:
            if picture == OF_FILE and number not in of_part:
                continue
            is_even = picture == OF_FILE and of_part[number].size == 1
            if not is_even and not raw.has_uv[cast][part == number].all():
                raise InputError(f"{path}: {key}: expected UVs by which to look it up, {raw.labels[number]} has none")
            if picture == OF_FILE:
                opacity.append(of_part[number])
                image[part == number] = len(opacity) - 1
                continue
            if picture not in known:
                known[picture] = len(opacity)
                opacity.append(read_opacity(picture))
            image[part == number] = known[picture]
    return replace(casters, image=image, opacity=tuple(opacity))


def _of_materials(path: Path, raw: RawMesh, parts: list[int], uv_set: int | None, key: str) -> dict[int, Image]:
    """Opacity of parts whose material is not opaque."""
    if not raw.material:
        got = path.suffix.lower()
        raise InputError(f"{path}: {key}: file: expected a glTF or GLB, whose materials have an alpha, got {got}")
    file = GltfFile(path)
    found = {}
    with TemporaryDirectory() as folder:
        for part in parts:
            (material,) = read_materials(file, [raw.material[part]], uv_set, ("base",))
            if material.alpha_mode != "OPAQUE":
                uv = raw.corner_uv[raw.part == part]
                if uv.min() < -PAST_THE_EDGE or uv.max() > 1 + PAST_THE_EDGE:
                    material.refuse_outside(path, f"{key}: file")
                found[part] = _of_material(file, material, Path(folder), key)
    return found


def _of_material(file: GltfFile, material: GltfMaterial, folder: Path, key: str) -> Image:
    """Alpha of the base colour times its factor; cut to 0 and 1 where the material says MASK."""
    alpha = np.ones((1, 1), np.float32)
    if material.base_image is not None:
        path, called = picture_of(file, material.base_image, folder)
        try:
            alpha = read_opacity(path, or_grey=False)
        except SkinbakeError as error:
            raise type(error)(f"{key}: " + str(error).replace(str(path), called)) from error
    alpha = np.clip(alpha * np.float32(material.alpha), 0, 1)
    return (alpha >= material.alpha_cutoff).astype(np.float32) if material.alpha_mode == "MASK" else alpha
