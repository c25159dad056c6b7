"""Slow, independent integrals that the tests compare with."""

from __future__ import annotations

import numpy as np


def fft_blur(image, t, shift=(0.0, 0.0)):
    """Exact discrete Gaussian of variance t = (y, x) of an image (H, W, C) in the dark, at texel centres + shift."""
    height, width = image.shape[:2]
    pads = [int(min(8 * np.sqrt(v) + 16, 12 * n + 64)) for v, n in zip(t, (height, width), strict=True)]
    dark = np.pad(image.astype(np.float64), ((pads[0], pads[0]), (pads[1], pads[1]), (0, 0)))
    wy = 2 * np.pi * np.fft.fftfreq(dark.shape[0])[:, None]
    wx = 2 * np.pi * np.fft.rfftfreq(dark.shape[1])[None]
    transfer = np.exp(t[0] * (np.cos(wy) - 1) + t[1] * (np.cos(wx) - 1) + 1j * (wy * shift[0] + wx * shift[1]))
    blurred = np.fft.irfft2(np.fft.rfft2(dark, axes=(0, 1)) * transfer[..., None], s=dark.shape[:2], axes=(0, 1))
    return blurred[pads[0] : pads[0] + height, pads[1] : pads[1] + width]


def brute_force(position, normal, sources, source_normal, area, light, variance, separate):
    """Normalised Gaussian sum over every source, float64, without any neighbour search."""
    out = np.zeros((len(position), light.shape[1]))
    for i, (x, n) in enumerate(zip(position.astype(np.float64), normal.astype(np.float64), strict=True)):
        d = sources.astype(np.float64) - x
        d2 = (d * d).sum(1)
        w = area * np.exp(-d2 / (2 * variance))
        if separate:
            facing = np.clip(-2 * (source_normal @ n), 0, 1)
            toward = np.maximum(d @ n, 0) * np.maximum(-(d * source_normal).sum(1), 0)
            across = np.minimum(16 * toward / np.maximum(d2, 1e-30), 1)
            w = w * (1 - facing**2 * (3 - 2 * facing) * across**2 * (3 - 2 * across))
        out[i] = w @ light / w.sum()
    return out
