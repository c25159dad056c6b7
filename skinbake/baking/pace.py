"""How long the stages of a bake take on this machine, for whoever waits.

`skinbake.baking.cost_model` says what they take on the machine that it was fitted on. How much longer this one takes is
kept in the user's cache, a file a machine and version of the model; each bake renews it, and who removes the file
begins anew, with a guess by a moment's work. Of heads that were baked before it is kept by mesh: how much of one is in
its own shadow, or sees itself, is in no look, and makes one head take twice as long as another.
"""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Collection, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np

from skinbake.baking.cost_model import TRIANGLES, Work, share_of_wall, stage_seconds
from skinbake.baking.inputs import BakeInputs
from skinbake.baking.stage_log import StageLog
from skinbake.diffuse.scatter import LIKELY_LOBES
from skinbake.errors import SkinbakeError
from skinbake.io.atomic import write_text
from skinbake.io.code_digest import code_digest
from skinbake.io.digests import key_of
from skinbake.io.user_cache import user_cache
from skinbake.kernels.threads import processors
from skinbake.pipeline import Stages
from skinbake.scene.budget import Budget, budget_of
from skinbake.scene.spec import SceneSpec

LEAST, MOST = 0.05, 50.0  # times the model's seconds that a machine is believed to take
TELLING_TEXELS = 512 * 512  # the least whose time says something of the machine
NOTABLE = 0.1  # change of that which is worth a file
_ANY, _MOST_HEADS = "any", 64  # what is kept of any head, and of how many at most
MOMENT_S = 0.0115  # that `_first_guess` works on a machine that takes the model's seconds
STAGES = frozenset({"read", "raster", "profile", "irradiance", "diffuse", "relight", "preview", "write"})


def rule_of_thumb(spec: SceneSpec, budget: Budget | None = None, triangles: int = TRIANGLES) -> dict[str, float]:
    """Seconds of each stage on the machine that the model was fitted on, from the look and the length of its mesh.

    Parameters
    ----------
    spec : SceneSpec
    budget : Budget, optional
        Where the texture's size is decided: `spec` is then at that size.
    triangles : int
    """
    work = Work(2 if spec.texture.udim else 1, spec.skin.fit.gaussians or LIKELY_LOBES, triangles)
    return stage_seconds(spec, budget or budget_of(spec), work)


def paced(seconds: Mapping[str, float], spec: SceneSpec) -> dict[str, float]:
    """Seconds of the model as this machine takes them for a look."""
    kept = _kept()
    before = kept.get(_ANY, {}) | kept.get(_head(spec), {})
    return {name: of * _times(before, name) for name, of in seconds.items()}


def expected_seconds(inputs: BakeInputs, stages: Stages, asked: Collection[str] = STAGES) -> dict[str, float]:
    """Seconds of each stage that is about to run, about.

    Parameters
    ----------
    inputs : BakeInputs
    stages : Stages
    asked : collection of stage names
        Whose results are wanted.
    """
    light = bool(inputs.spec.lights and stages.irradiance.stale())
    lobes = "diffuse" in asked and bool(inputs.spec.lights) and bool(light or stages.diffuse.stale())
    later = stages.relight is not None and "relight" in asked and bool(stages.relight.stale())
    runs = dict.fromkeys(("read", "raster", "write"), light or lobes) | {"irradiance": light, "relight": later}
    runs |= dict.fromkeys(("profile", "diffuse", "preview"), lobes)
    rule = rule_of_thumb(inputs.spec, inputs.decisions.budget, inputs.triangles)
    return {name: s for name, s in paced(rule, inputs.spec).items() if name in asked and runs[name]}


def whole_seconds(spec: SceneSpec) -> float:
    """Seconds of a whole bake of which nothing is there yet, about."""
    return sum(paced(rule_of_thumb(spec), spec).values())


def keep_pace(inputs: BakeInputs, log: StageLog) -> None:
    """Keep how much longer than the rule of thumb this machine takes; nothing where there is no place for it.

    Stages that took nothing but reading say nothing, nor do small bakes, which take what the process takes.
    """
    if inputs.spec.texture.size[0] * inputs.spec.texture.size[1] < TELLING_TEXELS:
        return
    kept, rule = _kept(), rule_of_thumb(inputs.spec, inputs.decisions.budget, inputs.triangles)
    ran = {name: log.busy[name] / seconds for name, seconds in rule.items() if log.reused.get(name) is False}
    notable = _head(inputs.spec) != next(reversed(kept), None)
    for of in (_ANY, _head(inputs.spec)):
        before = kept.pop(of, {})
        kept[of] = now = before | {name: _believed(0.5 * (before.get(name, t) + t)) for name, t in ran.items()}
        notable |= any(abs(now[name] / before.get(name, MOST) - 1) > NOTABLE for name in now)
    for of in [each for each in kept if each != _ANY][:-_MOST_HEADS]:  # the longest ago
        del kept[of]
    path = _path()
    if path is not None and notable:
        with suppress(SkinbakeError, OSError):
            write_text(path, json.dumps(kept, indent=1) + "\n")


def _times(kept: Mapping[str, float], name: str) -> float:
    """How many times the model's seconds a stage takes here."""
    return kept[name] if name in kept else _first_guess()


@cache
def _first_guess() -> float:
    """How many times the model's seconds a machine takes of which nothing is kept: by a moment's work and its cores."""
    # Reads from here and there, and Python: what a kernel waits for. Not NumPy's sort, whose seconds say which
    # instructions a processor has
    random = np.random.default_rng(0)
    numbers, order = random.random(400_000, np.float32), random.permutation(400_000)
    taken = []
    for _ in range(3):
        begin = time.perf_counter()
        np.sqrt(numbers[order]).sum()
        sum(number * number for number in range(200_000))
        taken.append(time.perf_counter() - begin)
    return _believed(min(taken) / MOMENT_S * share_of_wall(processors()) / share_of_wall(2))


def _believed(times: float) -> float:
    return min(max(times, LEAST), MOST)


def _path() -> Path | None:
    cache = user_cache()
    machine = key_of(platform.node(), processors(), code_digest("skinbake.baking.cost_model"))[:12]
    return cache.folder / f"pace-{machine}.json" if cache else None


def _head(spec: SceneSpec) -> str:
    """What a look's mesh is known by."""
    return key_of(str(Path(spec.mesh.path).absolute()))[:12]


def _kept() -> dict[str, dict[str, float]]:
    """What was kept, of any head and of some, by stage; nothing where it is missing or damaged."""
    path = _path()
    try:
        found = json.loads(path.read_text(encoding="utf-8")) if path else {}
        return {
            str(of): {str(name): _believed(float(times)) for name, times in stages.items()}
            for of, stages in found.items()
        }
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        return {}
