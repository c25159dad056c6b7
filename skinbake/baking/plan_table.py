"""A bake's plan as one table: what was decided, how it is done, seconds that it took, error that it leaves."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import hypot, sqrt
from typing import NamedTuple

from skinbake.diffuse.diffuse_map import Lobe
from skinbake.diffuse.methods import IDENTITY
from skinbake.pipeline import Baked
from skinbake.scene.budget import FIT
from skinbake.scene.decision import Decision, uncounted_words

HEAD = ("what", "how", "seconds", "error")
_SIZES = {1: "full size", 2: "half size", 4: "a quarter of the size", 8: "an eighth of the size"}
_TERMS = ("incidence", "beam", "curvature", "interreflection", "diffuse_profile")


class Row(NamedTuple):
    """One line.

    Attributes
    ----------
    what, how : str
    seconds : float, optional
        None where nobody took the time, as of what was there already.
    error : float, optional
        Rms that this leaves wrong, as a share of the light; of a lobe, of that lobe alone.
    note : str
        Behind the error.
    """

    what: str
    how: str
    seconds: float | None = None
    error: float | None = None
    note: str = ""


def plan_rows(baked: Baked, parts: Mapping[str, float]) -> list[Row]:
    """The table of a bake.

    Parameters
    ----------
    baked : Baked
    parts : mapping of str to float
        Seconds of what stages say that they do (`StageLog.parts`).
    """
    plan, lights = {line.term: line for line in baked.plan}, baked.irradiance[0].lights
    rows = []
    if "texture_size" in plan:
        line = plan["texture_size"]
        rows.append(Row("texture size", line.how, None, line.error))
    oil = plan["energy_conservation"]
    rows.append(Row("oil", "takes its share" if oil.enabled else "left out", None, oil.error or None))
    for name in lights:
        own = [plan[term] for term in (f"{name}.harmonics", f"{name}.shadows") if term in plan]
        how = ", ".join(line.how for line in own if line.how)
        rows.append(Row(f"light {name}", how, _taken(parts, f"{name}, "), _root(line.error for line in own) or None))
    reuse = plan.get("relight.reuse")
    if reuse is not None:
        rows.append(Row("by relighting" if reuse.enabled else "not by relighting", reuse.why))
        if reuse.enabled:
            return rows
    rows.append(Row("entering skin", "", _taken(parts, "light that enters")))
    rows += [_term(plan, lights, term) for term in _TERMS]
    rows += [_lobe(i, lobe, baked, parts) for i, lobe in enumerate(baked.diffuse.lobes) if not lobe.transmitted]
    through = plan["transmission"]
    rows.append(Row("thin parts", _switched(through), _taken(parts, "light through"), through.error or None))
    measured, error = _taken(parts, "planning", "measuring"), baked.diffuse.error
    if error:
        how = f"method {_percent(error.method)}, storage {_percent(error.storage)}, {error.probes} probes"
        rows.append(Row("the blur", how, measured, error.rms, "planned and measured"))
    if FIT in plan:
        how = f"{plan[FIT].how}, {'the key is `skin.fit`' if plan[FIT].error else 'as the skin has them'}"
        rows.append(Row("fit", how, None, plan[FIT].error, "beside the sum"))
    if baked.left_wrong is not None:
        total = f"of {_percent(baked.decisions.budget.tolerance)}"
        but = ", and for the terms without directions" if uncounted_words(line.record() for line in baked.plan) else ""
        rows.append(Row("all", f"but fit and model (`skinbake truth`){but}", None, baked.left_wrong, total))
    return rows


def aligned(rows: Iterable[Row]) -> list[str]:
    """The table's lines, its head first."""
    texts = [
        (
            row.what,
            row.how,
            "" if row.seconds is None else f"{row.seconds:.2f}",
            "" if row.error is None else _percent(row.error),
            row.note,
        )
        for row in rows
    ]
    what, how, seconds, error = (max(len(text[k]) for text in [HEAD, *texts]) for k in range(4))
    return [
        f"{a:<{what}}  {b:<{how}}  {c:>{seconds}}  {d:>{error}}  {e}".rstrip()
        for a, b, c, d, e in [(*HEAD, ""), *texts]
    ]


def _term(plan: Mapping[str, Decision], lights: tuple[str, ...], term: str) -> Row:
    """A term that is decided light by light: for which lights it is computed."""
    lines = [(name, plan[f"{name}.{term}"]) for name in (*lights, "total") if f"{name}.{term}" in plan]
    if not lines and term in plan and plan[term].enabled:
        return Row(term, "on", None, plan[term].error or None)
    if not lines:
        return Row(term, "left out: " + plan[term].why.removeprefix("auto: ") if term in plan else "left out")
    on = [name for name, line in lines if line.enabled]
    off = [name for name, line in lines if not line.enabled]
    how = "on" if not off else "left out" if not on else f"on for {', '.join(on)}, left out for {', '.join(off)}"
    more = max((line.how for _, line in lines if line.enabled), default="", key=lambda how: (len(how), how))
    return Row(term, f"{how}, {more}" if more else how, None, max(line.error for _, line in lines) or None)


def _lobe(index: int, lobe: Lobe, baked: Baked, parts: Mapping[str, float]) -> Row:
    """How one Gaussian is blurred, and at which size."""
    full = next(iter(baked.irradiance[0].rgb)).shape[0]
    height = next(iter(lobe.rgb.values())).shape[1]
    how = _SIZES.get(round(full / height), f"size / {full / height:.0f}")
    how = "not blurred, too narrow to show" if lobe.method == IDENTITY.name else f"{lobe.method}, {how}"
    error = lobe.error.rms if lobe.error else None
    seconds = _taken(parts, f"lobe {index}: ", f"measuring lobe {index}")
    return Row(f"lobe {index}, {sqrt(lobe.variance_mm2):.2g} mm", how, seconds, error, "of this lobe")


def _switched(line: Decision) -> str:
    return "on" if line.enabled else "left out"


def _taken(parts: Mapping[str, float], *beginnings: str) -> float | None:
    """Seconds of the parts that begin with one of some words; lobes that are measured are the lobes' own."""
    found = [
        seconds
        for name, seconds in parts.items()
        if name.startswith(beginnings) and (not name.startswith("measuring lobe ") or beginnings[-1] == name)
    ]
    return sum(found) if found else None


def _root(errors: Iterable[float]) -> float:
    return hypot(*errors)


def _percent(share: float) -> str:
    return f"{share:.2%}"
