"""Image files made by script, as other programs leave them."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

P3_D65 = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290)
ADOBE_RGB = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.3290)
ACES_AP1 = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
D50_XY = (0.3457, 0.3585)


def save(path: Path, pixels, kind=oiio.UINT8, channels: Sequence[str] = (), alpha: int = -1, **attributes) -> Path:
    """Write (h, w, c) with OpenImageIO; `oiio__ColorSpace` is the attribute oiio:ColorSpace."""
    pixels = np.asarray(pixels)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    if channels:
        spec.channelnames = tuple(channels)
    if alpha >= 0:
        spec.alpha_channel = alpha
    for name, value in attributes.items():
        name = name.replace("__", ":")
        if name == "chromaticities":
            spec.attribute(name, oiio.TypeDesc("float[8]"), value)
        elif name == "ICCProfile":
            spec.attribute(name, oiio.TypeDesc(f"uint8[{len(value)}]"), np.frombuffer(value, np.uint8))
        else:
            spec.attribute(name, value)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec), out.geterror()
    assert out.write_image(np.ascontiguousarray(pixels)), out.geterror()
    out.close()
    return path


def to_xyz(chromaticities) -> np.ndarray:
    """Linear RGB of a space to XYZ, white at Y = 1."""
    xy = np.reshape(chromaticities, (4, 2)).astype(float)
    xyz = np.column_stack([xy, 1 - xy.sum(axis=1)])
    return xyz[:3].T * np.linalg.solve(xyz[:3].T, xyz[3] / xyz[3, 1])


def icc_profile(
    chromaticities=P3_D65, curve: bytes | None = None, space: bytes = b"RGB ", name="made by script"
) -> bytes:
    """A display profile of three primaries and one curve (sRGB's, by a parametric one, unless given)."""
    cone = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
    white, d50 = (np.array([x / y, 1, (1 - x - y) / y]) for x, y in (chromaticities[6:], D50_XY))
    adapted = np.linalg.inv(cone) @ np.diag((cone @ d50) / (cone @ white)) @ cone @ to_xyz(chromaticities)
    curve = curve or parametric_curve(3, 2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
    tags = {b"desc": b"desc\0\0\0\0" + struct.pack(">I", len(name) + 1) + name.encode() + b"\0" * 79}
    if space == b"GRAY":
        tags[b"kTRC"] = curve
    else:
        tags |= {t + b"TRC": curve for t in (b"r", b"g", b"b")}
        tags |= {t + b"XYZ": b"XYZ \0\0\0\0" + _fixed(adapted[:, i]) for i, t in enumerate((b"r", b"g", b"b"))}
    tags[b"wtpt"] = b"XYZ \0\0\0\0" + _fixed(d50)
    table, body, offset = struct.pack(">I", len(tags)), b"", 132 + 12 * len(tags)
    for tag, data in tags.items():
        data += b"\0" * (-len(data) % 4)
        table += struct.pack(">4sII", tag, offset + len(body), len(data))
        body += data
    size = 128 + len(table) + len(body)
    head = struct.pack(">I4sI4s4s4s12x4s28x", size, b"none", 0x02400000, b"mntr", space, b"XYZ ", b"acsp")
    head += _fixed(d50) + b"\0" * (128 - len(head) - 12)
    return head + table + body


def parametric_curve(form: int, *parameters: float) -> bytes:
    """A `para` tag."""
    return b"para\0\0\0\0" + struct.pack(">HH", form, 0) + _fixed(parameters)


def table_curve(values) -> bytes:
    """A `curv` tag of values 0 ... 1, or of one gamma."""
    values = np.asarray(values, float)
    stored = np.rint(values * (256 if len(values) == 1 else 65535)).astype(">u2")
    return b"curv\0\0\0\0" + struct.pack(">I", len(values)) + stored.tobytes()


def _fixed(values) -> bytes:
    return np.rint(np.asarray(values, float) * 65536).astype(">i4").tobytes()


def flat_png(path: Path, width: int, height: int) -> Path:
    """A white PNG of one channel and any size, in little memory."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    packer, rows = zlib.compressobj(1), b"\0" + b"\xff" * width
    data = b"".join(packer.compress(rows) for _ in range(height)) + packer.flush()
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b""))
    return path


def ultra_hdr(
    path: Path, level: int, gain_level: int = 255, stops: float = 2.0, profile: bytes | None = None, size=(64, 64)
) -> Path:
    """A grey JPEG with a gain map beside it (hdrgm 1.0, MPF), as phones write them."""
    from PIL import Image

    def jpeg(mode, size, value, **more) -> bytes:
        buffer = io.BytesIO()
        Image.new(mode, size, value).save(buffer, "JPEG", quality=95, subsampling=0, **more)
        return buffer.getvalue()

    def app1(inner: str) -> bytes:
        rdf = 'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"'
        text = f'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF {rdf}>{inner}</rdf:RDF></x:xmpmeta>'
        data = b"http://ns.adobe.com/xap/1.0/\0" + text.encode()
        return b"\xff\xe1" + struct.pack(">H", len(data) + 2) + data

    hdrgm = 'xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" hdrgm:Version="1.0"'
    settings = {"GainMapMin": 0, "GainMapMax": stops, "Gamma": 1, "OffsetSDR": 0, "OffsetHDR": 0, "HDRCapacityMin": 0}
    settings |= {"HDRCapacityMax": stops, "BaseRenditionIsHDR": False}
    said = " ".join(f'hdrgm:{name}="{value}"' for name, value in settings.items())
    gain = jpeg("L", (16, 16), gain_level)
    gain = gain[:2] + app1(f"<rdf:Description {hdrgm} {said}/>") + gain[2:]
    google = "http://ns.google.com/photos/1.0/container/"
    item = '<rdf:li rdf:parseType="Resource"><Container:Item Item:Semantic="{}" Item:Mime="image/jpeg"{}/></rdf:li>'
    items = item.format("Primary", "") + item.format("GainMap", f' Item:Length="{len(gain)}"')
    listed = f"<Container:Directory><rdf:Seq>{items}</rdf:Seq></Container:Directory>"
    names = f'xmlns:Container="{google}" xmlns:Item="{google}item/" {hdrgm}'
    base = jpeg("RGB", size, (level,) * 3, **({"icc_profile": profile} if profile else {}))
    base = base[:2] + app1(f"<rdf:Description {names}>{listed}</rdf:Description>") + base[2:]
    mpf = b"MPF\0II*\0\x08\0\0\0" + struct.pack("<H", 3) + struct.pack("<HHI4s", 0xB000, 7, 4, b"0100")
    mpf += struct.pack("<HHII", 0xB001, 4, 1, 2) + struct.pack("<HHII", 0xB002, 7, 32, 50) + struct.pack("<I", 0)
    at = base.index(b"\xff\xdb")
    total, start = len(base) + len(mpf) + 36, at + 8
    mpf += struct.pack("<IIIHH", 0x030000, total, 0, 0, 0) + struct.pack("<IIIHH", 0, len(gain), total - start, 0, 0)
    path.write_bytes(base[:at] + b"\xff\xe2" + struct.pack(">H", len(mpf) + 2) + mpf + base[at:] + gain)
    return path


def radiance_file(path: Path, stored, line: str, header: str = "FORMAT=32-bit_rle_rgbe") -> Path:
    """A `.hdr` of pixels in the order in which they are stored, whatever `line` makes of it."""
    stored = np.asarray(stored, np.float32)
    exponent = np.ceil(np.log2(np.maximum(stored.max(axis=2), 1e-30)) + 1e-6)
    mantissa = np.clip(np.floor(stored * (256 / 2**exponent)[..., None]), 0, 255).astype(np.uint8)
    rgbe = np.dstack([mantissa, (exponent + 128).astype(np.uint8)])
    path.write_bytes(f"#?RADIANCE\n{header}\n\n{line}\n".encode() + rgbe.tobytes())
    return path
