"""`.tx` files for renderers: tiled half-float EXR with mip levels, made by OpenImageIO from the bake's own files."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.atomic import atomic_write, system_error
from skinbake.io.exr import OF_FILES, Part, part_file, read_attributes, read_parts
from skinbake.io.irradiance import LIGHT, TOTAL

TILE, HEADER_BYTES = 64, 1 << 16  # texels of the library's tiles along a side; more than a header takes
NO_DATE = "1970:01:01 00:00:00"  # the library stamps the time otherwise: the same bake would give other bytes


def tx_path(exr: Path, light: str | None = None) -> Path:
    """Path of a .tx: `lobe_0.tx` for lobe_0.exr, `lobe_0.key.tx` for its light "key"; a tile's number stays last."""
    return (part_file(exr, LIGHT + light) if light else exr).with_suffix(".tx")


def write_tx(exr: Path, coverage: NDArray[np.floating] | None = None) -> list[Path]:
    """Write the total of one of our EXR files, and each light in it, as .tx beside it.

    Texels off the charts are filled from the closest ones, so that mip levels do not draw black over the borders.

    Parameters
    ----------
    coverage : ndarray of shape (H, W), optional
        Share of each texel on a chart; may be larger than the image. Without it, what is not black is on a chart.

    Raises
    ------
    InputError
        The file is none of ours.
    MachineError
        Disk full.
    """
    written = []
    for name, part in read_parts(exr).items():
        if name != TOTAL and not name.startswith(LIGHT):
            raise InputError(f"{exr}: expected parts {TOTAL} and {LIGHT}NAME, got {name}")
        path = _path_of_part(exr, name)
        _write(path, part, _known(part.rgb, coverage))
        written.append(path)
    return written


def tx_paths(exr: Path) -> list[Path]:
    """Every .tx that `write_tx` makes of an EXR; none where there is no such file."""
    try:
        return [_path_of_part(exr, name) for name in read_attributes(exr)]
    except InputError:
        return []


def _path_of_part(exr: Path, part: str) -> Path:
    return tx_path(exr, part.removeprefix(LIGHT) if part.startswith(LIGHT) else None)


def is_current(exr: Path) -> bool:
    """Whether every .tx of an EXR was made from it as it is now."""
    try:
        for name, header in read_attributes(exr).items():
            path = _path_of_part(exr, name)
            if _identity(header) != next(iter(read_attributes(path).values())).get("skinbake:source"):
                return False
    except InputError:
        return False
    return True


def _identity(header: dict[str, Any]) -> str:
    """Text that tells one baking of a part from another."""
    return f"{header.get('skinbake:key', '')} {header.get('skinbake:inputs', '')} {header['size']}"


def _known(rgb: NDArray[np.float32], coverage: NDArray[np.floating] | None) -> NDArray[np.bool_]:
    """Texels with a value of their own: on a chart, or in its filled gutter."""
    known: NDArray[np.bool_] = np.any(rgb > 0, axis=-1)
    if coverage is not None:
        rows, columns = np.nonzero(coverage > 0)
        height, width = known.shape
        known[rows * height // coverage.shape[0], columns * width // coverage.shape[1]] = True
    return known


def _refuse_full(path: Path, size: tuple[int, ...], value_bytes: int) -> None:
    """Refuse to begin where there is no room for all levels, uncompressed: the library waits for ever on a full
    disk.
    """
    texels, height, width = 0, size[0], size[1]
    while True:
        texels += -(-height // TILE) * -(-width // TILE) * TILE**2
        if height == width == 1:
            break
        height, width = max(1, height // 2), max(1, width // 2)
    if shutil.disk_usage(path.parent).free < 3 * value_bytes * texels + HEADER_BYTES:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def _write(path: Path, part: Part, known: NDArray[np.bool_]) -> None:
    """Write one part as .tx, the texels off the charts filled."""
    import OpenImageIO as oiio

    rgba = np.dstack([part.rgb * known[..., None], known.astype(np.float32)])
    image = oiio.ImageBuf(np.ascontiguousarray(rgba, np.float32))
    filled = oiio.ImageBufAlgo.channels(oiio.ImageBufAlgo.fillholes_pushpull(image), (0, 1, 2))
    spec = filled.specmod()
    for name, value in part.attributes.items():
        if name.startswith("skinbake:") and name not in OF_FILES and isinstance(value, str | int | float):
            spec.attribute(name, value)
    spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), part.attributes["chromaticities"])
    header = dict(part.attributes) | {"size": [known.shape[1], known.shape[0]]}
    spec.attribute("skinbake:source", _identity(header))
    spec.attribute("oiio:ColorSpace", "lin_rec709")
    spec.attribute("DateTime", NO_DATE)
    half = all(channel.dtype == np.float16 for channel in part.channels.values())
    how = oiio.ImageSpec()
    how.attribute("maketx:fileformatname", "openexr")
    how.attribute("wrapmodes", "clamp,clamp")
    how.set_format("half" if half else "float")
    with atomic_write(path) as temporary:
        _refuse_full(path, known.shape, 2 if half else 4)
        if not oiio.ImageBufAlgo.make_texture(oiio.MakeTxTexture, filled, str(temporary), how):
            raise system_error(temporary, oiio.geterror())
