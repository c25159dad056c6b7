"""truth.png: a bake's distance from transport, by part of the skin and channel, and what each term takes off it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from skinbake.io.figures import png_figure
from skinbake.transport.model_error import GroupError, TermShare

# Grey values differ as well as hues
COLOURS = ("#b2182b", "#4dac26", "#2166ac")
DPI = 110


def write_truth_chart(
    path: Path, title: str, error: Mapping[str, GroupError], split: Mapping[str, Mapping[str, TermShare]]
) -> None:
    """Write the chart: bars with standard errors; on the right what each term takes off, and the rest.

    Parameters
    ----------
    path : Path
    title : str
    error : mapping of group to GroupError
    split : mapping of term to the share of each group
        The right panel is left out where there are none.

    Raises
    ------
    InputError, MachineError
        The file cannot be written.
    """
    with png_figure(path, DPI, figsize=(16 if split else 9, 5.5)) as figure:
        axes = figure.subplots(1, 2 if split else 1, squeeze=False)
        names = [f"{name}\n{found['points']} points" for name, found in error.items()]
        _bars(axes[0, 0], names, list(error.values()))
        axes[0, 0].set_title(title, parse_math=False)
        axes[0, 0].set_ylabel("distance from light transport, rms %")
        axes[0, 0].legend(loc="upper left")
        if split:
            shown = [name for name in ("all", "edges", "thin", "creases") if name in error]
            labels, bars = [], []
            for name in shown:
                for term, share in split.items():
                    labels.append(term)
                    bars.append(share[name])
                labels.append("rest")
                bars.append(error[name])
            _bars(axes[0, 1], labels, bars)
            axes[0, 1].tick_params(axis="x", rotation=90, labelsize=9)
            for k, name in enumerate(shown):  # a group is a term a column, and the rest
                columns = len(split) + 1
                middle, top = columns * k + (columns - 1) / 2, axes[0, 1].get_xaxis_transform()
                axes[0, 1].text(middle, 0.97, name, ha="center", va="top", transform=top)
                if k:
                    axes[0, 1].axvline(columns * k - 0.5, color="black", linewidth=0.8, alpha=0.4)
            axes[0, 1].axhline(0, color="black", linewidth=0.8)
            axes[0, 1].set_title("what each term takes off, and the rest")
        figure.tight_layout()


def _bars(axes, names: list[str], errors: Sequence[GroupError | TermShare]) -> None:  # type: ignore[no-untyped-def]
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
    axes.margins(y=0.12)
