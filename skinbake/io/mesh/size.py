"""Whether a mesh can be a head, and which unit would make it one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skinbake.errors import InputError
from skinbake.numerics import Float
from skinbake.scene.mesh_files import MM_PER_UNIT

HEAD_MM = (80.0, 1000.0)  # longest side of anything from a face mask to a bust
BODY_MM = (1000.0, 2600.0)  # of a whole body, standing or with its arms out
TYPICAL_HEAD_MM, TYPICAL_BODY_MM = 240.0, 1750.0
AS_IT_IS = "or mesh.any_size: true if this is no head"


def refuse_wrong_size(path: Path, positions_mm: Float, mm_per_unit: float, own_mm_per_unit: float | None) -> None:
    """Refuse what cannot be a head, and say which unit would make it one, or that it is a whole body.

    Parameters
    ----------
    path : path
        For messages.
    positions_mm : ndarray of shape (V, 3)
    mm_per_unit : float
        Of the look.
    own_mm_per_unit : float or None
        Where the file says it.

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
    measures = f"{path}: measures {size} mm, a head is about {TYPICAL_HEAD_MM:.0f}; "
    units = {name: longest / mm_per_unit * mm for name, mm in MM_PER_UNIT.items()}
    if BODY_MM[0] <= longest <= BODY_MM[1]:
        raise InputError(
            f"{measures}this is the size of a whole body{_named(mm_per_unit)}: set mesh.any_size: true to bake it as it"
            " is, and choose its skin by mesh.skin"
        )
    of_file = longest / mm_per_unit * own_mm_per_unit if own_mm_per_unit else 0.0
    if HEAD_MM[0] <= of_file <= BODY_MM[1]:
        body = " and mesh.any_size: true, it is a whole body" if of_file > HEAD_MM[1] else ""
        raise InputError(f"{measures}the file's own unit makes it {of_file:.0f}: set mesh.unit: file{body}, {AS_IT_IS}")
    likely = {name: size_mm for name, size_mm in units.items() if name != "inch"}
    if not any(HEAD_MM[0] <= size_mm <= HEAD_MM[1] for size_mm in likely.values()):
        likely = units
    best = min(likely, key=lambda name: abs(np.log(units[name] / TYPICAL_HEAD_MM)))
    if HEAD_MM[0] <= units[best] <= HEAD_MM[1]:
        fix = f"set mesh.unit: {best} ({units[best]:.0f} mm)"
    else:
        fix = f"set mesh.mm_per_unit: {TYPICAL_HEAD_MM / longest * mm_per_unit:.4g}"
    body = min(units, key=lambda name: abs(np.log(units[name] / TYPICAL_BODY_MM)))
    if BODY_MM[0] <= units[body] <= BODY_MM[1]:
        fix += f", or mesh.unit: {body} and mesh.any_size: true for a whole body ({units[body]:.0f} mm)"
    raise InputError(f"{measures}{fix}, {AS_IT_IS}")


def _named(mm_per_unit: float) -> str:
    """The unit in words, where it has a name."""
    words = {1.0: "millimetres", 10.0: "centimetres", 100.0: "decimetres", 1000.0: "metres", 25.4: "inches"}
    return f" in {words[mm_per_unit]}" if mm_per_unit in words else ""
