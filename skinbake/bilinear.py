"""Reading of stored images between their texels, as a GPU does it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel
from skinbake.numerics import Float
from skinbake.stored_precision import half_holds

_TENT_TEXELS2 = 1 / 6  # variance of a tent, a texel wide to both sides


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
        with np.errstate(over="ignore"):  # what is past 65504 is not taken
            rounded = values.astype(np.float16).astype(np.float32)
        held = half_holds(np.abs(values).max(axis=(1, 2), keepdims=True, initial=0.0)).all(axis=-1, keepdims=True)
        values = np.where(held, rounded, values)
    return np.einsum("lpkc,pk->plc", values.astype(np.float64), weight).reshape(len(place), 3 * lights)


def bilinear_texels(place: Float, height: int, width: int) -> tuple[NDArray[np.int64], Float]:
    """The four texels around each place, flat, and their weights, both (P, 4).

    Parameters
    ----------
    place : ndarray of shape (P, 2)
        (row, column) / size.
    height, width : int
        Of the image.
    """
    row, col = place[:, 0] * height - 0.5, place[:, 1] * width - 0.5
    r0, c0 = np.floor(row).astype(np.int64), np.floor(col).astype(np.int64)
    fr, fc = row - r0, col - c0
    rows = [np.clip(r, 0, height - 1) for r in (r0, r0, r0 + 1, r0 + 1)]
    cols = [np.clip(c, 0, width - 1) for c in (c0, c0 + 1, c0, c0 + 1)]
    weight = np.stack([(1 - fr) * (1 - fc), (1 - fr) * fc, fr * (1 - fc), fr * fc], axis=1)
    return np.stack([r * width + c for r, c in zip(rows, cols, strict=True)], axis=1), weight


def read_variance_texels2(level: int) -> float:
    """Variance that reading adds along each axis to what is stored at a level, in its texels squared; theory.md 5.2.

    None at the full size, which is shown texel by texel; what is stored smaller is read between its own.
    """
    return _TENT_TEXELS2 if level else 0.0


def magnify_bilinear(
    image: NDArray[np.float32], shape: tuple[int, int], rows: slice | None = None
) -> NDArray[np.float32]:
    """An image read at the texel centres of another size, as a GPU does: bilinear, clamped to the edge texels.

    Parameters
    ----------
    image : ndarray of shape (h, w, C), float32
    shape : (H, W)
        Of the whole result; both images span the same square.
    rows : slice, optional
        Those that are wanted.

    Returns
    -------
    ndarray of shape (H, W, C), float32
        Or of the rows that are wanted.
    """
    for axis, size in enumerate(shape):
        count, wanted = image.shape[axis], rows if rows and axis == 0 else slice(None)
        if count == size:
            image = image[rows] if rows and axis == 0 else image
            continue
        place = np.clip((np.arange(size)[wanted] + 0.5) * (count / size) - 0.5, 0, count - 1)
        low = np.minimum(place.astype(np.int64), max(count - 2, 0))
        share = (place - low).astype(np.float32).reshape([-1 if a == axis else 1 for a in range(3)])
        first, second = image.take(low, axis), image.take(np.minimum(low + 1, count - 1), axis)
        image = first + (second - first) * share
    return image


def add_magnified(image: NDArray[np.float32], weight: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    """Add an image, read at the texel centres of another size as `magnify_bilinear` does, times a weight.

    Parameters
    ----------
    image : ndarray of shape (h, w, 3), float32
    weight : ndarray of shape (H, W, 3) or (1, 1, 3)
    out : ndarray of shape (H, W, 3), float32
        Added to.
    """
    (rows, down), (cols, right) = (
        between(size, count) for size, count in zip(out.shape, image.shape[:2], strict=False)
    )
    _add(np.asarray(image, np.float32), (rows, down, cols, right), np.asarray(weight, np.float32), out)


def between(size: int, count: int) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """The lower of the two of `count` texels between which each of `size` texel centres lies, and the other's share."""
    if size == count:
        return np.arange(size), np.zeros(size, np.float32)
    place = np.clip((np.arange(size) + 0.5) * (count / size) - 0.5, 0, count - 1)
    low = np.minimum(place.astype(np.int64), max(count - 2, 0))
    return low, (place - low).astype(np.float32)


@kernel
def _add(image, places, weight, out):  # type: ignore[no-untyped-def]
    """`add_magnified`, between rows first.

    Parameters
    ----------
    image : ndarray of shape (h, w, 3)
    places : tuple of four ndarrays
        Lower rows (H,) and the share of the next, columns (W,) and the share of the next.
    weight : ndarray of shape (H, W, 3) or (1, 1, 3)
    out : ndarray of shape (H, W, 3), added to
    """
    rows, down, cols, right = places
    height, width, same = out.shape[0], out.shape[1], image.shape[1] == out.shape[1]
    line = np.empty(3 * image.shape[1], np.float32)
    for row in range(height):
        low = rows[row]
        upper, lower = image[low].reshape(-1), image[min(low + 1, len(image) - 1)].reshape(-1)
        share = down[row]
        for k in range(len(line)):
            line[k] = upper[k] + (lower[k] - upper[k]) * share
        of = weight[row % len(weight)]
        for col in range(width):
            at, at_weight = 3 * cols[col], col % len(of)
            after = at if same else min(at + 3, len(line) - 3)
            for c in range(3):
                value = line[at + c] + (line[after + c] - line[at + c]) * right[col]
                out[row, col, c] += of[at_weight, c] * value
