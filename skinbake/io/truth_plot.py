"""truth.png: a bake's distance from transport, by part of the skin and channel, and what each term takes off it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from skinbake.io.figures import png_figure
from skinbake.transport.model_error import GroupError

# Grey values differ as well as hues
COLOURS = ("#b2182b", "#4dac26", "#2166ac")
DPI = 110


def write_truth_chart(
    path: Path, title: str, error: Mapping[str, GroupError], without: Mapping[str, Mapping[str, GroupError]]
) -> None:
    """Write the chart: bars with standard errors; on the right, the same of all skin with one term switched off.

    Parameters
    ----------
    path : Path
    title : str
    error : mapping of group to GroupError
    without : mapping of term to the errors of a bake without it
        The right panel is left out where there are none.

    Raises
    ------
    InputError, MachineError
        The file cannot be written.
    """
    with png_figure(path, DPI, figsize=(14 if without else 9, 5)) as figure:
        axes = figure.subplots(1, 2 if without else 1, squeeze=False, sharey=True)
        names = [f"{name}\n{found['points']} points" for name, found in error.items()]
        _bars(axes[0, 0], names, list(error.values()))
        axes[0, 0].set_title(title, parse_math=False)
        axes[0, 0].set_ylabel("distance from light transport, rms %")
        if without:
            bars = {"as it is": error["all"]} | {f"without\n{term}": found["all"] for term, found in without.items()}
            _bars(axes[0, 1], list(bars), list(bars.values()))
            axes[0, 1].set_title("all skin, one term switched off at a time")
        figure.tight_layout()


def _bars(axes, names: list[str], errors: list[GroupError]) -> None:  # type: ignore[no-untyped-def]
    """Draw three bars a name, R, G and B."""
    place = np.arange(len(names))
    for channel, colour in enumerate(COLOURS):
        height = [100 * found["rms_rgb"][channel] for found in errors]
        whisker = [100 * found["stderr_rgb"][channel] for found in errors]
        axes.bar(
            place + 0.27 * (channel - 1), height, 0.25, yerr=whisker, color=colour, capsize=2, label="RGB"[channel]
        )
    axes.set_xticks(place, names)
    axes.grid(axis="y", alpha=0.3)
    axes.legend()
