"""Draws probes: texels of the skin, each with a chance proportional to its area."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster, Tiled
from skinbake.atlas.texel_coordinates import local_uv, texel_xy
from skinbake.diffuse.probes import Probes
from skinbake.diffuse.skin_geometry import SkinGeometry
from skinbake.diffuse.surface_space.points import TexelPoints
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float

VERIFY, PLAN, VERIFY_AGAIN = 0, 1, 2  # streams of the same seed: a plan never sees the probes that judge it
SQUEEZED = 64.0  # texels of skin in one texel
_BLOCK = 1024  # texels; a draw finds its block first


def draw_probes(
    geometry: SkinGeometry,
    count: int,
    seed: int,
    stream: int = VERIFY,
    preference: Tiled[NDArray[np.float32]] | None = None,
) -> Probes:
    """`count` texels, each drawn with a chance proportional to its skin area, independently.

    Texels that hold more skin than SQUEEZED mean ones are left out: what the UVs squeeze into almost no texture is
    shown wrongly by any bake, and would be most of what is judged (`squeezed_share` says how much skin that is).

    Parameters
    ----------
    geometry : SkinGeometry
    count : int
        How many to draw; none are drawn where there is no skin.
    seed : int
    stream : VERIFY, PLAN or VERIFY_AGAIN
        Which of the independent draws of this seed.
    preference : Tiled of ndarray of shape (T,), float32, optional
        Not negative, by row of each tile's points: half of the probes are drawn in proportion to it too, and weighed
        back.
    """
    rng = np.random.default_rng([seed, stream])
    points = geometry.points
    most = _most_area(points)
    if preference is None:
        preference = dict.fromkeys(points, np.empty(0, np.float32))

    # Chance of each block of texels, all tiles' blocks one after another
    sums = {tile: _block_sums(p.area_mm2, preference[tile], most) for tile, p in points.items()}
    area, preferred, _ = np.sum([each.sum(axis=0) for each in sums.values()], axis=0)
    rates = (0.5 / area, 0.5 / preferred) if preferred > 0 else (1 / max(area, 1e-30), 0.0)
    chance = np.cumsum(np.concatenate([each[:, 0] * rates[0] + each[:, 1] * rates[1] for each in sums.values()]))
    if len(chance) == 0 or chance[-1] <= 0:
        count = 0
    drawn = np.sort(rng.random(count) * (chance[-1] if count else 0.0))
    # A draw that rounds up to all there is belongs to the last block that can be drawn, not to an empty one behind it
    block = np.minimum(np.searchsorted(chance, drawn, side="right"), np.searchsorted(chance, chance[-1:]))
    rest = drawn - np.where(block > 0, chance[block - 1], 0.0)

    # Within its block, the texel that each draw falls on
    first = np.cumsum([0, *(len(each) for each in sums.values())])
    tile_of = np.array(list(points), np.int32)[np.searchsorted(first, block, side="right") - 1]
    weight, flat, place = np.ones(count), np.zeros(count, np.int64), np.zeros((count, 2))
    position, normal = np.zeros((count, 3), np.float32), np.zeros((count, 3), np.float32)
    texel_mm2 = np.zeros(count, np.float32)
    for first_block, raster in zip(first[:-1], geometry.atlas, strict=True):
        mine, p, liked = tile_of == raster.tile, points[raster.tile], preference[raster.tile]
        r = _rows_of(p.area_mm2, liked, most, rates[0], rates[1], block[mine] - first_block, rest[mine])
        flat[mine], position[mine], normal[mine] = p.flat_index[r], p.position[r], p.normal[r]
        texel_mm2[mine] = p.texel_mm2[r]
        place[mine] = _places(raster, p.flat_index[r], geometry.mesh.corner_uv)
        if len(liked):
            weight[mine] = 1 / (area * (rates[0] + rates[1] * liked[r].astype(np.float64)))
    return Probes(tile_of, flat, place, position, normal, texel_mm2, weight)


def squeezed_share(points: Tiled[TexelPoints]) -> float:
    """Share of the skin, 0 ... 1, in texels that hold more of it than SQUEEZED mean ones."""
    area, texels = _area_and_texels(points)
    judged, judged_texels = _area_and_texels(points, SQUEEZED * area / max(1, texels))
    return 1 - judged / area if judged_texels < texels else 0.0


def _most_area(points: Tiled[TexelPoints]) -> float:
    """Largest area of a texel, mm^2, that is judged."""
    area, texels = _area_and_texels(points)
    return SQUEEZED * area / max(1, texels)


def _area_and_texels(points: Tiled[TexelPoints], most: float = np.inf) -> tuple[float, int]:
    """Area in mm^2, and number, of the texels that hold skin, but at most `most` mm^2."""
    none = np.empty(0, np.float32)
    area, _, texels = np.sum([_block_sums(p.area_mm2, none, most).sum(axis=0) for p in points.values()], axis=0)
    return float(area), int(texels)


def _block_sums(area: NDArray[np.float32], liked: NDArray[np.float32], most: float) -> Float:
    """Area of each block of texels, area times preference, and number of texels that have area, (B, 3)."""
    sums = np.zeros((-(-len(area) // _BLOCK), 3))
    parallel_for(_add_blocks, len(sums), area, liked, most, sums)
    return sums


@kernel
def _add_blocks(first, stop, area, liked, most, sums):  # type: ignore[no-untyped-def]
    """`_block_sums` of blocks `first` to `stop`."""
    for block in range(first, stop):
        total, preferred, texels = 0.0, 0.0, 0
        for k in range(block * _BLOCK, min((block + 1) * _BLOCK, len(area))):
            if 0 < area[k] <= most:
                total += area[k]
                texels += 1
                if len(liked):
                    preferred += np.float64(area[k]) * liked[k]
        sums[block, 0], sums[block, 1], sums[block, 2] = total, preferred, texels


@kernel
def _rows_of(area, liked, most, rate, liked_rate, block, rest):  # type: ignore[no-untyped-def]
    """The texel of each draw: where the chances of its block, one after another, exceed the rest of the draw."""
    rows = np.empty(len(block), np.int64)
    for i in range(len(block)):
        reached = 0.0
        for k in range(block[i] * _BLOCK, min((block[i] + 1) * _BLOCK, len(area))):
            if 0 < area[k] <= most:
                each = rate + liked_rate * liked[k] if len(liked) else rate
                reached += np.float64(area[k]) * each
                if each > 0:
                    rows[i] = k  # the last one that can be drawn, if rounding leaves a rest
                if reached > rest[i]:
                    break
    return rows


def _places(raster: AtlasRaster, flat: NDArray[np.int32], corner_uv: Float) -> Float:
    """(row, column) / size of the skin points that texels of a tile show, (P, 2)."""
    face = raster.face_index.reshape(-1)[flat]
    b = raster.barycentric.reshape(-1, 2)[flat].astype(np.float64)
    weights = np.stack([1 - b.sum(axis=1), b[:, 0], b[:, 1]], axis=1)
    uv = np.einsum("pk,pkc->pc", weights, corner_uv[face])
    local = local_uv(uv, raster.tile)
    across, down = texel_xy(local[:, 0], local[:, 1], 1, 1)
    return np.stack([down, across], axis=1)
