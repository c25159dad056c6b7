"""Multi-part EXR files: deterministic bytes, whole or not at all, nothing non-finite."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError
from skinbake.io.atomic import atomic_write

HALF_MAX = 65504.0
HALF_FAINT = (
    1.0 / 64
)  # a channel all below this would lose digits to half's subnormals (6e-5) within 8 stops of its top
# Rec.709 primaries and D65 white, as the chromaticities attribute wants them
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)


@dataclass(frozen=True)
class Part:
    """One image of a file: channels of equal shape (H, W), row 0 at v = 1, and its header attributes."""

    name: str
    channels: Mapping[str, NDArray[Any]]
    attributes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def rgb(self) -> NDArray[np.float32]:
        """R, G, B as (H, W, 3) float32."""
        return np.stack([np.asarray(self.channels[c], dtype=np.float32) for c in "RGB"], axis=-1)


def rgb_channels(image: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
    """Split (H, W, 3) into contiguous R, G, B."""
    return {c: np.ascontiguousarray(image[..., i]) for i, c in enumerate("RGB")}


def write_parts(
    path: Path | str,
    parts: Sequence[Part],
    attributes: Mapping[str, Any] | None = None,
    precision: str = "half",
    compression: str = "zip",
) -> None:
    """Write `parts` as one EXR with `attributes` in every part's header.

    With `precision="half"`, a channel whose values pass 65504, or are all so faint that half would lose their digits,
    is written as float instead.

    Raises
    ------
    InputError
        A value is NaN or infinite; the message names part, channel and texel.
    """
    import OpenEXR

    codec = {
        "none": OpenEXR.NO_COMPRESSION,
        "rle": OpenEXR.RLE_COMPRESSION,
        "zips": OpenEXR.ZIPS_COMPRESSION,
        "zip": OpenEXR.ZIP_COMPRESSION,
        "piz": OpenEXR.PIZ_COMPRESSION,
    }[compression]
    made = []
    for part in parts:
        header = {"chromaticities": REC709, "oiio:ColorSpace": "lin_rec709", **(attributes or {}), **part.attributes}
        header |= {"type": OpenEXR.scanlineimage, "compression": codec}
        channels = {name: _stored(path, part.name, name, values, precision) for name, values in part.channels.items()}
        made.append(OpenEXR.Part(header, channels, part.name))
    with atomic_write(path) as temporary:
        OpenEXR.File(made).write(str(temporary))


def _stored(path: Path | str, part: str, name: str, values: NDArray[Any], precision: str) -> NDArray[Any]:
    top = np.abs(values).max(initial=0.0)  # one pass: NaN and infinity both show here
    if not np.isfinite(top):
        row, column = np.argwhere(~np.isfinite(values))[0]
        raise InputError(
            f"{path}: part {part}, channel {name}: expected finite values, "
            f"got {values[row, column]} at column {column}, row {row}"
        )
    return np.ascontiguousarray(values, dtype=np.float16 if _fits_half(top, precision) else np.float32)


def _fits_half(top: float, precision: str) -> bool:
    """Whether a channel whose largest value is `top` keeps its three digits in half, shadows included."""
    return precision == "half" and (top == 0 or HALF_FAINT <= top <= HALF_MAX)


def as_stored(values: NDArray[np.float32], precision: str) -> NDArray[np.float32]:
    """`values` of shape (..., H, W, 3) as a file gives them back: each channel rounded as `write_parts` would."""
    if precision != "half":
        return values
    out = values.copy()
    for index in np.ndindex(values.shape[:-3]):
        for c in range(values.shape[-1]):
            channel = values[index][..., c]
            if _fits_half(float(np.abs(channel).max(initial=0.0)), precision):
                out[index][..., c] = channel.astype(np.float16)
    return out


def read_parts(path: Path | str) -> dict[str, Part]:
    """Read every part of an EXR by name, pixels as stored; a single-part file without a name has the name "".

    OpenImageIO reads, since OpenEXR's Python module gives a cut file without its pixels and no error.

    Raises
    ------
    InputError
        The file is missing, is not an EXR, or is cut short.
    """
    import OpenImageIO as oiio

    parts, index = {}, 0
    with _undamaged(path):
        source = _open(path)
        while source.seek_subimage(index, 0):
            spec = source.spec()
            pixels = source.read_image(index, 0, 0, spec.nchannels, oiio.UNKNOWN)
            if pixels is None:
                raise InputError(f"{path}: expected a whole EXR, got: {source.geterror()}")
            channels = {name: pixels[..., i] for i, name in enumerate(spec.channelnames)}
            name = str(spec.get_string_attribute("name"))
            parts[name] = Part(name, channels, {attribute.name: attribute.value for attribute in spec.extra_attribs})
            index += 1
    return parts


def read_attributes(path: Path | str) -> dict[str, dict[str, Any]]:
    """Header attributes of every part by name, without the pixels.

    Raises
    ------
    InputError
        The file is missing or is not an EXR.
    """
    headers, index = {}, 0
    with _undamaged(path):
        source = _open(path)
        while source.seek_subimage(index, 0):
            spec = source.spec()
            header = {attribute.name: attribute.value for attribute in spec.extra_attribs}
            headers[str(header.get("name", ""))] = header | {
                "size": [spec.width, spec.height],
                "channels": spec.channelnames,
            }
            index += 1
    return headers


@contextmanager
def _undamaged(path: Path | str) -> Iterator[None]:
    """Names in a damaged header are not text; OpenImageIO's binding then fails to decode them, or its own message."""
    try:
        yield
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected an EXR file, got one with a damaged header ({error.reason})") from error


def _open(path: Path | str) -> Any:
    import OpenImageIO as oiio

    if not Path(path).is_file():
        raise InputError(f"{path}: expected an EXR file, found none")
    source = oiio.ImageInput.open(str(path))
    if source is None or source.format_name() != "openexr":
        reason = oiio.geterror() or "another format"
        raise InputError(f"{path}: expected an EXR file, got: {reason.splitlines()[0]}")
    return source
