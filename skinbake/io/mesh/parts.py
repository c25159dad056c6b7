"""Which triangles of a file are skin, which only cast shadows, and which are left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.mesh.raw_mesh import RawMesh

SKIN, CAST, IGNORE = "skin", "cast", "ignore"
LISTED = 12  # names in a message


@dataclass(frozen=True)
class Roles:
    """What became of the triangles of a file.

    Attributes
    ----------
    of_part : tuple of "skin", "cast" or "ignore"
    skin, cast : ndarrays of shape (F,), bool
    notes : tuple of str
        Triangles whose role is not that of their part, in words.
    """

    of_part: tuple[str, ...]
    skin: NDArray[np.bool_]
    cast: NDArray[np.bool_]
    notes: tuple[str, ...]


def choose_parts(
    path: Path,
    raw: RawMesh,
    skin: Sequence[str] = (),
    cast: Sequence[str] = (),
    ignore: Sequence[str] = (),
    uvs_needed: bool = True,
    key: str = "",
) -> Roles:
    """Give each part its role; `ignore` goes before `cast`, and that before `skin`.

    Without `skin`, what is neither cast nor ignored is skin; with it, what it leaves out casts. Triangles without UVs
    only cast where others have some.

    Parameters
    ----------
    path : path
        For messages.
    raw : RawMesh
    skin, cast, ignore : sequences of str
        Names, or patterns with * and ?.
    uvs_needed : bool
        False where UVs are made anew.
    key : str
        Of the look, for messages about `skin`; mesh.skin by default.

    Raises
    ------
    InputError
        A pattern that no part answers to, nothing that is skin, or skin without UVs.
    """
    wanted = {SKIN: (key or "mesh.skin", skin), CAST: ("mesh.cast", cast), IGNORE: ("mesh.ignore", ignore)}
    chosen = {role: parts_matching(path, raw, *patterns) for role, patterns in wanted.items()}
    rest = CAST if skin else SKIN
    of_part = tuple(
        next((role for role in (IGNORE, CAST, SKIN) if part in chosen[role]), rest) for part in range(len(raw.names))
    )
    role_of_face = np.array(of_part)[raw.part]
    is_skin, is_cast = role_of_face == SKIN, role_of_face == CAST
    if not is_skin.any():
        raise InputError(f"{path}: expected a part that is skin, got none: {_listed(raw)} are cast or ignored")
    notes: list[str] = []
    bare = is_skin & ~raw.has_uv
    if uvs_needed and bare.any():
        _refuse_bare(path, raw, bare, is_skin, chosen[SKIN])
        for part in np.unique(raw.part[bare]).tolist():
            count = int(np.count_nonzero(bare & (raw.part == part)))
            notes.append(f"{raw.labels[part]}: {count} triangles without UVs only cast shadows")
        is_skin, is_cast = is_skin & ~bare, is_cast | bare
    return Roles(of_part, is_skin, is_cast, tuple(notes))


def _refuse_bare(path: Path, raw: RawMesh, bare: NDArray[np.bool_], skin: NDArray[np.bool_], named: set[int]) -> None:
    """Refuse skin without UVs that the look asks for, or where there is no other."""
    if (bare == skin).all():
        raise InputError(
            f"{path}: expected UVs, the mesh has none; add them, or set texture.unwrap: xatlas to make them"
        )
    without = [part for part in sorted(named) if bare[raw.part == part].any()]
    if without:
        raise InputError(
            f"{path}: mesh.skin: expected UVs, {_some([raw.labels[part] for part in without])} has none; add them,"
            " or put it under mesh.cast to keep it as a shadow"
        )


def parts_matching(path: Path, raw: RawMesh, key: str, patterns: Sequence[str]) -> set[int]:
    """Parts one of whose names answers to one of the patterns.

    Parameters
    ----------
    path : Path
        For messages.
    raw : RawMesh
    key : str
        Of the look, for messages.
    patterns : sequence of str

    Raises
    ------
    InputError
        A pattern that no part answers to.
    """
    found: set[int] = set()
    for pattern in patterns:
        parts = {
            part
            for part, (names, label) in enumerate(zip(raw.names, raw.labels, strict=True))
            if any(name == pattern or fnmatchcase(name, pattern) for name in (*names, label))
        }
        if not parts:
            raise InputError(f"{path}: {key}: no part is called {pattern!r}; there are {_listed(raw)}")
        found |= parts
    return found


def _listed(raw: RawMesh) -> str:
    return _some(list(dict.fromkeys(name for names in raw.names for name in names)) or ["no names"])


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more
