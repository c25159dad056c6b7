"""Pictures one after another as one file: .mp4 or .gif, by imageio."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.atomic import atomic_write

KINDS = (".mp4", ".gif")
NEEDS = {".mp4": ("imageio", "imageio_ffmpeg"), ".gif": ("imageio",)}
GIF_STEP_MS = 10  # in which a .gif counts


def refuse_movie(path: Path | str) -> None:
    """Stop before anything is drawn for a movie that cannot be written here.

    Raises
    ------
    InputError
        Another kind of file, or a library is missing.
    """
    kind = Path(path).suffix.lower()
    if kind not in KINDS:
        raise InputError(f"--movie {path}: expected a name that ends in {' or '.join(KINDS)}, got {kind or 'none'}")
    missing = [name for name in NEEDS[kind] if find_spec(name) is None]
    if missing:
        other = "; a .gif needs no more than is here" if missing == ["imageio_ffmpeg"] else ""
        raise InputError(f"{path}: needs {' and '.join(missing)}: pip install 'skinbake[movie]'{other}")


@contextmanager
def write_movie(path: Path | str, frames_per_second: float) -> Iterator[Callable[[NDArray[np.uint8]], None]]:
    """Give a function that takes the frames, sRGB (H, W, 3), one after another; the file appears at the end, whole.

    Parameters
    ----------
    path : ends in .mp4 or .gif
    frames_per_second : float
        A .gif counts in hundredths of a second.

    Raises
    ------
    InputError
        As `refuse_movie`; the folder cannot be written to.
    MachineError
        Disk full.
    """
    refuse_movie(path)
    import imageio.v2 as imageio

    how: dict[str, Any]
    held = BytesIO() if Path(path).suffix.lower() == ".gif" else None  # the library tries again what the disk refuses
    if held is not None:
        steps = max(round(1000 / frames_per_second / GIF_STEP_MS), 2)  # viewers take less than two for ten
        how = {"duration": steps * GIF_STEP_MS, "loop": 0}
    else:
        how = {"fps": frames_per_second, "codec": "libx264", "quality": 8, "macro_block_size": 2}
    with atomic_write(path) as temporary:
        writer: Any = imageio.get_writer(temporary if held is None else held, temporary.suffix, mode="I", **how)
        try:
            yield lambda pixels: writer.append_data(_even(pixels))
        finally:
            writer.close()
        if held is not None:
            temporary.write_bytes(held.getvalue())


def _even(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The frame with an even number of rows and columns, as a video wants: the last ones twice."""
    height, width = pixels.shape[:2]
    return np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
