"""A first look for a mesh: a commented YAML that bakes as it stands."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import FIRST_TILE, rasterize, uv_report
from skinbake.errors import InputError
from skinbake.io.mesh.gltf_file import GltfFile
from skinbake.io.mesh.gltf_material import read_materials
from skinbake.io.mesh.orientation import guess_orientation
from skinbake.io.mesh.placement import placed
from skinbake.io.mesh.raw_file import read_raw
from skinbake.io.mesh.raw_mesh import RawMesh
from skinbake.io.mesh.read_mesh import skin_of
from skinbake.io.mesh.size import BODY_MM, HEAD_MM, TYPICAL_BODY_MM, TYPICAL_HEAD_MM
from skinbake.io.tile_names import name_of_tiles
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.mesh_files import MM_PER_UNIT

# Words in the names of parts. What is clear or thinner than a triangle's shadow is left out
IGNORED = ("lash", "occlusion", "lacrimal", "fluid", "tear", "blend", "cornea", "collision", "proxy")
CASTING = ("eye", "iris", "sclera", "pupil", "teeth", "tooth", "tongue", "gum", "hair", "brow", "beard", "hat", "cap",
           "glass", "cloth", "shirt", "collar", "jacket", "dress", "shoe", "jewel", "ring", "helmet")  # fmt: skip
SKIN_AFTER_ALL = ("socket", "lid", "skin", "face", "head", "ear")
ON_SKIN = ("hair", "beard")  # whatever it grows on
FACE, SMALL_SHARE = "face", 0.05  # what goes before larger parts of skin, unless it is smaller than that beside them
STACKED_SHARE = 0.01  # of a part's texels that another may already have
RASTER = 256
YAML_WORDS = ("y", "n", "yes", "no", "on", "off", "true", "false", "null", ".", "..")
PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr", ".tga")
MAP_WORDS = {
    "albedo": ("albedo", "basecolor", "base_color", "diffuse", "color", "colour", "col"),
    "normal": ("normal", "nrm", "nor"),
    "roughness": ("roughness", "rough"),
}


@dataclass(frozen=True)
class _Chosen:
    """What is written about the mesh; `stacked` would be skin if it had a place of its own in the texture."""

    skin: tuple[str, ...]
    ignore: tuple[str, ...]
    unwrap: bool
    tiles: tuple[int, ...]  # none where there is one texture
    stacked: tuple[str, ...]


def first_look(path: Path, look: Path) -> str:
    """Text of a look for a mesh, its paths relative to where the look will lie.

    Parameters
    ----------
    path : path
        Of the mesh.
    look : path
        Of the YAML file.

    Raises
    ------
    InputError
        The mesh is missing or unusable.
    """
    raw = read_raw(path)
    stands = raw.up == "z"  # by what the file says, which a look need not repeat
    if stands:
        raw = replace(placed(path, raw, 1.0), mm_per_unit=raw.mm_per_unit, up=None)
    chosen, mesh = _choose(path, raw)
    unit, mm_per_unit, any_size = _unit(raw, mesh)
    mesh = replace(mesh, positions_mm=mesh.positions_mm * mm_per_unit)
    seen = guess_orientation(mesh)
    up = "z" if seen.crown == "+z" and not stands else None
    if up:
        turned = placed(path, raw, mm_per_unit, up)
        parts = [part for part, label in enumerate(raw.labels) if label in chosen.skin]
        mesh = skin_of(turned, np.isin(raw.part, parts) if parts else np.ones(len(raw.faces), np.bool_))
        seen = guess_orientation(mesh)
    front = seen.face.lstrip("+") if seen.face in ("-z", "+x", "-x") and seen.crown == "+y" else None

    folder = look.absolute().parent
    relative = _quoted(os.path.relpath(path, folder))
    entries = [f"path: {relative}", unit]
    entries += [f"up: {up}"] if up else []
    entries += [f"front: {front}"] if front else []
    entries += ["any_size: true"] if any_size else []
    entries += [f"skin: [{', '.join(map(_quoted, chosen.skin))}]"] if chosen.skin else []
    entries += [f"ignore: [{', '.join(map(_quoted, chosen.ignore))}]"] if chosen.ignore else []
    entries += ["opacity: file"] if _cast_has_alpha(path, raw, chosen) else []
    texture = (
        "size: 2048, gutter: 8"
        + (", udim: true" if chosen.tiles else "")
        + (", unwrap: xatlas" if chosen.unwrap else "")
    )
    lines = [
        f"# {path.name}, as `skinbake init` understood it. `skinbake check {look.name}` says what a bake would meet."
    ]
    lines += _about(raw, mesh, chosen)
    lines += [f"mesh: {{{', '.join(entries)}}}", *_maps(path, folder, chosen, raw), f"texture: {{{texture}}}"]
    lines += [
        "skin: {preset: gpugems3-six-gaussians}  # or donner-three-layer, physiology-light, physiology-dark, ...",
        *_lights(mesh, front),
        f"output: {{dir: {_quoted('out/' + look.stem)}}}",
        "preview: {view: three-quarter}",
    ]
    return "\n".join(lines) + "\n"


def _choose(path: Path, raw: RawMesh) -> tuple[_Chosen, SkinMesh]:
    """Parts that are skin, by their names and as far as their UVs leave room for one another."""
    kinds = [_kind(names) for names in raw.names]
    labelled = [part for part, names in enumerate(raw.names) if names]
    candidates = [part for part, kind in enumerate(kinds) if kind == "skin"]
    with_uv = [part for part in candidates if raw.has_uv[raw.part == part].all()]
    no_uvs = not with_uv
    candidates = with_uv or candidates or list(range(len(raw.names)))
    area = np.bincount(raw.part, SkinMesh(raw.positions, raw.faces, raw.corner_uv, raw.corner_normal).face_area_mm2,
                       len(raw.names))  # fmt: skip
    least = SMALL_SHARE * max(area[part] for part in candidates)
    candidates.sort(key=lambda part: (not (area[part] > least and _is_face(raw.names[part])), -area[part]))
    kept, taken = list[int](), dict[int, NDArray[np.bool_]]()
    for part in candidates:
        texels = {} if no_uvs else _texels(raw, part)
        total = sum(int(mask.sum()) for mask in texels.values())
        shared = sum(int((mask & taken[tile]).sum()) for tile, mask in texels.items() if tile in taken)
        if kept and total and shared > STACKED_SHARE * total:
            continue
        kept.append(part)
        for tile, mask in texels.items():
            taken[tile] = taken[tile] | mask if tile in taken else mask
    skin = np.isin(raw.part, kept)
    mesh = skin_of(raw, skin)
    udim = bool(taken) and set(taken) != {FIRST_TILE}
    unwrap = no_uvs
    if not no_uvs and not udim:
        unwrap = bool(uv_report(mesh, rasterize(mesh, (RASTER, RASTER), 0)).overlapping_share > STACKED_SHARE)
    everything = len(kept) == len(raw.names)
    names = () if everything else tuple(raw.labels[part] for part in sorted(kept))
    ignored = [part for part in labelled if kinds[part] == "ignore" and part not in kept]
    if not everything and not labelled:
        names = ()
    stacked = [part for part in labelled if part in candidates and part not in kept and area[part] > least]
    ignore, left = (tuple(raw.labels[part] for part in parts) for parts in (ignored, stacked))
    return _Chosen(names, ignore, unwrap, tuple(sorted(taken)) if udim else (), left), mesh


def _kind(names: Sequence[str]) -> str:
    """What a part seems to be, by the words in its names."""
    text = " ".join(names).lower()
    words = re.split(r"[^a-z]+|(?<=[a-z])(?=[A-Z])", text)
    if any(word in text for word in IGNORED):
        return "ignore"
    grows = any(word in text for word in ON_SKIN)
    if not grows and any(word in text for word in SKIN_AFTER_ALL if word != "ear" or "ear" in words):
        return "skin"
    return "cast" if any(word in text for word in CASTING) else "skin"


def _is_face(names: Sequence[str]) -> bool:
    """Whether a part seems to be the face, and nothing that lies on it."""
    text = " ".join(names)
    words = {word.lower() for word in re.split(r"[^A-Za-z]+|(?<=[a-z])(?=[A-Z])", text)}
    return FACE in words and not any(word in text.lower() for word in CASTING)


def _texels(raw: RawMesh, part: int) -> dict[int, NDArray[np.bool_]]:
    """Texels that a part covers, by tile."""
    try:
        atlas = rasterize(skin_of(raw, raw.part == part), (RASTER, RASTER), 0, udim=True)
    except InputError:  # charts left of the tiles: the bake will say so
        return {}
    return {
        raster.tile: raster.coverage > 0.5 for raster in atlas if raster.covered.any()
    }  # a shared edge is no overlap


def _unit(raw: RawMesh, mesh: SkinMesh) -> tuple[str, float, bool]:
    """The unit in YAML, its length in mm, and whether the mesh is no head by it."""
    longest = float(np.ptp(mesh.positions_mm, axis=0).max())
    if longest <= 0:
        raise InputError("expected a mesh of some size, got a single point")
    named = {name: MM_PER_UNIT[name] for name in ("mm", "cm", "m", "inch", "dm")}
    own = {"file": raw.mm_per_unit} if raw.mm_per_unit else {}
    for choices, limits, typical in (
        (own, HEAD_MM, TYPICAL_HEAD_MM),
        (own, BODY_MM, TYPICAL_BODY_MM),
        (named, HEAD_MM, TYPICAL_HEAD_MM),
        (named, BODY_MM, TYPICAL_BODY_MM),
    ):
        fitting = {name: mm for name, mm in choices.items() if limits[0] <= longest * mm <= limits[1]}
        if fitting:
            best = min(fitting, key=lambda name: abs(np.log(longest * fitting[name] / typical)))
            return f"unit: {best}", fitting[best], limits is BODY_MM
    factor = float(f"{TYPICAL_HEAD_MM / longest:.4g}")
    return f"mm_per_unit: {factor:g}", factor, False


def _about(raw: RawMesh, mesh: SkinMesh, chosen: _Chosen) -> list[str]:
    """Comments on size and parts."""
    extent = " x ".join(f"{x:.0f}" for x in np.ptp(mesh.positions_mm, axis=0))
    lines = [f"# The skin measures {extent} mm in {len(mesh.faces)} triangles; if that is wrong, so is the unit."]
    if any(raw.names):
        lines.append("# Parts; those that mesh.skin leaves out cast shadows, those under mesh.ignore do not:")
        counts = np.bincount(raw.part, minlength=len(raw.names))
        for label, count in zip(raw.labels, counts, strict=True):
            role = "skin" if label in chosen.skin or not chosen.skin else "cast"
            role = "ignore" if label in chosen.ignore else role
            lines.append(f"#   {role:<6} {label} ({count} triangles)")
    if chosen.stacked:
        lines.append(
            f"# {', '.join(chosen.stacked)}: skin, too, but with UVs where other skin has its own. Name it under"
        )
        lines.append(
            "# mesh.skin in a look of its own; or, if no maps are painted, all here, with texture.unwrap: xatlas."
        )
    if chosen.unwrap:
        lines.append("# UVs are made anew (texture.unwrap): there are none, or charts lie on one another.")
    return lines


def _maps(path: Path, folder: Path, chosen: _Chosen, raw: RawMesh) -> list[str]:
    """Maps in the mesh's own file, or found beside it by name, or a skin colour."""
    if _has_own_uvs(chosen) and _materials_hold_maps(path, raw, chosen):
        return ["maps: file  # base colour, normals and roughness of the file's own materials"]
    found = {role: file for role in MAP_WORDS if (file := _map_beside(path, role, chosen.tiles)) is not None}
    if not _has_own_uvs(chosen):
        found = {}
    lines = ["maps:"]
    lines += [f"  {role}: {_quoted(os.path.relpath(file, folder))}" for role, file in found.items()]
    if "albedo" not in found:
        lines.append(
            "  albedo_rgb: [0.57, 0.33, 0.23]  # linear; a map of the skin's colour goes here as albedo: skin.png"
        )
    return lines


