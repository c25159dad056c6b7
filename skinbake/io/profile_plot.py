"""The plot of a fit: r R(r) against r for each channel, and the residual below."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skinbake.io.figures import png_figure
from skinbake.numerics import gaussian_2d
from skinbake.profile import FitReport

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 150
NAMES = ("red", "green", "blue")
COLOURS = ("#b5352c", "#2c7a4b", "#2a5c9e")
INK, PALE, SHADE = "#1d1d1f", "#c9c9ce", "#efeff2"
# Fixed, in shares of the figure (gaps: of a mean axis): a layout engine would draw all labels once more to find them
PLACES = {"left": 0.087, "right": 0.996, "bottom": 0.087, "top": 0.9, "wspace": 0.037, "hspace": 0.085}
CROWDED = 8  # above it the Gaussians are named by sigma alone
LABELLED = 0.005  # Gaussians with a smaller share of their channel's light are drawn but not named


def write_fit_plot(path: Path | str, report: FitReport) -> None:
    """Write the plot as PNG: three columns, one a channel; model broad and pale, fit dashed, Gaussians thin and named.

    Line widths and dashes tell the curves apart, so that the plot can be read without colour.

    Raises
    ------
    InputError, MachineError
        The file cannot be written.
    """
    with png_figure(path, DPI, figsize=(12.6, 5.6), facecolor="white") as figure:
        _draw_fit(figure, report)


def _draw_fit(figure: Figure, report: FitReport) -> None:
    from matplotlib.patheffects import withStroke

    curve, gaussians = report.curve, report.gaussians
    r = curve.radius_mm
    axes = figure.subplots(2, 3, sharex=True, sharey="row", height_ratios=[3.2, 1], gridspec_kw=PLACES)
    peaks = (r[:, None] * curve.model_rgb).max(axis=0)
    residual = 100 * r[:, None] * (curve.fit_rgb - curve.model_rgb) / np.where(peaks > 0, peaks, 1)
    for c in range(3):
        top, below = axes[0, c], axes[1, c]
        for variance, weight in zip(gaussians.variance_mm2, gaussians.weight_rgb[:, c], strict=True):
            if variance == 0 or weight == 0:
                continue
            lobe = r * weight * gaussian_2d(variance, r)
            top.fill_between(r, lobe, color=COLOURS[c], alpha=0.10, linewidth=0)
            top.plot(r, lobe, color=COLOURS[c], linewidth=0.8)
            share = weight / gaussians.weight_rgb[:, c].sum()
            if abs(share) > LABELLED:
                # r G(v, r) peaks at sigma
                sigma = float(np.sqrt(variance))
                name = f"{sigma:.2g}\n{100 * share:.2g} %" if len(gaussians.variance_mm2) <= CROWDED else f"{sigma:.2g}"
                top.annotate(
                    name, (sigma, lobe[abs(lobe).argmax()]), (0, 4),
                    textcoords="offset points", ha="center", va="bottom", fontsize=7, linespacing=1.05,
                    color=COLOURS[c], zorder=5, path_effects=[withStroke(linewidth=2, foreground="white")],
                )  # fmt: skip
        top.plot(r, r * curve.model_rgb[:, c], color=PALE, linewidth=5.5, solid_capstyle="round", zorder=1)
        top.plot(r, r * curve.fit_rgb[:, c], color=INK, linewidth=1.4, dashes=(4, 2))
        below.axhline(0, color=PALE, linewidth=1)
        below.fill_between(r, residual[:, c], color=COLOURS[c], alpha=0.18, linewidth=0)
        below.plot(r, residual[:, c], color=COLOURS[c], linewidth=1)
        error, energy = 100 * report.relative_error_rgb[c], report.energy_rgb[c]
        top.set_title(
            f"{NAMES[c]}    reflects {energy:.3g},  fit error {error:.2g} %", loc="left", fontsize=10.5, color=INK
        )
        below.set_xlabel("r, mm")
        for ax in (top, below):
            _plain(ax)
            if report.profile.footprint_mm > r[0]:
                ax.axvspan(r[0], report.profile.footprint_mm, color=SHADE, linewidth=0, zorder=0)
    axes[0, 0].set_xscale("log")
    axes[0, 0].set_xlim(r[0], r[-1])
    for ax in axes.flat:
        _minor_ticks(ax, float(r[0]), float(r[-1]))
    axes[0, 0].set_ylim(bottom=min(0.0, axes[0, 0].get_ylim()[0]))
    unit = ", light of a channel = 1" if gaussians.normalise == "white" else ""
    axes[0, 0].set_ylabel(f"r R(r), 1/mm{unit}")
    axes[1, 0].set_ylabel("residual,\n% of peak")
    limit = max(1.15 * float(np.abs(residual[r >= report.profile.footprint_mm]).max(initial=0)), 1e-3)
    axes[1, 0].set_ylim(-limit, limit)
    _legend(figure, report)


def _legend(figure: Figure, report: FitReport) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    count = len(report.gaussians.variance_mm2)
    share = ", share of the light" if count <= CROWDED else ""
    handles = [
        Line2D([], [], color=PALE, linewidth=5.5, label=f"model: {report.gaussians.model}"),
        Line2D([], [], color=INK, linewidth=1.4, dashes=(4, 2), label="fit"),
        Patch(
            facecolor="#8a8a90", alpha=0.35, edgecolor="#55555a",
            label=f"its {count} Gaussian{'s' * (count > 1)}: sigma in mm{share}",
        ),
    ]  # fmt: skip
    if report.profile.footprint_mm > report.curve.radius_mm[0]:
        handles.append(Patch(facecolor=SHADE, label="finer than the fit looks"))
    figure.legend(handles=handles, loc="upper left", ncols=4, frameon=False, fontsize=9.5, borderaxespad=0.2)


def _minor_ticks(ax: Any, low: float, high: float) -> None:
    """Two to nine times the powers of ten, as one artist: matplotlib's own make three for each, a third of the work."""
    from matplotlib.markers import TICKDOWN
    from matplotlib.ticker import NullLocator

    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)))
    places = (decades[:, None] * np.arange(2, 10)).ravel()
    places = places[(places >= low) & (places <= high)]
    ax.xaxis.set_minor_locator(NullLocator())
    ax.plot(
        places, np.zeros(len(places)), linestyle="", marker=TICKDOWN, markersize=2, markeredgewidth=0.6, color=INK,
        transform=ax.get_xaxis_transform(), clip_on=False,
    )  # fmt: skip


def _plain(ax: Any) -> None:
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set_color("#8a8a90")
    ax.grid(True, axis="x", color="#ececef", linewidth=0.8)
    ax.set_axisbelow(True)
    ax.tick_params(labelsize=9, colors="#3a3a3d")
