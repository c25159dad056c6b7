"""Size gate: refuse what cannot be a head, and name the unit that would make it one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skinbake.errors import InputError
from skinbake.numerics import Float
from skinbake.scene.spec import MM_PER_UNIT

HEAD_MM = (80.0, 1000.0)  # longest side of anything from a face mask to a bust
TYPICAL_HEAD_MM = 240.0


def refuse_wrong_size(path: Path, positions_mm: Float, mm_per_unit: float) -> None:
    """Refuse what cannot be a head, and say which unit would make it one.

    Parameters
    ----------
    path : Path
        For the message.
    positions_mm : ndarray of shape (V, 3)
    mm_per_unit : float
        The unit by which they came to be millimetres.

    Raises
    ------
    InputError
        The longest side is not that of a head.
    """
    extent = np.ptp(positions_mm, axis=0)
    longest = float(extent.max())
    if HEAD_MM[0] <= longest <= HEAD_MM[1]:
        return
    size = " x ".join(f"{side:.4g}" for side in extent)
    if longest == 0:
        raise InputError(f"{path}: expected a head of about {TYPICAL_HEAD_MM:.0f} mm, got a single point")
    units = {name: longest / mm_per_unit * mm for name, mm in MM_PER_UNIT.items()}
    likely = {name: size_mm for name, size_mm in units.items() if name != "inch"}
    if not any(HEAD_MM[0] <= size_mm <= HEAD_MM[1] for size_mm in likely.values()):
        likely = units
    best = min(likely, key=lambda name: abs(np.log(units[name] / TYPICAL_HEAD_MM)))
    if HEAD_MM[0] <= units[best] <= HEAD_MM[1]:
        fix = f"set mesh.unit: {best} ({units[best]:.0f} mm)"
    else:
        fix = f"set mesh.mm_per_unit: {TYPICAL_HEAD_MM / longest * mm_per_unit:.4g}"
    raise InputError(
        f"{path}: measures {size} mm, a head is about {TYPICAL_HEAD_MM:.0f}; {fix}, "
        "or mesh.any_size: true if this is no head"
    )
