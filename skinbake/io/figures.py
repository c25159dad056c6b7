"""matplotlib without a window: PNGs that look the same whatever the environment and the user's own style say.

Names of lights, parts, files and looks are drawn with `parse_math=False`: a `$` in them is a `$`, not the begin of a
formula, which need not be one.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skinbake.io.atomic import atomic_write
from skinbake.io.output_names import SOFTWARE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BACKEND = "MPLBACKEND"


@contextmanager
def png_figure(path: Path | str, dpi: float, bbox_inches: str | None = None, **options: Any) -> Iterator[Figure]:
    """A figure to draw on, written to `path` when the block ends, and without a fault.

    Parameters
    ----------
    path : path
    dpi : float
        Pixels an inch.
    bbox_inches : str, optional
        "tight" cuts the margins off.
    options
        Of `matplotlib.figure.Figure`.

    Raises
    ------
    InputError, MachineError
        The file cannot be written.
    """
    with _no_backend():
        import matplotlib
        from matplotlib.figure import Figure
    with matplotlib.rc_context({"text.usetex": False}):
        figure = Figure(dpi=dpi, **options)
        yield figure
        with atomic_write(path) as temporary:
            figure.savefig(temporary, dpi=dpi, bbox_inches=bbox_inches, metadata={"Software": SOFTWARE})


@contextmanager
def _no_backend() -> Iterator[None]:
    """The environment without MPLBACKEND: matplotlib refuses to be imported with one that it does not know."""
    chosen = os.environ.pop(_BACKEND, None)
    try:
        yield
    finally:
        if chosen is not None:
            os.environ[_BACKEND] = chosen
