"""relight.exr and relight.json: textures of a basis of light, how to use them, and how wrong they are."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

import skinbake
from skinbake.atlas import FIRST_TILE
from skinbake.errors import InputError
from skinbake.io.atomic import write_text
from skinbake.io.exr import Part, channel_of, read_parts, rgb_channels, write_parts
from skinbake.io.irradiance import tile_path
from skinbake.io.output_names import RELIGHT
from skinbake.io.record import Record, read_record
from skinbake.relight.basis import EACH, LightBasis
from skinbake.relight.light_error import KindError
from skinbake.relight.transfer import Transfer
from skinbake.scene.decision import Decision
from skinbake.stored_precision import as_stored

TEXTURES, VISIBILITY, USE = RELIGHT
MOST = 1e6  # a thousand times what light of radiance 1 is on any skin; NaN is not below it
PROJECTION = (
    "A light is c_k = sum_j of_harmonics[k][j] h_j a channel, and M = max(0, sum_k c_k T_k). T_k of the first "
    "in_colour lights is the part basis.k; of the others a channel of a part grey, as `parts` says, times the tint, "
    "which is basis.00 over the mean of its three channels. h_j of a sky is the "
    "integral of radiance times Y_j, of a sun its irradiance times Y_j towards it (where it comes from). Y_j are real "
    "and orthonormal over the sphere, j = l^2 + l + m, pole +y, azimuth from +z towards +x; m > 0 with cos(m azimuth), "
    "m < 0 with sin(|m| azimuth), no Condon-Shortley phase. L = M / pi; what of the albedo comes after scattering is "
    "not in it."
)


class _KindRecord(Record):
    """A `KindError`."""

    lights: int
    rms: float
    p95: float
    worst: float
    worst_light: dict[str, Any]
    worst_at: dict[str, Any]
    clamped: float


class _Use(Record):
    """What readers of relight.json rely on."""

    basis: str
    textures: Annotated[int, Field(ge=1)]
    in_colour: int | None = None  # of all lights, where it is not there
    key: str
    files: dict[str, str] = Field(min_length=1)
    visibility: dict[str, str] = Field(min_length=1)
    size: Annotated[list[Annotated[int, Field(ge=1, le=1 << 16)]], Field(min_length=2, max_length=2)]
    of_harmonics: list[list[float]] = Field(min_length=1)
    error: dict[str, _KindRecord]
    judged_at: Annotated[list[int], Field(min_length=2, max_length=2)]
    plan: list[dict[str, Any]]


def parts_of(basis: LightBasis) -> dict[str, list[int]]:
    """Parts of relight.exr, and which lights each holds: one in colour, or three that are grey, in R, G and B."""
    coloured = {f"basis.{k:02d}": [k] for k in range(basis.in_colour)}
    return coloured | {f"grey.{k:02d}": [k, k + 1, k + 2] for k in range(basis.in_colour, len(basis), EACH)}


def write_transfer(
    folder: Path,
    transfer: Transfer,
    key: str,
    attributes: Mapping[str, Any],
    precision: str,
    compression: str,
    udim: bool,
) -> None:
    """Write the textures, then relight.json: where that is, all of them are.

    Parameters
    ----------
    folder : Path
    transfer : Transfer
    key : str
        Stage key, for every header.
    attributes : mapping
        For every header.
    precision, compression : str
        As `write_parts`.
    udim : bool
        Whether there are tiles.

    Raises
    ------
    InputError, MachineError
        As `write_parts`.
    """
    files = {tile: tile_path(folder / TEXTURES, tile, udim) for tile in transfer.textures}
    for tile, textures in transfer.textures.items():
        names = parts_of(transfer.basis)
        parts = [Part(name, rgb_channels(image)) for name, image in zip(names, textures, strict=True)]
        write_parts(files[tile], parts, dict(attributes) | {"skinbake:key": key}, precision, compression)
    for tile, seen in transfer.visibility.items():
        parts = [Part(f"visibility.{k}", rgb_channels(image)) for k, image in enumerate(seen)]
        path = tile_path(folder / VISIBILITY, tile, udim)
        write_parts(path, parts, dict(attributes) | {"skinbake:key": key}, "half", compression)
    height, width = next(iter(transfer.textures.values())).shape[1:3]
    basis = transfer.basis
    record = {
        "basis": basis.kind,
        "textures": basis.textures,
        "in_colour": basis.in_colour,
        "version": skinbake.__version__,
        "key": key,
        "files": {str(tile): path.name for tile, path in files.items()},
        "visibility": {str(tile): tile_path(folder / VISIBILITY, tile, udim).name for tile in transfer.visibility},
        "size": [width, height],
        "error": {kind: error.record() for kind, error in transfer.error.items()},
        "judged_at": list(transfer.judged_at),
        "plan": [line.record() for line in transfer.plan],
        "projection": PROJECTION,
        "parts": parts_of(basis),
        "order": basis.order,
        "of_harmonics": basis.of_harmonics.tolist(),
    }
    text = json.dumps({name: value for name, value in record.items() if name != "of_harmonics"}, indent=1)
    rows = ",\n  ".join(json.dumps(row) for row in record["of_harmonics"])
    write_text(folder / USE, f'{text.removesuffix("}").rstrip()},\n "of_harmonics": [\n  {rows}\n ]\n}}\n')


def transfer_entry(transfer: Transfer) -> dict[str, NDArray[Any]]:
    """A transfer as the cache holds it."""
    use = {
        "basis": transfer.basis.kind,
        "grey": transfer.basis.grey,
        "error": {kind: error.record() for kind, error in transfer.error.items()},
        "judged_at": list(transfer.judged_at),
        "plan": [line.record() for line in transfer.plan],
    }
    entry: dict[str, NDArray[Any]] = {"of_harmonics": transfer.basis.of_harmonics}
    entry["use"] = np.frombuffer(json.dumps(use).encode(), np.uint8)
    for tile in transfer.textures:
        entry |= {f"{tile}.textures": transfer.textures[tile], f"{tile}.visibility": transfer.visibility[tile]}
    return entry


def transfer_of_entry(entry: Mapping[str, NDArray[Any]]) -> Transfer:
    """The transfer of `transfer_entry`."""
    use = json.loads(entry["use"].tobytes())
    matrix = entry["of_harmonics"]
    tiles = [int(name.partition(".")[0]) for name in entry if name.endswith(".textures")]
    return Transfer(
        LightBasis(use["basis"], matrix, np.zeros((matrix.shape[1], 0)), use["grey"]),
        {tile: entry[f"{tile}.textures"] for tile in tiles},
        {tile: entry[f"{tile}.visibility"] for tile in tiles},
        {kind: KindError(**each) for kind, each in use["error"].items()},
        (use["judged_at"][0], use["judged_at"][1]),
        tuple(Decision.from_record(line) for line in use["plan"]),
    )


def stored_transfer(transfer: Transfer, precision: str) -> Transfer:
    """A transfer as its files give it back, textures as (T, H, W, 3) rounded."""
    rounded = {tile: as_stored(textures, precision) for tile, textures in transfer.textures.items()}
    seen = {tile: as_stored(image, "half") for tile, image in transfer.visibility.items()}
    return Transfer(transfer.basis, rounded, seen, transfer.error, transfer.judged_at, transfer.plan)


def read_use(folder: Path) -> dict[str, Any]:
    """Checked contents of relight.json.

    Raises
    ------
    InputError
        There is none, or it is damaged.
    """
    return read_record(folder / USE, _Use, f"a bake with {USE}, as `relight:` in its look makes it")


def transfer_of(folder: Path, tiles: bool = True) -> Transfer:
    """What `write_transfer` wrote.

    Parameters
    ----------
    folder : Path
    tiles : bool
        With the textures, as they are stored; without them each tile has none.

    Raises
    ------
    InputError
        Something is missing or damaged.
    """
    use = read_use(folder)
    try:
        matrix = np.array(use["of_harmonics"], np.float64)
        order = int(np.sqrt(matrix.shape[1])) - 1
        error = {kind: KindError(**each) for kind, each in use["error"].items()}
        plan = tuple(Decision.from_record(line) for line in use["plan"])
    except (ValueError, TypeError, KeyError, IndexError) as fault:
        raise InputError(f"{folder / USE}: expected what a bake wrote, got: {fault}; bake it again") from fault
    lights = use["textures"]
    if use["in_colour"] is not None:
        if not 1 <= use["in_colour"] <= lights:
            raise InputError(
                f"{folder / USE}: in_colour: expected 1 to {lights}, got {use['in_colour']}; bake it again"
            )
        lights += (EACH - 1) * (lights - use["in_colour"])
    if len(matrix) != lights:
        raise InputError(
            f"{folder / USE}: of_harmonics: expected {lights} rows, one a light, got {len(matrix)}; bake it again"
        )
    if matrix.ndim != 2 or matrix.shape[1] != (order + 1) ** 2 or not (np.abs(matrix) < MOST).all():
        raise InputError(f"{folder / USE}: of_harmonics: expected rows of a square number of values below {MOST:g}")
    # A reader has no use for the radiance of the lights themselves
    grey = 0 if use["in_colour"] is None else lights - use["in_colour"]
    basis = LightBasis(use["basis"], matrix, np.zeros((matrix.shape[1], 0)), grey)
    textures, seen = {}, {}
    for number, name in use["files"].items():
        tile = int(number) if number.isdecimal() else FIRST_TILE
        textures[tile] = np.zeros((0, use["size"][1], use["size"][0], 3), np.float16)
        if tiles:
            textures[tile] = _read(folder / name, list(parts_of(basis)))
            path = folder / use["visibility"].get(number, VISIBILITY)
            seen[tile] = _read(path, [f"visibility.{k}" for k in range(3)])
    width, height = use["judged_at"]
    return Transfer(basis, textures, seen, error, (width, height), plan)


def _read(path: Path, names: list[str]) -> NDArray[np.floating]:
    """Parts of a file, (K, H, W, 3).

    Raises
    ------
    InputError
        It has others, or more of them.
    """
    parts = read_parts(path)
    if len(parts) != len(names):
        raise InputError(f"{path}: expected {len(names)} parts, as {USE} says, got {len(parts)}; bake it again")
    return np.stack([np.stack([channel_of(path, parts, name, c) for c in "RGB"], axis=-1) for name in names])
