"""What the keys of the preview's window do outside of it: pictures beside the bake, and its look."""

from __future__ import annotations

from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinbake.baking.verdict import as_typed
from skinbake.baking.write_back import write_back
from skinbake.io.png import write_png
from skinbake.preview.window import WindowActions


def window_actions(folder: Path, look: Path | None) -> WindowActions:
    """Actions of a window on a bake.

    Parameters
    ----------
    folder : Path
        Where pictures go.
    look : Path, optional
        Where gains and view are written; without it, the window says how to name one.
    """
    return WindowActions(partial(save_snapshot, folder), None if look is None else partial(write_back, look))


def save_snapshot(folder: Path, pixels: NDArray[np.uint8]) -> str:
    """Write snapshot_0001.png, or the first number that is free; which, in words.

    Raises
    ------
    InputError, MachineError
        As `write_png`.
    """
    path = next(path for number in count(1) if not (path := folder / f"snapshot_{number:04d}.png").exists())
    write_png(path, pixels)
    return f"saved {as_typed(path)}"
