"""Texels of a small atlas from which the sky is looked at; what some of them see is traced once, for all who ask.

Plans of skies ask those that stand for the skin's area. Relighting asks them all, and takes over what these have seen.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, Tiled, limited_size, rasterize, signed_uv_area
from skinbake.atlas.coarser import LEAST_GUTTER
from skinbake.irradiance.lattice import lattice
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.open_directions import open_directions
from skinbake.irradiance.settled_rays import Answers, no_answers
from skinbake.irradiance.sky_directions import sky_directions
from skinbake.irradiance.surface import places_of_texels
from skinbake.scene.mesh import SkinMesh

Image = NDArray[np.float32]
Index = NDArray[np.int64]
TEXEL_MM = 2.0  # on average; penumbras of what 25 textures can hold are a centimetre and more wide
SMALLEST = 64  # texels of the shorter side
LONGEST = 1024  # texels of the longer side of a texture: a finer one has the small atlas of one with so many
TELL = 512  # texels, each for as much of the skin, that tell what it sees of a sky


class Seen(NamedTuple):
    """What some texels of a tile see of the sky.

    Attributes
    ----------
    texels : ndarray of shape (n,), int64
        row * w + col, ascending.
    normal : ndarray of shape (n, 3), float32
        Smooth.
    share : ndarray of shape (n, D), uint8
        As `open_directions` gives it.
    answers : ndarray of shape (n, 2, words)
        Directions that are open, and those that are blocked.
    """

    texels: Index
    normal: Image
    share: NDArray[np.uint8]
    answers: Answers


class SkyTexels:
    """Texels of a small atlas, of which some stand for the skin and are traced once.

    Attributes
    ----------
    mesh : SkinMesh
    occluder : Occluder
        The mesh's.
    size : (width, height)
        Of the small atlas.
    """

    def __init__(
        self,
        mesh: SkinMesh,
        occluder: Occluder,
        size: tuple[int, int],
        gutter: int = LEAST_GUTTER,
        udim: bool = False,
    ) -> None:
        self.mesh, self.occluder, self.size = mesh, occluder, size
        self._gutter, self._udim = gutter, udim

    @cached_property
    def atlas(self) -> Atlas:
        """The small atlas."""
        return rasterize(self.mesh, self.size, self._gutter, self._udim)

    @cached_property
    def towards(self) -> Image:
        """Directions that are asked about, (D, 3)."""
        return sky_directions()

    @cached_property
    def numbers(self) -> Tiled[Index]:
        """Texels (row * w + col) that stand for equal areas of the skin, ascending, by tile; `TELL` in all.

        A texel that holds more than such an area is there more than once. They lie on the lattice from which all
        directions are traced, unless that has fewer than `TELL`.
        """
        stride = {raster.tile: lattice(raster) for raster in self.atlas}
        while True:
            areas = []
            for raster in self.atlas:
                apart = stride[raster.tile]
                on_lattice = np.zeros(raster.shape, np.float64)
                on_lattice[::apart, ::apart] = raster.area_mm2[::apart, ::apart]
                areas.append(on_lattice.ravel())
            if max(stride.values()) == 1 or sum(np.count_nonzero(area) for area in areas) >= TELL:
                break
            stride = {tile: max(1, apart // 2) for tile, apart in stride.items()}
        total = np.cumsum(np.concatenate(areas))
        steps = (np.arange(TELL if total[-1] > 0 else 0) + 0.5) / TELL * total[-1]
        found, start, chosen = np.searchsorted(total, steps), 0, {}
        for raster, area in zip(self.atlas, areas, strict=True):
            chosen[raster.tile] = found[(found >= start) & (found < start + len(area))] - start
            start += len(area)
        return chosen

    @cached_property
    def seen(self) -> Tiled[Seen]:
        """What the texels of `numbers` see, each of them once, by tile; traced when it is first asked for."""
        found = {}
        for raster in self.atlas:
            texels = np.unique(self.numbers[raster.tile])
            origin, normal = places_of_texels(raster, texels, self.mesh, self.occluder)
            answers = no_answers(len(texels), len(self.towards))
            share = open_directions(origin, normal, self.towards, self.occluder, answers)
            found[raster.tile] = Seen(texels, normal, share, answers)
        return found


def sky_texels(mesh: SkinMesh, occluder: Occluder, size: tuple[int, int], gutter: int, udim: bool) -> SkyTexels:
    """Texels that hold `TEXEL_MM`^2 of skin on average, a whole number of the texture's along each side.

    Parameters
    ----------
    mesh : SkinMesh
    occluder : Occluder
    size : (width, height)
        Of the texture; the small atlas has no more texels.
    gutter : int
        In the texture's texels; as wide on the skin, but for what bilinear reading needs.
    udim : bool
    """
    width, height = limited_size(size, LONGEST)
    texels = np.abs(signed_uv_area(mesh)).sum() * width * height
    full_mm = float(np.sqrt(mesh.face_area_mm2.sum() / max(texels, 1e-12)))
    coarser = max(1, min(round(TEXEL_MM / max(full_mm, 1e-6)), min(width, height) // SMALLEST))
    small = max(1, -(-width // coarser)), max(1, -(-height // coarser))
    gutter = max(LEAST_GUTTER, -(-gutter * width // size[0]))
    return SkyTexels(mesh, occluder, small, max(LEAST_GUTTER, gutter * small[0] // width), udim)
