"""lobe_0.exr ...: one blurred irradiance texture a Gaussian, with its figures in the header."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field

from skinbake.diffuse.diffuse_map import Decision, DiffuseMap, Lobe, MeasuredError
from skinbake.errors import InputError
from skinbake.io.exr import channel_of, read_attributes, read_parts
from skinbake.io.exr_copy import copy_parts
from skinbake.io.irradiance import LAYOUTS, TOTAL, tile_path
from skinbake.io.output_names import is_output
from skinbake.io.packed_lobes import PackedLobes, lobe_parts
from skinbake.io.record import Record
from skinbake.io.spool import Spool
from skinbake.stored_precision import as_stored_with_sum

TRANSMISSION = "transmission"  # in files, in the place of a method


def lobe_name(index: int, lobe: Lobe | None = None) -> str:
    """File name of a lobe, without tile; light through thin parts has its own."""
    return f"{TRANSMISSION}.exr" if lobe is not None and lobe.transmitted else f"lobe_{index}.exr"


def stored_method(lobe: Lobe) -> str:
    """What files say of how a lobe was made: its method, or that it is light through thin parts."""
    return lobe.method or TRANSMISSION


def is_transmission(made_by: str) -> bool:
    """Whether a lobe is light through thin parts, from what its file says of how it was made."""
    return made_by == TRANSMISSION


class _ErrorRecord(Record):
    """A `MeasuredError`; there is no relative error of no light."""

    model_config = ConfigDict(allow_inf_nan=True)
    rms: float
    p95: float
    max: float
    probes: int
    method: float
    storage: float


Rgb = Annotated[list[float], Field(min_length=3, max_length=3)]


class _LobeRecord(Record):
    """A `Lobe` without its pixels."""

    file: str
    variance_mm2: Annotated[float, Field(ge=0)]
    weight_rgb: Rgb
    method: str
    error: _ErrorRecord | None
    total_rgb: Rgb | None = None


class _Summary(Record):
    """What the first file's header holds of a `DiffuseMap`."""

    lights: list[str]
    lobes: Annotated[list[_LobeRecord], Field(min_length=1)]
    error: _ErrorRecord | None
    plan: list[dict[str, Any]]
    tolerance_met: bool
    advice: str
    worst_mm: Rgb | None = None


@dataclass(frozen=True)
class StoredLobe(Lobe):
    """A lobe whose pixels are rounded as its file holds them.

    Attributes
    ----------
    total : dict of int to ndarray of shape (h, w, 3), float16 or float32
        By tile: the sum over the lights, taken before rounding.
    """

    total: dict[int, NDArray[np.floating]] = field(default_factory=dict)


def as_stored_lobes(result: DiffuseMap, precision: str, spool: Spool | None = None) -> DiffuseMap:
    """Result with `StoredLobe`s only. Takes the pixels out of `result`, lobe by lobe, lest all be in memory twice.

    Parameters
    ----------
    result : DiffuseMap
    precision, spool
        As of `as_stored_lobe`.
    """
    lobes = (each if isinstance(each, StoredLobe) else as_stored_lobe(each, precision, spool) for each in result.lobes)
    return replace(result, lobes=tuple(lobes))


def as_stored_lobe(lobe: Lobe, precision: str, spool: Spool | None = None) -> StoredLobe:
    """A lobe as its file will hold it. Takes the pixels out of `lobe`.

    Parameters
    ----------
    lobe : Lobe
    precision : "half" or "float"
    spool : Spool, optional
        Keeps the pixels until they are written.
    """
    spool, rgb, total = spool or Spool(), {}, {}
    for tile in list(lobe.rgb):
        each, together = as_stored_with_sum(lobe.rgb.pop(tile), precision, spool.empty)
        rgb[tile], total[tile] = spool.keep(each), spool.keep(together)
    return StoredLobe(**vars(lobe) | {"rgb": rgb, "total": total})


