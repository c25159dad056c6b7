"""8-bit WebP pictures in memory."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray

QUALITY = 99  # coarser, pictures of the page differ from those of the preview by more than 2 of 255


def webp_bytes(rgb: NDArray[np.uint8], lossless: bool = False) -> bytes:
    """A WebP file of pixels (H, W, 3); the same pixels give the same bytes."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(rgb).save(
        file, "WEBP", lossless=lossless, quality=75 if lossless else QUALITY, method=4, exact=True
    )
    return file.getvalue()


def webp_pixels(data: bytes) -> NDArray[np.uint8]:
    """Pixels (H, W, 3) of a WebP file."""
    from PIL import Image

    with Image.open(io.BytesIO(data)) as image:
        return np.asarray(image.convert("RGB"))
