"""What rays into the flesh bring of light from everywhere: worked out once, for many lights that are blurred alike.

`transmitted_lobe` finds what each ray brings anew for each batch of lights. All lights of a basis come from everywhere
and have one plan, so that a ray brings the same share of each; what is left is to read the lights where rays come out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster, Tiles, local_uv, tile_of_face
from skinbake.bilinear import bilinear_texels
from skinbake.diffuse.diffuse_map import DiffuseMap, Lobe
from skinbake.diffuse.terms.far_side import factors_of_lights
from skinbake.diffuse.terms.flesh_rays import rays_inwards
from skinbake.diffuse.terms.thin_parts import ThinParts
from skinbake.diffuse.terms.transmission import along_rays, carried_already
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for

Image = NDArray[np.float32]
Index = NDArray[np.int64]
SIDE_BY_SIDE = 8  # lights that are read together


class _FleshTile(NamedTuple):
    """What comes to the thin texels of a tile.

    Attributes
    ----------
    raster : AtlasRaster
    rows, cols : ndarrays of shape (n,)
    weight : ndarray of shape (n R, 3), float32
        What each ray adds of the light where it comes out.
    place : ndarray of shape (n R, 4), int32
        Which of the texels that are read lie around there.
    share : ndarray of shape (n R, 4), float32
        Theirs in what is read between them.
    """

    raster: AtlasRaster
    rows: Index
    cols: Index
    weight: Image
    place: NDArray[np.int32]
    share: Image


class FleshLight:
    """Light through thin parts, of lights from everywhere.

    Parameters
    ----------
    diffused : DiffuseMap
        By the plan of all lights that will come.
    thin : ThinParts
    kept : sequence of ndarray of shape (1, n, 3), optional
        By tile, as `kept_through` gives it.
    """

    def __init__(self, diffused: DiffuseMap, thin: ThinParts, kept: Sequence[Image] | None = None) -> None:
        self._read = thin.lobe_read([lobe.variance_mm2 for lobe in diffused.lobes])
        self._variance_mm2 = float(thin.gaussians.variance_mm2[-1])
        shapes = {tile: image.shape[1:3] for tile, image in diffused.lobes[self._read].rgb.items()}
        begins = dict(zip(shapes, np.cumsum([0, *(h * w for h, w in shapes.values())]), strict=False))
        mesh, self._scatter = thin.skin.mesh, thin.skin.scatter
        of_face = tile_of_face(mesh, thin.skin.texture.udim)
        ray_share = rays_inwards(thin.around)[1].astype(np.float32)
        among = np.zeros(sum(h * w for h, w in shapes.values()), np.bool_)
        found = []
        for number, (raster, rows, cols, far) in enumerate(thin.tiles):
            factor = factors_of_lights(thin.weights, far, [(None, True)], thin.skin.occluder.centre_mm)[0]
            weight = np.maximum(along_rays(thin, far) * factor - carried_already(diffused, thin, far), 0)
            weight *= np.tile(ray_share, len(rows))[:, None]
            if kept is not None:
                weight *= np.repeat(kept[number][0], len(ray_share), axis=0)
            flat, share = np.zeros((len(weight), 4), np.int64), np.zeros((len(weight), 4), np.float32)
            for tile, begin in begins.items():
                there = np.flatnonzero((of_face[far.face] == tile) & (weight.max(axis=1, initial=0) > 0))
                uv = local_uv(far.uv[there], tile)
                at, part = bilinear_texels(np.stack([1 - uv[:, 1], uv[:, 0]], axis=1), *shapes[tile])
                flat[there], share[there] = at + begin, part
            among[flat] = True
            found.append((raster, rows, cols, weight, flat, share))
        place = np.cumsum(among, dtype=np.int32) - 1
        self._tiles = [
            _FleshTile(raster, rows, cols, weight, place[flat], share)
            for raster, rows, cols, weight, flat, share in found
        ]
        whole = np.flatnonzero(among)
        self._met = {
            tile: whole[(whole >= begin) & (whole < begin + shapes[tile][0] * shapes[tile][1])] - begin
            for tile, begin in begins.items()
        }

    def lobe(self, diffused: DiffuseMap) -> Lobe:
        """Light that comes through, as `transmitted_lobe` gives it."""
        lights, stored = len(diffused.lights), diffused.lobes[self._read].rgb
        groups = -(-lights // SIDE_BY_SIDE)
        values = np.zeros((sum(map(len, self._met.values())), 3 * groups, SIDE_BY_SIDE), np.float32)
        begin = 0
        for tile, texels in self._met.items():
            flat = stored[tile].reshape(lights, -1, 3)
            parallel_for(_side_by_side, len(texels), flat, texels, values[begin : begin + len(texels)])
            begin += len(texels)
        rgb: Tiles = {}
        for of in self._tiles:
            image = np.zeros((lights, *of.raster.shape, 3), np.float32)
            parallel_for(_bring, len(of.rows), values, (of.weight, of.place, of.share), (of.rows, of.cols), image)
            rgb[of.raster.tile] = image
        return Lobe(self._variance_mm2, (self._scatter, self._scatter, self._scatter), None, rgb)


@kernel
def _side_by_side(first, stop, light, texels, out):  # type: ignore[no-untyped-def]
    """Write what lights have at texels so that what is read together lies together.

    Parameters
    ----------
    first, stop : int
        Of the texels.
    light : ndarray of shape (L, h w, 3), float32 or float16
    texels : ndarray of shape (m,)
    out : ndarray of shape (m, 3 groups, SIDE_BY_SIDE)
        Written: of each group of lights red, green and blue.
    """
    for k in range(first, stop):
        for number in range(light.shape[0]):
            group, n = number // SIDE_BY_SIDE, number % SIDE_BY_SIDE
            for c in range(3):
                out[k, 3 * group + c, n] = light[number, texels[k], c]


@kernel
def _bring(first, stop, values, of_rays, at, out):  # type: ignore[no-untyped-def]
    """Sum over the rays of each texel of what they bring.

    Parameters
    ----------
    first, stop : int
        Of the texels.
    values : ndarray of shape (m, 3 groups, SIDE_BY_SIDE)
    of_rays : tuple of three ndarrays
        `weight`, `place` and `share` of `_FleshTile`.
    at : tuple of two ndarrays of shape (n,)
        Rows and columns.
    out : ndarray of shape (L, h, w, 3)
        Written.
    """
    (weight, place, share), (rows, cols) = of_rays, at
    rays = len(weight) // len(rows)
    total = np.empty((values.shape[1], SIDE_BY_SIDE), np.float32)
    for texel in range(first, stop):
        total[:] = 0.0
        for ray in range(texel * rays, (texel + 1) * rays):
            for corner in range(4):
                there = place[ray, corner]
                for k in range(values.shape[1]):
                    part = weight[ray, k % 3] * share[ray, corner]
                    for n in range(SIDE_BY_SIDE):
                        total[k, n] += part * values[there, k, n]
        for number in range(out.shape[0]):
            group, n = number // SIDE_BY_SIDE, number % SIDE_BY_SIDE
            for c in range(3):
                out[number, rows[texel], cols[texel], c] = max(total[3 * group + c, n], np.float32(0))
