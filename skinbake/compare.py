"""Comparison of two images: all finite, few values beyond their limit, none far beyond."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinbake.bilinear import magnify_bilinear
from skinbake.numerics import Float


@dataclass(frozen=True)
class Tolerance:
    """A value's limit is `absolute + relative * |reference|`.

    A share `allowed` of the values may pass it, none may pass `worst` times it. Relative alone fails near-black texels
    over nothing, absolute alone is wrong at one end of the range.
    """

    absolute: float = 1e-6
    relative: float = 1e-6
    allowed: float = 0.0
    worst: float = 1.0


@dataclass(frozen=True)
class Difference:
    """Figures of a comparison.

    Attributes
    ----------
    same : bool
    why : str
        The first test that failed, or "same".
    rms, max_absolute, max_relative : float
        `max_relative` is relative to the largest absolute value of the reference. NaN where nothing could be measured.
    relative_rms : float
        Rms over that of the reference: of a texture, of the skin alone, as both are 0 elsewhere.
    over : float
        Share of the values beyond their limit.
    worst_at : tuple of int
        Index of the value furthest beyond its limit.
    """

    same: bool
    why: str
    rms: float
    max_absolute: float
    max_relative: float
    over: float
    worst_at: tuple[int, ...]
    relative_rms: float


def compare(image: NDArray[np.floating], reference: NDArray[np.floating], tolerance: Tolerance) -> Difference:
    """Compare two arrays of one shape; NaN or infinity on either side is a difference, also where both have it.

    Parameters
    ----------
    image, reference : ndarray of one shape
    tolerance : Tolerance
    """
    if image.shape != reference.shape:
        return _unmeasured(f"shape {image.shape} against {reference.shape}")
    for name, values in (("image", image), ("reference", reference)):
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            at = tuple(int(i) for i in bad[0])
            return _unmeasured(f"{name}: {values[at]} at {at}, {len(bad)} values are not finite", at)
    wanted: Float = reference.astype(np.float64)
    difference = np.abs(image - wanted)
    if not difference.size:
        return Difference(True, "same", 0.0, 0.0, 0.0, 0.0, (), 0.0)
    excess = difference / np.maximum(tolerance.absolute + tolerance.relative * np.abs(wanted), np.finfo(float).tiny)
    at = tuple(int(i) for i in np.unravel_index(np.argmax(excess), excess.shape))
    over = float((excess > 1).mean())
    why = "same"
    if excess[at] > max(tolerance.worst, 1.0):
        why = f"{image[at]:.6g} against {wanted[at]:.6g} at {at}, {excess[at]:.3g} times its limit"
    elif over > tolerance.allowed:
        why = f"{over:.3%} of the values beyond their limit, {tolerance.allowed:.3%} allowed"
    top = float(np.abs(wanted).max())
    most = float(difference.max())
    rms, whole = float(np.sqrt((difference**2).mean())), float(np.sqrt((wanted**2).mean()))
    return Difference(why == "same", why, rms, most, _over(most, top), over, at, _over(rms, whole))


def _over(part: float, whole: float) -> float:
    """Share of the whole; infinite of a whole of nothing."""
    return part / whole if whole else (np.inf if part else 0.0)


def _unmeasured(why: str, at: tuple[int, ...] = ()) -> Difference:
    """Difference of images that could not be compared, or were not finite."""
    return Difference(False, why, np.nan, np.nan, np.nan, 1.0, at, np.nan)


def read_at(image: NDArray[np.floating], height: int, width: int) -> NDArray[np.float32]:
    """Image read bilinearly at the texel centres of another size, as a renderer reads a stored lobe.

    Parameters
    ----------
    image : ndarray of shape (h, w, channels)
    height, width : int

    Returns
    -------
    ndarray of shape (height, width, channels), float32
    """
    return magnify_bilinear(np.asarray(image, np.float32), (height, width))
