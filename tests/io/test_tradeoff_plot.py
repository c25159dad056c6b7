"""The chart of `tradeoff`: names that can be read."""

from __future__ import annotations

from itertools import combinations

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from skinbake.io.tradeoff_plot import _front
from skinbake.tradeoff import Row


def _row(sweep: str, label: str, seconds: float, rms: float) -> Row:
    return Row(f"{sweep}-{label}", sweep, label, "finest", (), rms, rms, rms, seconds, 500.0, 10**7, 0.01, 0.99, 1)


@pytest.mark.parametrize("dpi", [72, 200])
def test_names_of_points_side_by_side_do_not_lie_over_one_another(dpi):
    rows = [
        _row("shadow samples", "16", 7.8, 0.0107),
        _row("method", "texture", 12.5, 0.0098),
        _row("Gaussians", "2", 12.6, 0.0084),
        _row("Gaussians", "3", 12.7, 0.0083),
        _row("Gaussians", "4", 14.1, 0.003),
        _row("method", "surface", 14.9, 0.0007),
    ]
    figure = Figure((9, 6), dpi=dpi)
    axes = figure.subplots()
    _front(axes, rows, "processor seconds")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    names = [text for text in axes.texts if text.get_text().startswith(("method", "Gaussians"))]
    # Without the thin line that leads from a name to its point
    extents = [Text.get_window_extent(name, canvas.get_renderer()) for name in names]
    assert len(extents) == 5
    assert not any(one.overlaps(other) for one, other in combinations(extents, 2))
