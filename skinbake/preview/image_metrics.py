"""Perceptual difference of two previews."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from skinbake.preview.tonemap import srgb_encode, tonemap

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def image_similarity(picture: NDArray[np.float32], wanted: NDArray[np.float32]) -> tuple[float, float]:
    """Mean HDR-FLIP [Andersson2021] and structural similarity [Wang2004] of linear pictures of shape (h, w, 3).

    FLIP is 0 for equal pictures and NaN where flip-evaluator (the extra `dev`) is not installed; SSIM is 1 for equal
    pictures, taken on the sRGB luminance after the preview's own tone mapping.

    Raises
    ------
    ValueError
        If the shapes differ.
    """
    if picture.shape != wanted.shape:
        raise ValueError(f"image_similarity: expected pictures of one shape, got {picture.shape} and {wanted.shape}")
    from skimage.metrics import structural_similarity

    grey = [srgb_encode(((tonemap(image) / 255.0) ** 2.2) @ LUMINANCE) for image in (picture, wanted)]
    return _flip(picture, wanted), float(structural_similarity(*grey, data_range=1.0, gaussian_weights=True))


def _flip(picture: NDArray[np.float32], wanted: NDArray[np.float32]) -> float:
    """Mean HDR-FLIP, NaN where its library is not installed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # raised while its compiled types are imported
        try:
            from flip_evaluator import evaluate
        except ImportError:
            return float("nan")
        both = [np.ascontiguousarray(np.maximum(image, 0), np.float32) for image in (wanted, picture)]
        return float(evaluate(*both, "HDR", applyMagma=False)[1])
