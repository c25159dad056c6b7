"""bake.json: what was baked, from what, how, how long it took and how wrong it is."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from skinbake.errors import InputError
from skinbake.io.atomic import write_text
from skinbake.scene.parse import parse
from skinbake.scene.spec import SceneSpec

NAME = "bake.json"


class _Entry(BaseModel):
    """One lobe, as far as readers of a folder need it; other keys are free."""

    model_config = ConfigDict(allow_inf_nan=False)
    file: str
    tiles: dict[str, str] = {}
    weight_rgb: tuple[float, float, float]
    variance_mm2: float
    method: str = ""


class _Manifest(BaseModel):
    """What readers of a folder rely on; other keys are free."""

    config: dict[str, Any]
    lobes: list[_Entry]
    lights: list[str] = []
    irradiance: list[str] = Field(["irradiance.exr"], min_length=1)
    terms: dict[str, Any] = {}


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
    path = Path(folder) / NAME
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: expected a bake folder with {NAME} in it, got: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected JSON, got: {error}") from error
    if not isinstance(manifest, dict):
        raise InputError(f"{path}: expected a manifest with config and lobes")
    parse(_Manifest, manifest, lambda key, sentence: f"{path}: {'.'.join(map(str, key))}: {sentence}")
    return manifest


def portable_config(spec: SceneSpec, folder: Path) -> dict[str, Any]:
    """The effective configuration, its paths relative to the bake folder, so that both can move together."""
    return _mapped(spec.model_dump(mode="json"), lambda path: Path(os.path.relpath(path, folder)).as_posix())


def spec_of(manifest: Mapping[str, Any], folder: Path | str) -> SceneSpec:
    """The look a folder was baked from."""
    base = Path(folder).absolute()
    config = _mapped(manifest["config"], lambda path: os.path.normpath(base / path))
    return parse(
        SceneSpec, config, lambda key, sentence: f"{base / NAME}: config.{'.'.join(map(str, key))}: {sentence}"
    )


def _mapped(value: Any, change: Any, key: str = "") -> Any:
    if isinstance(value, dict):
        return {k: _mapped(v, change, k) for k, v in value.items()}
    if isinstance(value, list):
        return [_mapped(v, change) for v in value]
    return change(value) if key in ("path", "dir") and isinstance(value, str) else value