def _has_own_uvs(chosen: _Chosen) -> bool:
    """Whether maps can have been painted for this mesh."""
    return not chosen.unwrap


def _materials_hold_maps(path: Path, raw: RawMesh, chosen: _Chosen) -> bool:
    """Whether the skin's materials have pictures of its colour that `maps: file` can take."""
    if not raw.material:
        return False
    labels = chosen.skin or raw.labels
    used = {index for index, label in zip(raw.material, raw.labels, strict=True) if label in labels}
    try:
        materials = read_materials(GltfFile(path), sorted(used), None)
    except InputError:
        return False
    alike = {replace(material, name="") for material in materials}
    return all(material.base_image is not None for material in materials) and (bool(chosen.tiles) or len(alike) == 1)


def _cast_has_alpha(path: Path, raw: RawMesh, chosen: _Chosen) -> bool:
    """Whether what casts has materials that are not opaque, such as hair cards."""
    cast = [label not in (*chosen.skin, *chosen.ignore) for label in raw.labels] if chosen.skin else []
    used = {index for index, casts in zip(raw.material, cast, strict=False) if casts}
    try:
        materials = read_materials(GltfFile(path), sorted(used), None, ("base",)) if used else ()
    except InputError:
        return False
    return any(each.alpha_mode != "OPAQUE" for each in materials)