def write_lobes(
    folder: Path,
    result: DiffuseMap,
    key: str,
    attributes: Mapping[str, Any],
    precision: str,
    compression: str,
    separate: bool = True,
    udim: bool = False,
    layout: str = "multipart",
    spool: Spool | None = None,
    ahead: PackedLobes | None = None,
) -> None:
    """Write every lobe and tile; the first file's header holds the plan, so that a bake can be taken up from it.

    Parameters
    ----------
    folder : Path
    result : DiffuseMap
        Its lobes are `StoredLobe`s (`as_stored_lobes`); what two of them share is packed once.
    key : str
        Stage key, for every header.
    attributes : mapping
        For every header.
    precision, compression : str
        As `write_parts`.
    separate : bool
        Write a part a light besides the total.
    udim : bool
        Whether there are tiles.
    layout : "multipart" or "single"
        A file a lobe, or a file a part.
    spool : Spool, optional
        Has the pixels.
    ahead : PackedLobes, optional
        Has files of some of them, which are taken out of it.

    Raises
    ------
    InputError, MachineError
        As `write_parts`.
    """
    names = [lobe_name(index, lobe) for index, lobe in enumerate(result.lobes)]
    summary = {
        "worst_mm": None if result.worst_mm is None else [round(float(x), 3) for x in result.worst_mm],
        "lights": result.lights,
        "lobes": [
            {"file": name}
            | {f.name: getattr(lobe, f.name) for f in fields(Lobe) if f.name not in ("rgb", "error")}
            | {"method": stored_method(lobe), "error": asdict(lobe.error) if lobe.error else None}
            for name, lobe in zip(names, result.lobes, strict=True)
        ],
        "error": asdict(result.error) if result.error else None,
        "plan": [line.record() for line in result.plan],
        "tolerance_met": result.tolerance_met,
        "advice": result.advice,
    }
    header = dict(attributes) | {
        "skinbake:key": key,
        "skinbake:error": json.dumps(asdict(result.error) if result.error else None),
    }
    packed: dict[int, Path] = {}  # files by their pixels: several lobes may be the light itself
    parts_of = result.lights if separate else ()
    for index in reversed(range(len(result.lobes))):  # lobe_0 last: a folder that has it has them all
        lobe = result.lobes[index]
        own: dict[str, Any] = {
            "skinbake:variance_mm2": float(lobe.variance_mm2),
            "skinbake:weight_rgb": [float(w) for w in lobe.weight_rgb],
            "skinbake:method": stored_method(lobe),
        }
        if index == 0:
            own["skinbake:diffusion"] = json.dumps(summary)
        assert isinstance(lobe, StoredLobe)
        for tile, rgb in lobe.rgb.items():
            path = tile_path(folder / names[index], tile, udim)
            same = packed.get(id(rgb)) or (ahead.take(rgb, parts_of) if ahead else None)
            if layout != "multipart" or same is None or not copy_parts(same, path, header | own):
                LAYOUTS[layout](path, lobe_parts(rgb, lobe.total[tile], parts_of), header | own, precision, compression)
            packed[id(rgb)] = path
            if ahead:
                ahead.drop(rgb)
            if spool is not None:
                spool.rest()


def read_summary(folder: Path, key: str, tiles: tuple[int, ...], udim: bool) -> DiffuseMap | None:
    """Result that `write_lobes` wrote, without the pixels; None where any of it is missing or stale.

    Parameters
    ----------
    folder : Path
    key : str
        Stage key that the files must have.
    tiles : tuple of int
    udim : bool
        Whether there are tiles.
    """
    header = _header(tile_path(folder / lobe_name(0), tiles[0], udim))
    if header.get("skinbake:key") != key:
        return None
    try:
        return _summary(folder, header, key, tiles, udim)
    except (LookupError, ValueError, TypeError, AttributeError, RecursionError):  # damaged: as good as missing
        return None


def _summary(folder: Path, header: dict[str, Any], key: str, tiles: tuple[int, ...], udim: bool) -> DiffuseMap | None:
    """Result without pixels from the first file's header, checked against every file."""
    summary = _Summary.model_validate(json.loads(header["skinbake:diffusion"])).model_dump()
    lobes = []
    for entry in summary["lobes"]:  # attributes of the files are float32, these figures are not rounded
        name, shapes = entry.pop("file"), {}
        if not is_output(name):
            return None
        for tile in tiles:
            header = _header(tile_path(folder / name, tile, udim))
            if header.get("skinbake:key") != key:
                return None
            width, height = header["size"]
            shapes[tile] = np.zeros((0, height, width, 3), np.float32)
        own, method = entry.pop("error"), entry.pop("method")
        entry |= {key: tuple(value) for key, value in entry.items() if isinstance(value, list)}
        lobes.append(
            Lobe(
                **entry,
                method=None if is_transmission(method) else method,
                rgb=shapes,
                error=MeasuredError(**own) if own else None,
            )
        )
    error = MeasuredError(**summary["error"]) if summary["error"] else None
    return DiffuseMap(
        tuple(summary["lights"]),
        tuple(lobes),
        error,
        tuple(Decision.from_record(line) for line in summary["plan"]),
        tolerance_met=summary["tolerance_met"],
        advice=summary["advice"],
        worst_mm=None if summary["worst_mm"] is None else np.array(summary["worst_mm"], np.float64),
    )


def read_totals(folder: Path, result: DiffuseMap, udim: bool) -> DiffuseMap:
    """Lobes with the sums over their lights, as `StoredLobe`s, still without the lights themselves.

    Parameters
    ----------
    folder : Path
    result : DiffuseMap
        From `read_summary`.
    udim : bool
        Whether each tile has its own file.

    Raises
    ------
    InputError
        A file is missing or damaged.
    """
    lobes = []
    for index, lobe in enumerate(result.lobes):
        total = {}
        for tile in lobe.rgb:
            path = tile_path(folder / lobe_name(index, lobe), tile, udim)
            parts = read_parts(path, [TOTAL])
            total[tile] = np.stack([channel_of(path, parts, TOTAL, c) for c in "RGB"], axis=-1)
        lobes.append(StoredLobe(**vars(lobe) | {"total": total}))
    return replace(result, lobes=tuple(lobes))


def _header(path: Path) -> dict[str, Any]:
    """Header of a file's total, empty where there is no such file."""
    try:
        return read_attributes(path).get(TOTAL, {})
    except InputError:
        return {}
