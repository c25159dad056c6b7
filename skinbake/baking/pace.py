"""How long the stages of a bake take, for whoever waits: a rule of thumb, and what this machine made of it before."""

from __future__ import annotations

import json
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

from skinbake.baking.inputs import BakeInputs
from skinbake.baking.stage_log import StageLog
from skinbake.errors import SkinbakeError
from skinbake.io.atomic import write_text
from skinbake.io.user_cache import user_cache
from skinbake.pipeline import Stages
from skinbake.scene.spec import SceneSpec

NAME = "pace.json"
LEAST, MOST = 0.05, 50.0  # times the rule of thumb that a machine is believed to take
NOTABLE = 0.1  # change of that which is worth a file
STAGES = frozenset({"read", "raster", "profile", "irradiance", "diffuse", "preview", "write"})
LOBES = 6  # before the profile is fitted


def rule_of_thumb(spec: SceneSpec) -> dict[str, float]:
    """Seconds of each stage, as the sample head takes them at 256^2 to 2048^2 on two cores of a 2.6 GHz server."""
    tiles = 2 if spec.texture.udim else 1  # without reading the mesh
    megatexels = spec.texture.size[0] * spec.texture.size[1] * tiles / 2**20
    lights = len(spec.lights)
    return {
        "read": 0.7 + 0.1 * megatexels,
        "raster": 0.05 + 0.1 * megatexels,
        "profile": 0.05,
        "irradiance": lights * (0.15 + 0.2 * megatexels),
        "diffuse": 0.8 + lights * (0.03 * LOBES + 0.3 * megatexels),
        "preview": 1.0,
        "write": 0.05 + 0.2 * megatexels,
    }


def expected_seconds(inputs: BakeInputs, stages: Stages, asked: Collection[str] = STAGES) -> dict[str, float]:
    """Seconds of each stage that is about to run, about.

    Parameters
    ----------
    inputs : BakeInputs
    stages : Stages
    asked : collection of stage names
        Whose results are wanted.
    """
    light = bool(stages.irradiance.stale())
    lobes = "diffuse" in asked and bool(light or stages.diffuse.stale())
    runs = dict.fromkeys(("read", "raster", "write"), light or lobes) | {"irradiance": light}
    runs |= dict.fromkeys(("profile", "diffuse", "preview"), lobes)
    before = _kept()
    rule = rule_of_thumb(inputs.spec)
    return {name: s * before.get(name, 1.0) for name, s in rule.items() if name in asked and runs[name]}


def whole_seconds(spec: SceneSpec) -> float:
    """Seconds of a whole bake of which nothing is there yet, about."""
    before = _kept()
    return sum(seconds * before.get(name, 1.0) for name, seconds in rule_of_thumb(spec).items())


def keep_pace(inputs: BakeInputs, log: StageLog) -> None:
    """Keep how much longer than the rule of thumb this machine takes; nothing where there is no place for it.

    Stages that took nothing but reading say nothing.
    """
    before, rule = _kept(), rule_of_thumb(inputs.spec)
    ran = {name: log.busy[name] / seconds for name, seconds in rule.items() if log.reused.get(name) is False}
    now = before | {name: _believed(0.5 * (before.get(name, times) + times)) for name, times in ran.items()}
    path = _path()
    if path is not None and any(abs(now[name] / before.get(name, MOST) - 1) > NOTABLE for name in now):
        with suppress(SkinbakeError, OSError):
            write_text(path, json.dumps(now, indent=1, sort_keys=True) + "\n")


def _believed(times: float) -> float:
    return min(max(times, LEAST), MOST)


def _path() -> Path | None:
    cache = user_cache()
    return cache.folder / NAME if cache else None


def _kept() -> dict[str, float]:
    """What was kept; nothing where it is missing or damaged."""
    path = _path()
    try:
        found = json.loads(path.read_text(encoding="utf-8")) if path else {}
        return {str(name): _believed(float(times)) for name, times in found.items()}
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        return {}
