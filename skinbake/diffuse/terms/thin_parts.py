"""Thin parts of the skin: which texels have a far side that lets light through, and where rays from them come out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster, coarser_atlas, face_mm_per_texel
from skinbake.diffuse.terms.curvature import CurvedSkin
from skinbake.diffuse.terms.far_side import FarSide, far_side, inwards
from skinbake.diffuse.terms.flesh_rays import AROUND, rays_inwards
from skinbake.diffuse.terms.skin_hits import skin_points
from skinbake.diffuse.terms.slab_weights import DARK, SlabWeights, slab_weights
from skinbake.irradiance.occluder import Occluder
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, safe_div
from skinbake.profile import GaussianSum
from skinbake.profile.skin_medium import SkinMedium
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import TextureSpec

Image = NDArray[np.float32]
Index = NDArray[np.int64]
TEXEL_MM = 0.8  # transmitted light is smooth: it is computed and stored at texels of up to these
FEW_MM = 3.2  # of the texels by which `auto` decides where that is plain: a sixteenth of them, on two heads within 0.04
_AT_ONCE = 1 << 18  # texels that are looked behind at a time


class ThinTile(NamedTuple):
    """Texels of a tile behind which the flesh is thin enough to let light through.

    Attributes
    ----------
    raster : AtlasRaster
        Of the size that transmitted light is computed at.
    rows, cols : ndarrays of shape (n,)
    far : FarSide
        Of the rays of `rays_inwards` from these texels, (n R): those of a texel one after the other.
    """

    raster: AtlasRaster
    rows: Index
    cols: Index
    far: FarSide


@dataclass(frozen=True, eq=False)
class TranslucentSkin:
    """Skin that light may come through: what lies behind its texels depends on this alone.

    Attributes
    ----------
    mesh : SkinMesh
    occluder : Occluder
        The mesh's.
    texture : TextureSpec
    gaussians : GaussianSum
    albedo_rgb : ndarray of shape (3,)
        Mean albedo of the skin, which stands for the reflectance where the profile knows none (energy 1).
    medium : SkinMedium
        What it is made of.
    scatter : float
        Share of the light that scatters: the weight of transmitted light.
    curved : CurvedSkin, optional
        Where curvature is counted: round skin holds more of the light that arrives.
    """

    mesh: SkinMesh
    occluder: Occluder
    texture: TextureSpec
    gaussians: GaussianSum
    albedo_rgb: Float
    medium: SkinMedium
    scatter: float = 1.0
    curved: CurvedSkin | None = None

    @cached_property
    def slabs(self) -> tuple[SlabWeights, GaussianSum]:
        """What slabs of it let through, and the Gaussians of what scatters in them."""
        gaussians = self.gaussians
        reflectance = np.where(gaussians.energy_rgb < 0.98, gaussians.energy_rgb, self.albedo_rgb)
        if not (self.scatter < 1 or (gaussians.table is not None and gaussians.table.scatters)):
            return slab_weights(gaussians, reflectance, self.medium), gaussians
        # Of light that entered: the first Gaussian, of no width, never did
        scattered = gaussians.weight_rgb[1:]
        whole = safe_div(scattered, scattered.sum(axis=0)) * gaussians.weight_rgb.sum(axis=0)
        inside = replace(gaussians, variance_mm2=gaussians.variance_mm2[1:], weight_rgb=whole, table=None)
        slab = slab_weights(inside, reflectance, self.medium)
        none = np.zeros((1, 3))
        return slab, replace(gaussians, weight_rgb=np.concatenate([none, whole]))


class ThinParts(NamedTuple):
    """What lies behind each texel: traced once, good for any light.

    Attributes
    ----------
    skin : TranslucentSkin
    tiles : tuple of ThinTile
        Its points lie about `skin.occluder.centre_mm`.
    around : int
        Rays at each cosine, as of `rays_inwards`.
    """

    skin: TranslucentSkin
    tiles: tuple[ThinTile, ...]
    around: int

    @classmethod
    def of(cls, skin: TranslucentSkin, texel_mm: float = TEXEL_MM, around: int = AROUND[0]) -> ThinParts:
        """Trace inwards from the texels of a texture.

        Parameters
        ----------
        skin : TranslucentSkin
        texel_mm : float
            Of the texels that are looked behind, about.
        around : int
            As of `rays_inwards`.
        """
        mesh, texture = skin.mesh, skin.texture
        full_mm = float(np.median(face_mm_per_texel(mesh, texture.size).max(axis=1)))
        coarse = 1 << transmitted_level(full_mm, texel_mm)
        small = (max(1, texture.size[0] // coarse), max(1, texture.size[1] // coarse))
        tiles = []
        for raster in coarser_atlas(mesh, texture.size, texture.gutter, texture.udim, small):
            band = max(1, _AT_ONCE // raster.shape[1])
            found = [
                _look_behind(raster, slice(first, first + band), mesh, skin.occluder, skin.slabs[0], around)
                for first in range(0, len(raster.coverage), band)
            ]
            rows, cols, *far = (np.concatenate(part) for part in zip(*found, strict=True))
            behind = FarSide(*far)
            if skin.curved:
                behind = behind._replace(held=skin.curved.held(mesh, texture.udim, behind.face, behind.uv))
            tiles.append(ThinTile(raster, rows, cols, behind))
        return cls(skin, tuple(tiles), around)

    @property
    def weights(self) -> SlabWeights:
        """What slabs of the skin let through."""
        return self.skin.slabs[0]

    @property
    def gaussians(self) -> GaussianSum:
        """The Gaussians of what scatters."""
        return self.skin.slabs[1]

    def lobe_read(self, variance_mm2: Sequence[float]) -> int:
        """Which of lobes of ascending variances light is read from where rays come out.

        The widest that is not wider than a free path, which light goes at either end: unblurred, each ray would show
        the far side's shadows, and wider lobes would blur what the rays' directions blur already.
        """
        narrow = [i for i, variance in enumerate(variance_mm2) if variance <= self.weights.free_path_mm**2]
        return narrow[-1] if narrow else 0


def _look_behind(
    raster: AtlasRaster, some: slice, mesh: SkinMesh, occluder: Occluder, weights: SlabWeights, around: int
) -> tuple[Index | Float, ...]:
    """Some rows of texels: rows and columns of those that are thin, and the fields of `FarSide`.

    Few texels are, and looking for them takes many times their memory.

    Parameters
    ----------
    raster : AtlasRaster
    some : slice
        Rows.
    mesh : SkinMesh
    occluder : Occluder
    weights : SlabWeights
    around : int
        As of `rays_inwards`.
    """
    rows, cols = np.nonzero(raster.addressed[some])
    rows += some.start
    point, normal = skin_points(raster, mesh, occluder, rows, cols)
    near = np.flatnonzero(occluder.occluded(*inwards(occluder, point, normal), _reach(weights, len(rows))))
    far = far_side(occluder, mesh, point[near], normal[near])
    lit = (far.face >= 0) & (far.opposed > 0)
    lit &= read_weights(weights, weights.through_rgb, far).max(axis=1) >= DARK
    near = near[lit]
    far = far_side(occluder, mesh, point[near], normal[near], rays_inwards(around)[0])
    return rows[near], cols[near], *far[:-1]


def transmitted_level(full_mm: float, texel_mm: float = TEXEL_MM) -> int:
    """How often a texture is halved for transmitted light, from the length of a texel of the full size."""
    return int(np.floor(np.log2(max(texel_mm / max(full_mm, 1e-6), 1.0))))


def _reach(weights: SlabWeights, rays: int) -> Image:
    """Thickness beyond which all is dark, for each ray."""
    lit = np.flatnonzero(weights.through_rgb.max(axis=1) >= DARK)
    last = min(int(lit.max(initial=-1)) + 1, len(weights.thickness_mm) - 1)
    return np.full(rays, weights.thickness_mm[last], np.float32)


def read_weights(weights: SlabWeights, table: Float, far: FarSide) -> Image:
    """Values for each ray, (n, 3); linear in the logarithm of its length, dark beyond the table.

    Parameters
    ----------
    weights : SlabWeights
        Has the table's thicknesses.
    table : ndarray of shape (K, 3)
    far : FarSide
        Of n rays.
    """
    step = float(np.log(weights.thickness_mm[1] / weights.thickness_mm[0]))
    out = np.zeros((len(far.face), table.shape[1]), np.float32)
    thinnest_mm = float(weights.thickness_mm[0])
    rays = np.ascontiguousarray(far.thickness_mm), np.ascontiguousarray(far.opposed)
    parallel_for(_read_table, len(out), table, thinnest_mm, step, rays, out)
    return out


@kernel
def _read_table(first, stop, table, thinnest_mm, step, rays, out):  # type: ignore[no-untyped-def]
    """`read_weights` of rays.

    Parameters
    ----------
    first, stop : int
        Rays.
    table : ndarray of shape (K, 3)
        Values at lengths in even steps of their logarithm.
    thinnest_mm, step : float
        The first one, and the step.
    rays : tuple of two ndarrays of shape (n,)
        Length of each in flesh, mm, and the cosine at which it leaves: nothing comes where that is not above 0.
    out : ndarray of shape (n, 3), float32
        Written; zero where it is dark.
    """
    length_mm, opposed = rays
    last = len(table) - 1
    for ray in range(first, stop):
        k = np.log(max(length_mm[ray], 1e-6) / thinnest_mm) / step
        if not (k < last and opposed[ray] > 0):
            continue
        k = max(k, 0.0)
        low = min(int(k), last - 1)
        t = k - low
        for c in range(table.shape[1]):
            out[ray, c] = table[low, c] * (1 - t) + table[low + 1, c] * t
