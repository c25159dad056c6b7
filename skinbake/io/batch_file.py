"""Batch files: many looks from one YAML file, every fault with its line and the jobs it concerns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from skinbake.errors import ConfigError, InputError
from skinbake.io.config import frames_of, load_frames, parse_look
from skinbake.io.frames import frame_name
from skinbake.io.look_paths import absolute_path, resolve_paths
from skinbake.io.merge import lay_over, part_of
from skinbake.io.overrides import apply_overrides, put
from skinbake.io.presets import merge_preset
from skinbake.io.yaml_lines import Located, read_yaml
from skinbake.scene.batch import BatchSpec, PlannedJob, expand
from skinbake.scene.parse import parse
from skinbake.scene.spec import SceneSpec

BASE = "base"


@dataclass(frozen=True)
class BatchJob:
    """One look of a batch.

    Attributes
    ----------
    name : str
    spec : SceneSpec
    choices : mapping of axis to option
        What it is made of, for a look of the matrix.
    wanted : bool
        Whether `only` names it.
    """

    name: str
    spec: SceneSpec
    choices: Mapping[str, str]
    wanted: bool = True


@dataclass(frozen=True)
class Batch:
    """Looks of a batch file, and the folder that holds theirs."""

    path: Path
    folder: Path
    jobs: tuple[BatchJob, ...]


def load_batch(
    path: Path | str, overrides: Sequence[str] = (), out: Path | str | None = None, only: Sequence[str] = ()
) -> Batch:
    """Read a batch file and check every look in it.

    Parameters
    ----------
    path : path
    overrides : sequence of str
        `dotted.key=value`, applied to the wanted looks.
    out : path, optional
        In place of `output.dir`.
    only : sequence of str
        Names, a `*` in them stands for any letters: the jobs that are wanted.

    Raises
    ------
    InputError, ConfigError
        With a line for each fault, told once however many jobs it concerns.
    """
    path = Path(path)
    located = read_yaml(path)
    if "mesh" in located.value and not set(BatchSpec.model_fields) & set(located.value):
        if frames_of(path, overrides):
            return _sequence(path, overrides, out, only)
        told = "expected defaults, jobs, a matrix or frames, this is a look: use `skinbake bake`"
        raise ConfigError([located.say((), told)])
    spec = parse(BatchSpec, located.value, located.say)
    folder = Path(out).absolute() if out is not None else None
    plans = expand(spec)
    for pattern in only:
        if not any(fnmatchcase(plan.name, pattern) for plan in plans):
            raise InputError(f"--only {pattern}: expected one of {', '.join(plan.name for plan in plans)}")
    jobs, faults = [], dict[str, list[str]]()
    for plan in plans:
        wanted = not only or any(fnmatchcase(plan.name, pattern) for pattern in only)
        try:
            look = _look(located, plan, path.absolute().parent, overrides if wanted else (), folder)
            folder = folder or Path(look.output.dir)
            if look.frames:
                raise ConfigError(["frames: expected in a look of its own, for `skinbake batch`, got in a batch file"])
            inside = look.output.model_copy(update={"dir": str(folder / plan.name)})
            jobs.append(BatchJob(plan.name, look.model_copy(update={"output": inside}), plan.choices, wanted))
        except ConfigError as error:
            for fault in error.faults:
                faults.setdefault(fault, []).append(plan.name)
    if faults:
        raise ConfigError([f"{fault} ({_in_jobs(names)})" for fault, names in faults.items()])
    assert folder is not None
    return Batch(path, folder, tuple(jobs))


def _sequence(path: Path, overrides: Sequence[str], out: Path | str | None, only: Sequence[str]) -> Batch:
    """The frames of a look, a job each."""
    folder, looks = load_frames(path, overrides, out)
    names = [frame_name(number) for number in looks]
    for pattern in only:
        if not any(fnmatchcase(name, pattern) for name in names):
            raise InputError(f"--only {pattern}: expected one of {', '.join(names)}")
    jobs = [
        BatchJob(name, look, {}, not only or any(fnmatchcase(name, pattern) for pattern in only))
        for name, look in zip(names, looks.values(), strict=True)
    ]
    return Batch(path, folder, tuple(jobs))


def _look(located: Located, plan: PlannedJob, folder: Path, overrides: Sequence[str], out: Path | None) -> SceneSpec:
    """Look of one job: base, defaults, then the job's overrides from left to right."""
    defaults = part_of(located, ("defaults",)) if located.value.get("defaults") else Located({})
    own = [part_of(located, key) for key in plan.overrides if _value_at(located.value, key) is not None]
    for layer in own:
        if "output.dir" in layer.value or "dir" in (layer.value.get("output") or {}):
            place = layer.place(("output", "dir"))
            raise ConfigError([f"{place}: output.dir: expected in defaults only; each job has its own folder in it"])
    look, beside = Located({}, {(): located.place(())}), [folder]
    named = [layer for layer in (defaults, *own) if BASE in layer.value]
    if named:
        look, from_folder = _base(named[-1], folder)
        beside.append(from_folder)
    for layer in (defaults, *own):
        look = _with(look, layer)
    resolve_paths(look, folder)
    apply_overrides(look, overrides)
    if out is not None:
        put(look, "output.dir", str(out), "--out")
    output = look.value.get("output")
    if output is None or (isinstance(output, dict) and "dir" not in output):
        place = located.place(("defaults",))
        raise ConfigError([f"{place}: defaults.output.dir: missing; expected the folder of all jobs, or --out"])
    merge_preset(look, *beside)
    return parse_look(look)


def _with(look: Located, layer: Located) -> Located:
    """Look with a layer on top; a dotted key (`lights.key.intensity`) reaches into lists by index or by name."""
    plain = {key: value for key, value in layer.value.items() if "." not in key and key not in (BASE, "name")}
    look = lay_over(look, Located(plain, layer.places))
    for key, value in layer.value.items():
        if "." in key:
            put(look, key, value, layer.place((key,)))
    return look


def _base(layer: Located, folder: Path) -> tuple[Located, Path]:
    """Look file that `base` names, its paths made absolute, and the folder it lies in."""
    name, place = layer.value[BASE], f"{layer.place((BASE,))}: {BASE}"
    if not isinstance(name, str):
        raise ConfigError([f"{place}: expected the path of a look file, got {name!r}"])
    try:
        path = absolute_path(name, folder)
    except InputError as error:
        raise ConfigError([f"{place}: {error}"]) from error
    if not path.is_file():
        raise ConfigError([f"{place}: expected a look file, found none at {path}"])
    located = read_yaml(path)
    resolve_paths(located, path.absolute().parent)
    if isinstance(located.value.get("output"), dict):
        located.value["output"].pop("dir", None)  # the batch says where
    return located, path.absolute().parent


def _value_at(value: Any, key: tuple[str | int, ...]) -> Any:
    """Value below a key path."""
    for part in key:
        value = value[part]
    return value


def _in_jobs(names: list[str]) -> str:
    """Names of jobs in words, at most three."""
    shown = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
    return f"job {shown}" if len(names) == 1 else f"jobs {shown}"
