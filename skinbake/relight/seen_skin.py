"""What the texels of a small atlas see of the skin, by the rays that were traced to tell what they see of the sky.

Which skin is in the way is asked of few rays only: of each texel's directions some that are cosine distributed, and of
these the ones in whose way there is something. The others bring no light from skin to skin (theory.md 9.7).
"""

from __future__ import annotations

import numpy as np

from skinbake.diffuse.terms.skin_hits import NOTHING, TexturedSkin
from skinbake.diffuse.terms.skin_view import SkinView, numbered
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.relight.open_sky import OpenSky

RAYS = 128  # of a texel's 512 directions above the horizon; in the way of one in twenty there is skin of a head
_TURN = 0.6180339887498949  # of neighbouring texels' rays against each other


def seen_skin(sky: OpenSky, full: TexturedSkin) -> SkinView:
    """Rays from each texel to `RAYS` of the sky's directions, traced on where they are not open.

    Parameters
    ----------
    sky : OpenSky
    full : TexturedSkin
        The texture whose texels are seen.
    """
    columns = np.ascontiguousarray(sky.towards.T)
    before, tile, flat, met_skin, in_first_half, parts = 0, [], [], [], [], []
    for k, raster in enumerate(sky.atlas):
        share = sky.share[raster.tile]
        flat.append(np.flatnonzero(raster.addressed))
        tile.append(np.full(len(share), k, np.int32))
        way = np.empty((len(share), RAYS), np.int32)
        parallel_for(_aim, len(way), sky.normal[raster.tile], columns, way)
        hit = np.take_along_axis(share, way, axis=1) == 0 if sky.shadows else np.ones(way.shape, np.bool_)
        texel = np.nonzero(hit)[0]
        origin, towards = sky.origin[raster.tile][texel], sky.towards[way[hit]]
        seen_tile, seen = full.met_by(origin, towards)
        hit[hit] = seen != NOTHING
        place = seen_tile.astype(np.int64) * (full.size[0] * full.size[1]) + seen
        parts.append((before + np.arange(len(share)), place[seen != NOTHING]))
        met_skin.append(hit.sum(axis=1))
        in_first_half.append(hit[:, : RAYS // 2].sum(axis=1))
        before += len(share)
    texels = np.concatenate(tile), np.concatenate(flat), np.full(before, RAYS)
    counts = np.concatenate(met_skin), np.concatenate(in_first_half)
    point, normal = (np.concatenate([of[raster.tile] for raster in sky.atlas]) for of in (sky.origin, sky.normal))
    skin = np.asarray(point, np.float32), np.asarray(normal, np.float32)
    return numbered(sky.atlas, *texels, *counts, parts, full.size, None, skin)


@kernel
def _aim(first, stop, normal, columns, way):  # type: ignore[no-untyped-def]
    """Choose cosine-distributed directions: in equal steps of the cosines' running sum, every other one in either half.

    Parameters
    ----------
    first, stop : int
        Texels.
    normal : ndarray of shape (n, 3)
    columns : ndarray of shape (3, D)
        Directions, of which those that follow each other are near.
    way : ndarray of shape (n, rays), int32
        Written: numbers of those that are chosen.
    """
    count, rays = columns.shape[1], way.shape[1]
    sums = np.empty(count)
    for i in range(first, stop):
        total = 0.0
        for d in range(count):
            cosine = normal[i, 0] * columns[0, d] + normal[i, 1] * columns[1, d] + normal[i, 2] * columns[2, d]
            total += max(np.float64(cosine), 0.0)
            sums[d] = total
        begin, d = i * _TURN % 1.0, 0
        for k in range(rays):
            while d < count - 1 and sums[d] <= (begin + k) / rays * total:
                d += 1
            way[i, k % 2 * (rays // 2) + k // 2] = d