def _map_beside(path: Path, role: str, tiles: tuple[int, ...]) -> Path | None:
    """The one picture, or one a tile, beside the mesh or in textures/ there whose name says that it is this map."""
    folders = [folder for folder in (path.parent, path.parent / "textures") if folder.is_dir()]
    pictures = [file for folder in folders for file in sorted(folder.iterdir()) if file.suffix.lower() in PICTURES]
    named = [
        file
        for file in pictures
        if set(re.split(r"[^a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", file.stem).lower())) & set(MAP_WORDS[role])
    ]
    own = [file for file in named if file.stem.lower().startswith(path.stem.lower())]
    choice = {file.with_name(name_of_tiles(file.name, tiles)) for file in own or named}
    return choice.pop() if len(choice) == 1 else None


def _lights(mesh: SkinMesh, front: str | None) -> list[str]:
    """Key, rim and sky about the head; the key a soft box of the head's size."""
    low, high = mesh.positions_mm.min(axis=0), mesh.positions_mm.max(axis=0)
    if front:
        from skinbake.io.mesh.placement import FRONT

        ends = np.stack([low, high]) @ FRONT[front].T
        low, high = ends.min(axis=0), ends.max(axis=0)
    centre, size = (low + high) / 2, float((high - low).max())
    away = np.array([0.62, 0.5, 0.6])
    away /= np.linalg.norm(away)
    position = centre + 3 * size * away
    # Edges whose cross product points at the head
    across = np.cross([0.0, 1.0, 0.0], -away)
    across *= size / np.linalg.norm(across)
    upright = np.cross(-away, across / size) * size
    key = {
        "name": "key", "type": "rectangle", "position_mm": position, "edge_u_mm": across, "edge_v_mm": upright,
        "radiance": np.array([3.2, 3.0, 2.75]) * 9,
    }  # fmt: skip
    lines = ["lights:", f"  - {_flow(key)}  # a soft box, a head's size, three heads away"]
    lines.append("  - {name: rim, type: directional, direction: [0.62, -0.25, 0.74], irradiance: [1.0, 1.15, 1.4]}")
    lines.append("  - {name: sky, type: environment, radiance: [0.11, 0.125, 0.15]}")
    return lines


def _flow(entry: dict[str, object]) -> str:
    """A mapping as one line of YAML."""
    words = [
        f"{key}: [{', '.join(f'{x:.4g}' for x in value)}]" if isinstance(value, np.ndarray) else f"{key}: {value}"
        for key, value in entry.items()
    ]
    return f"{{{', '.join(words)}}}"


def _quoted(text: str) -> str:
    """Text as YAML has it, in quotes where it needs them."""
    plain = re.fullmatch(r"[A-Za-z_./][A-Za-z0-9_./-]*", text) and text.lower() not in YAML_WORDS
    return text if plain else json.dumps(text, ensure_ascii=False)
