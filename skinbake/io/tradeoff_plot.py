"""tradeoff.png: error against seconds, log-log, with the Pareto front; markers differ in grey too."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skinbake.errors import printable
from skinbake.io.figures import png_figure
from skinbake.tradeoff import KNOB, LIMITS, WHOLE, Row, pareto_front

# Shape and grey value differ as well as hue
STYLES = {
    "look": ("*", "#000000"),
    "Gaussians": ("o", "#0072b2"),
    "method": ("s", "#d55e00"),
    "tolerance": ("^", "#009e73"),
    "size": ("D", "#cc79a7"),
    "storage": ("v", "#56b4e9"),
    "shadow samples": ("P", "#e69f00"),
    "together": ("X", "#444444"),
    "term": ("o", "#999999"),
    "model": ("s", "#555555"),
}

_NAME_POINTS = 7.5  # size of the names of points


def write_chart(path: Path, title: str, rows: Sequence[Row], clock: str) -> None:
    """Write the chart; the right panel shows what terms and models change, where they were measured.

    Parameters
    ----------
    path : Path
    title : str
    rows : sequence of Row
    clock : str
        Name of the clock for the axis' label.

    Raises
    ------
    InputError, MachineError
        As `atomic_write`.
    """
    bakes = [row for row in rows if row.reference in ("finest", WHOLE) and row.rms > 0]
    physics = [row for row in rows if row.reference not in ("finest", WHOLE) and row.rms > 0]
    with png_figure(path, 110, figsize=(14 if physics else 9, 6)) as figure:
        panels = 2 if physics else 1
        axes = figure.subplots(1, panels, squeeze=False, width_ratios=[3, 2] if physics else None)
        _front(axes[0, 0], bakes, clock)
        axes[0, 0].set_title(printable(title), parse_math=False)
        if physics:
            _bars(axes[0, 1], physics)
        figure.tight_layout()


def _front(axes: Any, rows: Sequence[Row], clock: str) -> None:
    """Left panel: every bake, and the Pareto front."""
    for sweep in dict.fromkeys(row.sweep for row in rows):
        marker, colour = STYLES.get(sweep, ("o", "#777777"))
        mine = [row for row in rows if row.sweep == sweep]
        knob = sweep == KNOB
        axes.plot(
            [row.seconds for row in mine], [row.rms for row in mine], marker, color=colour,
            label="tolerance, against every term" if knob else sweep, linestyle="-" if knob else "none", linewidth=2.0,
            markersize=13 if marker == "*" else 7, markeredgecolor="black", markeredgewidth=0.6, zorder=3,
        )  # fmt: skip
    for row in rows:
        if row.sweep == KNOB:
            axes.annotate(
                row.label, (row.seconds, row.rms), (0, 8), textcoords="offset points", ha="center", fontsize=8,
                fontweight="bold", color=STYLES[KNOB][1], zorder=5,
            )  # fmt: skip
    front = pareto_front([row for row in rows if row.sweep != KNOB])
    if front:
        axes.step(
            [r.seconds for r in front], [r.rms for r in front], "-", where="post", color="black", lw=1.2, zorder=2
        )
    for limit in LIMITS:
        axes.axhline(limit, color="0.8", lw=0.8, zorder=1)
        axes.annotate(
            f"{limit:.1%}", (0.0, limit), (3, 2), xycoords=("axes fraction", "data"), textcoords="offset points",
            ha="left", fontsize=7, color="0.4", annotation_clip=True,
        )  # fmt: skip
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(f"seconds of the whole bake, without preview ({clock})")
    axes.set_ylabel("rms error of the diffuse light at common points")
    _plain_ticks(axes, rows)
    _label(axes, front)
    axes.legend(fontsize=8, loc="upper right", framealpha=0.9)


def _plain_ticks(axes: Any, rows: Sequence[Row]) -> None:
    """Ticks in plain numbers, 1, 2, 5 steps: powers of ten say little about a range of ten."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 3, 4, 6, 8)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    _percent(axes.yaxis)
    if rows:
        seconds, error = [row.seconds for row in rows], [row.rms for row in rows]
        axes.set_xlim(min(seconds) / 2.2, max(seconds) * 1.9)
        axes.set_ylim(min(*error, LIMITS[-1]) / 1.5, max(error) * 1.6)


def _percent(axis: Any) -> None:
    """Ticks in per cent."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter(FuncFormatter(lambda x, _: f"{100 * x:g} %"))
    axis.set_minor_formatter(NullFormatter())


def _label(axes: Any, front: Sequence[Row]) -> None:
    """Name the front's points: below left of each, so that the line stays free; above right at the left edge.

    A name that would lie over one that stands already moves further off. The axes have their limits by now.
    """
    taken: list[tuple[float, float, float, float]] = []
    to_points = 72 / axes.figure.dpi
    for row in front:
        text = f"{row.sweep}: {row.label}" if row.sweep != "look" else row.label
        x, y = axes.transData.transform((row.seconds, row.rms)) * to_points
        side = 1 if row.seconds < 1.6 * front[0].seconds else -1
        dx, dy = (7.0, 8.0) if side > 0 else (-6.0, -6.0)
        width = _NAME_POINTS * (1 + 0.58 * len(text))
        while True:
            left, low = (x + dx, y + dy) if side > 0 else (x + dx - width, y + dy - _NAME_POINTS)
            box = (left, low, left + width, low + _NAME_POINTS)
            if not any(_overlap(box, other) for other in taken):
                break
            dy += side * 1.5 * _NAME_POINTS
        taken.append(box)
        axes.annotate(
            text, (row.seconds, row.rms), (dx, dy), textcoords="offset points", ha="left" if side > 0 else "right",
            va="bottom" if side > 0 else "top", fontsize=_NAME_POINTS, parse_math=False,
            arrowprops={"arrowstyle": "-", "lw": 0.5, "color": "0.5"}, zorder=4,
        )  # fmt: skip


def _overlap(one: tuple[float, float, float, float], other: tuple[float, float, float, float]) -> bool:
    """Whether two boxes (left, low, right, high) have a point in common."""
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def _bars(axes: Any, rows: Sequence[Row]) -> None:
    """Right panel: the error of each term left out and of each model, greatest first."""
    shown = sorted((row for row in rows if not row.label.endswith(" on")), key=lambda row: row.rms)
    places = np.arange(len(shown))
    colours = ["0.75" if row.sweep == "term" else "0.35" for row in shown]
    axes.barh(places, [row.rms for row in shown], color=colours, edgecolor="black", linewidth=0.5)
    axes.set_yticks(places, [row.label.replace(" off", " left out") for row in shown], fontsize=8)
    for place, row in zip(places, shown, strict=True):
        axes.annotate(f" {row.rms:.1%}", (row.rms, place), va="center", fontsize=8)
    axes.set_xscale("log")
    axes.set_xlim(min(row.rms for row in shown) / 2, 2.2 * max(row.rms for row in shown))
    _percent(axes.xaxis)
    axes.set_xlabel("rms against the term (light) or transport (dark)")
    axes.set_title("What is modelled")
