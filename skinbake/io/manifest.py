"""bake.json: the manifest of a bake, with its inputs, settings, timings and measured error."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field, model_validator

from skinbake.errors import InputError
from skinbake.io.atomic import write_text
from skinbake.io.config import parse_scene
from skinbake.io.digests import key_of
from skinbake.io.lobes import is_transmission
from skinbake.io.record import Record, read_record
from skinbake.io.weight_table import KEY, table_of_record
from skinbake.profile.weight_table import WeightTable
from skinbake.scene.mesh_files import OF_FILE
from skinbake.scene.spec import SceneSpec

NAME = "bake.json"


class _Entry(Record):
    """One lobe."""

    file: str
    tiles: dict[str, str] = Field({})
    weight_rgb: Annotated[list[float], Field(min_length=3, max_length=3)]
    variance_mm2: float
    size: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=2, max_length=2)]
    method: str


class _Model(Record):
    """Distance from light transport, as `truth` measured it."""

    rms: float
    stderr: float
    points: int
    of: str = ""


class _Error(Record):
    """Measured errors: the blur's, if there were probes, and the model's; there is no relative error of no light."""

    model_config = ConfigDict(allow_inf_nan=True)
    rms: float | None = None
    p95: float | None = None
    max: float | None = None
    probes: int | None = None
    method: float | None = None
    storage: float | None = None
    fit: list[float] | None = None
    texture_size: float = 0.0
    worst: dict[str, Any] | None = None
    model: _Model | None = None

    @model_validator(mode="after")
    def _whole(self) -> _Error:
        blur = [value is None for name, value in self if name not in ("model", "texture_size", "worst")]
        if any(blur) and not (all(blur) and self.model):
            raise ValueError("expected rms, p95, max, probes, method, storage and fit")
        return self


class _PlanLine(Record):
    """A `Decision`."""

    term: str
    kept: bool
    why: str


class _Relight(Record):
    """Textures for lights that come later."""

    file: str
    basis: str
    textures: int
    rms: dict[str, float]


class _Manifest(Record):
    """Keys that readers of a folder rely on. Only those without which the textures cannot be used are required."""

    version: str = "?"
    warnings: list[str] = Field([])
    config: dict[str, Any]
    inputs: dict[str, str] = Field({})
    irradiance: list[str] = Field(["irradiance.exr"])
    lobes: list[_Entry]
    weights_table: dict[str, Any] | None = None
    relight: _Relight | None = None
    lights: list[str] = Field([])
    terms: dict[str, Any] = Field({})
    timings: dict[str, float] = Field({})
    peak_memory_mib: float = 0.0
    error: _Error | None = None
    plan: list[_PlanLine] = Field([])
    bytes: dict[str, int] = Field({})

    @model_validator(mode="after")
    def _something(self) -> _Manifest:
        if not self.relight and not self.lobes:
            raise ValueError("expected lobes, or relight, got none")
        return self


def write_manifest(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Write bake.json, keys in the order given."""
    write_text(folder / NAME, json.dumps(manifest, indent=1, default=str) + "\n")


def read_manifest(folder: Path | str) -> dict[str, Any]:
    """Read bake.json of a bake folder.

    Raises
    ------
    InputError
        The folder has none, or it is not ours.
    """
    return read_record(Path(folder) / NAME, _Manifest, f"a bake folder with {NAME} in it")


def irradiance_files(manifest: Mapping[str, Any], folder: Path | str) -> list[str]:
    """Names of the files of light arriving, one a tile.

    Raises
    ------
    InputError
        The folder holds lobes of light that lies elsewhere.
    """
    names: list[str] = manifest["irradiance"]
    if not any((Path(folder) / name).exists() for name in names):
        raise InputError(
            f"{folder}: expected a whole bake, got lobes without the light that arrives, as `skinbake diffuse` leaves "
            "them; `skinbake bake` writes both, and of these lobes alone there are export --sum and --gltf"
        )
    return names


def changed_keys(look: SceneSpec, manifest: Mapping[str, Any], folder: Path | str) -> list[str]:
    """Keys, dotted, in which a look says otherwise than a bake of it, but for `preview` and `output`.

    Parameters
    ----------
    look : SceneSpec
        As it is now.
    manifest : mapping
        Of the bake.
    folder : path
        Where that lies.
    """
    baked = portable_config(spec_of(manifest, folder), Path(folder))
    return [
        ".".join(key)
        for key in _differing(portable_config(look, Path(folder)), baked)
        if key[0] not in ("preview", "output")
    ]


def _differing(one: Any, other: Any, key: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Keys of what two mappings have not in common; lists are compared whole."""
    if isinstance(one, dict) and isinstance(other, dict):
        names = dict.fromkeys((*one, *other))
        return [found for name in names for found in _differing(one.get(name), other.get(name), (*key, name))]
    return [] if one == other else [key]


def table_of(manifest: Mapping[str, Any], folder: Path | str) -> WeightTable | None:
    """Weights that differ over the skin; None where they do not.

    Raises
    ------
    InputError
        The table is damaged.
    """
    gaussians = sum(not is_transmission(lobe["method"]) for lobe in manifest["lobes"])
    try:
        return table_of_record(manifest[KEY], gaussians)
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        raise InputError(f"{Path(folder) / NAME}: {KEY}: {error}; bake it again") from error


_OF_TRANSPORT = ("mesh", "occluders", "texture", "skin", "lights", "shadows", "diffusion", "terms")


def transport_digest(manifest: Mapping[str, Any]) -> str:
    """What decides how far a bake is from light transport: mesh, medium, lights, blur, and the contents of their files.

    Maps and colours count nothing, as `truth` compares without them, nor does where files lie.
    """
    config = {key: manifest["config"].get(key) for key in _OF_TRANSPORT}
    config["skin"] = {key: value for key, value in config["skin"].items() if key != "normalise"}
    roles = ("mesh", "skin", "light.", "occluder.")
    inputs = [item for item in sorted(manifest["inputs"].items()) if item[0].startswith(roles)]
    return key_of([_mapped(config, lambda path: ""), inputs])


def portable_config(spec: SceneSpec, folder: Path) -> dict[str, Any]:
    """Effective configuration with paths relative to the bake folder, so that both can move together."""
    return _mapped(spec.model_dump(mode="json"), lambda path: Path(os.path.relpath(path, folder)).as_posix())


def spec_of(manifest: Mapping[str, Any], folder: Path | str) -> SceneSpec:
    """Look that a folder was baked from."""
    base = Path(folder).absolute()
    config = _mapped(manifest["config"], lambda path: os.path.normpath(base / path))
    return parse_scene(config, lambda key, sentence: f"{base / NAME}: config.{'.'.join(map(str, key))}: {sentence}")


def _mapped(value: Any, change: Any, key: str = "") -> Any:
    """The value with every path below it changed."""
    if isinstance(value, dict):
        return {k: _mapped(v, change, key if key == "opacity" else k) for k, v in value.items()}
    if isinstance(value, list):
        return [_mapped(v, change) for v in value]
    is_path = key in ("path", "dir", "opacity") and isinstance(value, str)
    return change(value) if is_path and not (key == "opacity" and value == OF_FILE) else value
