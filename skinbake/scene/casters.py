"""Casters: triangles that are in the way of light without being skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinbake.numerics import Float

OPAQUE = -1


@dataclass(frozen=True)
class Casters:
    """Eyes, teeth, hair, hats: rays meet them, light neither leaves them nor scatters in them.

    Attributes
    ----------
    positions_mm : ndarray of shape (V, 3), float64
    faces : ndarray of shape (F, 3), int32
    corner_uv : ndarray of shape (F, 3, 2), float64
        Where the opacity is looked up, v up; any place outside the unit square repeats it.
    image : ndarray of shape (F,), int32
        Index into `opacity`, OPAQUE where nothing comes through.
    opacity : tuple of ndarrays of shape (h, w), float32
        0 lets a ray pass, 1 stops it; row 0 is v = 1.
    """

    positions_mm: Float
    faces: NDArray[np.int32]
    corner_uv: Float
    image: NDArray[np.int32]
    opacity: tuple[NDArray[np.float32], ...] = ()


def joined_casters(casters: Sequence[Casters]) -> Casters | None:
    """All of several in one; None where there are no triangles."""
    casters = [each for each in casters if len(each.faces)]
    if not casters:
        return None
    vertices = np.cumsum([0, *(len(each.positions_mm) for each in casters)])
    images = np.cumsum([0, *(len(each.opacity) for each in casters)])
    return Casters(
        np.concatenate([each.positions_mm for each in casters]),
        np.concatenate([each.faces + np.int32(o) for each, o in zip(casters, vertices, strict=False)]),
        np.concatenate([each.corner_uv for each in casters]),
        np.concatenate(
            [
                np.where(each.image == OPAQUE, OPAQUE, each.image + o).astype(np.int32)
                for each, o in zip(casters, images, strict=False)
            ]
        ),
        tuple(picture for each in casters for picture in each.opacity),
    )
