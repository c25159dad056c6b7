"""From UVs to tiles and texels. v grows up and rows grow down: the one turns into the other here and nowhere else."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.kernels.compile import kernel
from skinbake.numerics import Float
from skinbake.scene.mesh import SkinMesh

FIRST_TILE = 1001


def texel_xy(u: Any, v: Any, height: int, width: int) -> tuple[Any, Any]:
    """Place of a UV within a texture, in texels: x to the right, y down; texel (row, col) begins at (col, row).

    Parameters
    ----------
    u, v : float or ndarray
        Within the tile, 0 ... 1.
    height, width : int
        Size of the texture.
    """
    return u * width, (1.0 - v) * height


texel_xy_kernel = kernel(inline=True)(texel_xy)


def corner_texels(mesh: SkinMesh, tile: int, shape: tuple[int, int]) -> Float:
    """Place of each corner of each face in a tile's texture, (x, y) in texels, shape (F, 3, 2).

    Parameters
    ----------
    mesh : SkinMesh
    tile : int
        UDIM number; corners of other tiles lie outside the texture.
    shape : tuple of 2 ints
        (height, width) of the texture.
    """
    local = local_uv(mesh.corner_uv, tile)
    return np.stack(texel_xy(local[..., 0], local[..., 1], *shape), axis=-1)


def local_uv(uv: Float, tile: int) -> Float:
    """UVs (..., 2) measured from the lower left corner of their tile: 0 ... 1 within it."""
    return uv - np.asarray(tile_origin(tile), dtype=np.float64)


def tile_origin(tile: int) -> tuple[int, int]:
    """Lower left corner (u, v) of a UDIM tile."""
    return (tile - FIRST_TILE) % 10, (tile - FIRST_TILE) // 10


def tile_of_face(mesh: SkinMesh, udim: bool) -> NDArray[np.int64]:
    """UDIM number of the tile that holds each face's centre, shape (F,); without `udim` there is one tile.

    Raises
    ------
    InputError
        If a face lies where there is no tile.
    """
    if not udim:
        return np.full(len(mesh.faces), FIRST_TILE)
    cell = np.floor(mesh.corner_uv.mean(axis=1))
    outside = (cell < 0).any(axis=1) | (cell[:, 0] > 9) | (cell[:, 1] > 899)
    if outside.any():
        u, v = mesh.corner_uv[outside].mean(axis=1)[0]
        raise InputError(
            f"texture.udim: expected UVs on tiles 1001 to 9999, u from 0 to 10 and v from 0 to 900, got "
            f"{np.count_nonzero(outside)} triangle(s) elsewhere, the first at u = {u:.4g}, v = {v:.4g}"
        )
    cell = cell.astype(np.int64)
    return FIRST_TILE + cell[:, 0] + 10 * cell[:, 1]


def tiles_of(mesh: SkinMesh, udim: bool) -> tuple[int, ...]:
    """UDIM numbers that hold the centre of at least one face, ascending; (1001,) without `udim`.

    Raises
    ------
    InputError
        If a face lies where there is no tile.
    """
    return tuple(int(tile) for tile in np.unique(tile_of_face(mesh, True))) if udim else (FIRST_TILE,)
