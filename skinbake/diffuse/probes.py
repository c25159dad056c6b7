"""Probe texels, drawn by area, at which a bake is compared with the exact surface integral."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numba import prange
from numpy.typing import NDArray

from skinbake.atlas import Atlas, tile_origin
from skinbake.diffuse.surface_space.points import TexelPoints
from skinbake.kernels.compile import kernel
from skinbake.numerics import Float
from skinbake.scene.mesh import SkinMesh

HALF_FAINT = 1 / 64  # as io.exr: a channel all below would lose its shadows to half's subnormals
VERIFY, PLAN, VERIFY_AGAIN = 0, 1, 2  # streams of the same seed: a plan never sees the probes that judge it
SQUEEZED = 64.0  # texels of skin in one texel
_BLOCK = 1024  # texels; a draw finds its block first


@dataclass(frozen=True)
class Probes:
    """Texels on the skin, by tile in the atlas's order.

    Attributes
    ----------
    tile : ndarray of shape (P,), int32
        Index into the atlas.
    flat_index : ndarray of shape (P,), int64
        row * W + col at the full texture size.
    place : ndarray of shape (P, 2), float64
        (row, column) / size of the skin point that the texel shows; a texel's centre has (i + 0.5) / size.
    position, normal : ndarray of shape (P, 3), float32
        As in `TexelPoints`.
    texel_mm2 : ndarray of shape (P,), float32
    weight : ndarray of shape (P,), float64
        For means over the skin; 1 unless drawn with a preference.
    """

    tile: NDArray[np.int32]
    flat_index: NDArray[np.int64]
    place: Float
    position: NDArray[np.float32]
    normal: NDArray[np.float32]
    texel_mm2: NDArray[np.float32]
    weight: Float = field(default_factory=lambda: np.ones(1))

    def __len__(self) -> int:
        return len(self.tile)


def joined_probes(first: Probes, second: Probes) -> Probes:
    """Both sets; means over either are means over the skin, so means over both are too."""
    parts = {}
    for name in ("tile", "flat_index", "place", "position", "normal", "texel_mm2"):
        parts[name] = np.concatenate([getattr(first, name), getattr(second, name)])
    weights = [np.broadcast_to(p.weight, len(p)) for p in (first, second)]
    return Probes(**parts, weight=np.concatenate(weights))


def draw_probes(
    atlas: Atlas,
    mesh: SkinMesh,
    points: Sequence[TexelPoints],
    count: int,
    seed: int,
    stream: int = VERIFY,
    preference: Sequence[NDArray[np.float32]] | None = None,
) -> Probes:
    """`count` texels, each drawn with a chance proportional to its skin area, independently.

    Texels that hold more skin than SQUEEZED mean ones are left out: what the UVs squeeze into almost no texture is
    shown wrongly by any bake, and would be most of what is judged (`squeezed_share` says how much skin that is).

    Parameters
    ----------
    preference : sequence of ndarray of shape (T,), float32, optional
        Not negative, by row of each tile's points: half of the probes are drawn in proportion to it too, and weighed
        back.
    """
    rng = np.random.default_rng([seed, stream])
    most = _most_area(points)
    if preference is None:
        preference = [np.empty(0, np.float32)] * len(points)
    sums = [_block_sums(p.area_mm2, liked, most) for p, liked in zip(points, preference, strict=True)]
    area, preferred, _ = np.sum([each.sum(axis=0) for each in sums], axis=0)
    rates = (0.5 / area, 0.5 / preferred) if preferred > 0 else (1 / max(area, 1e-30), 0.0)
    chance = np.cumsum(np.concatenate([each[:, :2] @ rates for each in sums]))
    if len(chance) == 0 or chance[-1] <= 0:
        count = 0
    drawn = np.sort(rng.random(count) * (chance[-1] if count else 0.0))
    # A draw that rounds up to all there is belongs to the last block that can be drawn, not to an empty one behind it
    block = np.minimum(np.searchsorted(chance, drawn, side="right"), np.searchsorted(chance, chance[-1:]))
    rest = drawn - np.where(block > 0, chance[block - 1], 0.0)
    first = np.cumsum([0, *(len(each) for each in sums)])
    tile = np.searchsorted(first, block, side="right").astype(np.int32) - 1
    weight, flat, place = np.ones(count), np.zeros(count, np.int64), np.zeros((count, 2))
    position, normal = np.zeros((count, 3), np.float32), np.zeros((count, 3), np.float32)
    texel_mm2 = np.zeros(count, np.float32)
    for k, (raster, p, liked) in enumerate(zip(atlas, points, preference, strict=True)):
        mine = tile == k
        r = _rows_of(p.area_mm2, liked, most, rates[0], rates[1], block[mine] - first[k], rest[mine])
        flat[mine], position[mine], normal[mine] = p.flat_index[r], p.position[r], p.normal[r]
        texel_mm2[mine] = p.texel_mm2[r]
        place[mine] = _places(
            raster.face_index, raster.barycentric, p.flat_index[r], mesh.corner_uv, tile_origin(raster.tile)
        )
        if len(liked):
            weight[mine] = 1 / (area * (rates[0] + rates[1] * liked[r].astype(np.float64)))
    return Probes(tile, flat, place, position, normal, texel_mm2, weight)


def squeezed_share(points: Sequence[TexelPoints]) -> float:
    """Share of the skin in texels that hold more of it than SQUEEZED mean ones."""
    area, texels = _area_and_texels(points)
    judged, judged_texels = _area_and_texels(points, SQUEEZED * area / max(1, texels))
    return 1 - judged / area if judged_texels < texels else 0.0


def _most_area(points: Sequence[TexelPoints]) -> float:
    """Area of a texel up to which it is judged."""
    area, texels = _area_and_texels(points)
    return SQUEEZED * area / max(1, texels)


def _area_and_texels(points: Sequence[TexelPoints], most: float = np.inf) -> tuple[float, int]:
    """Of the skin whose texels hold at most so much of it."""
    none = np.empty(0, np.float32)
    area, _, texels = np.sum([_block_sums(p.area_mm2, none, most).sum(axis=0) for p in points], axis=0)
    return float(area), int(texels)


def _block_sums(area: NDArray[np.float32], liked: NDArray[np.float32], most: float) -> Float:
    """Area of each block of texels, area times preference, and number of texels that have area, (B, 3)."""
    sums = np.zeros((-(-len(area) // _BLOCK), 3))
    _add_blocks(area, liked, most, sums)
    return sums


@kernel(parallel=True)
def _add_blocks(area, liked, most, sums):  # type: ignore[no-untyped-def]
    for block in prange(len(sums)):
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


def _places(
    face_index: NDArray[np.int32],
    barycentric: NDArray[np.float32],
    flat: NDArray[np.int32],
    corner_uv: Float,
    origin: tuple[int, int],
) -> Float:
    face = face_index.reshape(-1)[flat]
    b = barycentric.reshape(-1, 2)[flat].astype(np.float64)
    weights = np.stack([1 - b.sum(axis=1), b[:, 0], b[:, 1]], axis=1)
    uv = np.einsum("pk,pkc->pc", weights, corner_uv[face])
    return np.stack([origin[1] + 1 - uv[:, 1], uv[:, 0] - origin[0]], axis=1)


def read_bilinear(image: NDArray[np.float32], place: Float, half: bool = False) -> Float:
    """Values of an image at places, as a GPU reads them: bilinear, clamped to the edge texels.

    Parameters
    ----------
    image : ndarray of shape (L, h, w, 3), float32
    place : ndarray of shape (P, 2)
        (row, column) / size.
    half : bool
        Round each texel to binary16 first, as a file would hold it.

    Returns
    -------
    ndarray of shape (P, 3 L), float64
    """
    lights, height, width, _ = image.shape
    flat, weight = bilinear_texels(place, height, width)
    values = image.reshape(lights, -1, 3)[:, flat]
    if half:
        with np.errstate(over="ignore"):  # past 65504, and for channels faint all over, the writer takes float
            rounded = values.astype(np.float16).astype(np.float32)
        top = np.abs(values).max(axis=(1, 2), keepdims=True, initial=0.0)
        values = np.where(np.isfinite(rounded) & (top >= HALF_FAINT), rounded, values)
    return np.einsum("lpkc,pk->plc", values.astype(np.float64), weight).reshape(len(place), 3 * lights)


def bilinear_texels(place: Float, height: int, width: int) -> tuple[NDArray[np.int64], Float]:
    """The four texels around each place, flat, and their weights, both (P, 4)."""
    row, col = place[:, 0] * height - 0.5, place[:, 1] * width - 0.5
    r0, c0 = np.floor(row).astype(np.int64), np.floor(col).astype(np.int64)
    fr, fc = row - r0, col - c0
    rows = [np.clip(r, 0, height - 1) for r in (r0, r0, r0 + 1, r0 + 1)]
    cols = [np.clip(c, 0, width - 1) for c in (c0, c0 + 1, c0, c0 + 1)]
    weight = np.stack([(1 - fr) * (1 - fc), (1 - fr) * fc, fr * (1 - fc), fr * fc], axis=1)
    return np.stack([r * width + c for r, c in zip(rows, cols, strict=True)], axis=1), weight
