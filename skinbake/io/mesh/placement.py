"""Where a file's mesh lies in the scene: millimetres, y up, the face along z."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from skinbake.errors import InputError
from skinbake.io.mesh.raw_file import refuse_endless
from skinbake.io.mesh.raw_mesh import RawMesh
from skinbake.numerics import Float

UP = {"y": np.eye(3), "z": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])}
FRONT = {
    "z": np.eye(3),
    "-z": np.diag([-1.0, 1, -1]),
    "x": np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),
    "-x": np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
}


def turned_axes(raw: RawMesh, up: str | None = None, front: str = "z") -> Float:
    """The rotation that `placed` does, for vectors as columns, shape (3, 3).

    Parameters
    ----------
    raw : RawMesh
    up : "y", "z" or None
    front : str
        As of `placed`.
    """
    turn: Float = FRONT[front] @ UP[up or raw.up or "y"]
    return turn


def placed(path: Path, raw: RawMesh, mm_per_unit: float | None, up: str | None = None, front: str = "z") -> RawMesh:
    """The mesh in millimetres, turned so that y is up and the face looks along z.

    Parameters
    ----------
    path : path
        For messages.
    raw : RawMesh
    mm_per_unit : float or None
        None: what the file says.
    up : "y", "z" or None
        Which of the file's axes is up; None: what the file says, else y.
    front : "z", "-z", "x" or "-x"
        Along which the face looks once up is up.

    Raises
    ------
    InputError
        The file does not say its unit though it should, or is too large for arithmetic.
    """
    if mm_per_unit is None:
        mm_per_unit = raw.mm_per_unit
    if mm_per_unit is None:
        raise InputError(
            f"{path}: unit: file: expected a file that says its unit, as glTF and USD do, got {path.suffix.lower()};"
            " set mesh.unit: mm, cm or m"
        )
    with np.errstate(over="ignore"):  # what overflows is infinite, and refused
        positions = raw.positions * mm_per_unit
    refuse_endless(path, positions)
    turn = turned_axes(raw, up, front)
    if (turn == np.eye(3)).all():
        return replace(raw, positions=positions, mm_per_unit=mm_per_unit)
    return replace(
        raw,
        positions=positions @ turn.T,
        corner_normal=raw.corner_normal @ turn.T,
        corner_tangent=None if raw.corner_tangent is None else raw.corner_tangent @ turn.T,
        mm_per_unit=mm_per_unit,
    )
