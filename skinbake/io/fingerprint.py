"""Digests (sha256) of what a file or a stage depends on: the same inputs give the same key, so a key tells what is
stale.
"""

from __future__ import annotations

import os
from pathlib import Path

from skinbake.errors import InputError
from skinbake.io.digests import key_of, sha256_of
from skinbake.io.mesh.files import mesh_files
from skinbake.io.tile_names import names_tiles, tile_files
from skinbake.scene.mesh_files import OF_FILE
from skinbake.scene.spec import SceneSpec


def input_files(spec: SceneSpec) -> dict[str, tuple[Path, ...]]:
    """Files a look reads, by role; a map whose path names tiles has one file a tile, a .gltf may name others.

    Raises
    ------
    InputError
        A pattern that no file matches.
    """
    roles: dict[str, str | None] = {"mesh": spec.mesh.path, **_pictures(spec)}
    spaces = [chosen.color_space for chosen in spec.maps.files().values()]
    spaces += [getattr(light, "color_space", "auto") for light in spec.lights]
    if set(spaces) - {"auto", "srgb", "linear"}:
        config = os.environ.get("OCIO", "")
        roles["ocio"] = config if os.path.isfile(config) else None
    roles["skin"] = getattr(spec.skin, "path", None)
    found = {role: tuple(files_named(path)) for role, path in roles.items() if path is not None}
    found["mesh"] = mesh_files(spec.mesh.path)
    for index, picture in enumerate(spec.mesh.opacity.values()):
        if picture != OF_FILE:
            found[f"occluder.mesh.{index}.opacity"] = (Path(picture),)
    for index, occluder in enumerate(spec.occluders):
        found[f"occluder.{index}"] = mesh_files(occluder.path)
        if occluder.opacity not in (None, OF_FILE):
            found[f"occluder.{index}.opacity"] = (Path(str(occluder.opacity)),)
    for role, files in found.items():
        if not files:
            raise InputError(f"{roles[role]}: expected a file for at least one UDIM tile, found none")
    return found


def every_input(spec: SceneSpec) -> list[Path]:
    """Files a look reads, whatever their role.

    Raises
    ------
    InputError
        A pattern that no file matches.
    """
    return [path for paths in input_files(spec).values() for path in paths]


def files_named(path: str) -> list[Path]:
    """The file of a path, there or not; of one with `<UDIM>`, the tiles' files that are there."""
    return list(tile_files(path).values())


def _pictures(spec: SceneSpec) -> dict[str, str | None]:
    """Paths of maps and skies by role: they may name tiles."""
    skies = {f"light.{light.name}": getattr(light, "path", None) for light in spec.lights}
    return {role: chosen.path for role, chosen in spec.maps.files().items()} | skies


def digest_of(spec: SceneSpec, role: str, paths: tuple[Path, ...]) -> str:
    """Digest of one role: of its file, of its tiles by their numbers, or of its files by their names.

    Parameters
    ----------
    spec : SceneSpec
    role : str
    paths : tuple of Path
        The role's, of `input_files`.

    Raises
    ------
    InputError
        A file is missing or cannot be read.
    """
    named = _pictures(spec).get(role)
    if named is not None and names_tiles(named):
        return key_of([(tile, sha256_of(path)) for tile, path in tile_files(named).items()])
    return sha256_of(paths[0]) if len(paths) == 1 else key_of([(p.name, sha256_of(p)) for p in paths])


def input_hashes(spec: SceneSpec) -> dict[str, str]:
    """Digest of each role's file or files."""
    return {role: digest_of(spec, role, paths) for role, paths in input_files(spec).items()}


def input_stamps(spec: SceneSpec) -> dict[Path, tuple[int, ...] | None]:
    """Time, size and place of every input, None where it is gone: they tell whether a file was changed meanwhile."""
    return {path: stamp(path) for paths in input_files(spec).values() for path in paths}


def stamp(path: Path) -> tuple[int, ...] | None:
    """Time, size and place of a file, None where it is gone."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino
