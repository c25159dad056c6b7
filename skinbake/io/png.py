"""8-bit PNG files, whole or not at all."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.atomic import atomic_write, system_error
from skinbake.io.output_names import SOFTWARE

_ONE_COLOUR, _SMALL_BYTES = 100, 10_000  # times that deflate packs one colour, at least; with headers
_LAST_CHUNK = b"IEND\xaeB`\x82"


def png_bytes(rgb: NDArray[np.uint8]) -> bytes:
    """A PNG file of pixels (H, W, 3), to be put into another file; the same pixels give the same bytes."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(rgb).save(file, "PNG", compress_level=4)
    return file.getvalue()


def write_png(path: Path | str, rgb: NDArray[np.uint8]) -> None:
    """Write sRGB-encoded pixels; the same pixels give the same bytes.

    Parameters
    ----------
    path : ends in .png
    rgb : ndarray of shape (H, W, 3), uint8

    Raises
    ------
    InputError
        The name ends in something else, or the folder cannot be written to.
    """
    import OpenImageIO as oiio

    if Path(path).suffix.lower() != ".png":
        raise InputError(f"{path}: expected a name that ends in .png")
    if rgb.dtype != np.uint8 or rgb.ndim != 3 or rgb.shape[2] != 3:
        raise ValueError(f"rgb: expected uint8 of shape (H, W, 3), got {rgb.dtype} of {rgb.shape}")
    spec = oiio.ImageSpec(rgb.shape[1], rgb.shape[0], 3, "uint8")
    spec.attribute("oiio:ColorSpace", "sRGB")
    spec.attribute("Software", SOFTWARE)
    spec.attribute("png:compressionLevel", 4)  # 6 takes twice as long for a file 6 % smaller
    with atomic_write(path) as temporary:
        output = oiio.ImageOutput.create(str(temporary))
        if output is None or not output.open(str(temporary), spec):
            raise system_error(temporary, oiio.geterror())
        written = output.write_image(np.ascontiguousarray(rgb))
        # The library does not notice a disk that is full: then the last chunk is missing
        if not (output.close() and written) or not temporary.read_bytes().endswith(_LAST_CHUNK):
            raise system_error(temporary, output.geterror())


def has_one_colour(path: Path) -> bool:
    """Whether all pixels of one of our pictures are the same; False where there is none."""
    from PIL import Image

    try:
        with Image.open(path) as picture:
            # Such a file is small, and only a small one is worth unpacking
            small = path.stat().st_size < max(picture.width * picture.height * 3 / _ONE_COLOUR, _SMALL_BYTES)
            return small and all(low == high for low, high in np.reshape(picture.getextrema(), (-1, 2)))
    except (OSError, SyntaxError, ValueError):
        return False
