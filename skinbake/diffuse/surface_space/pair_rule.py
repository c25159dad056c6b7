"""Which pairs of surface points exchange light: the one rule of all 3-D methods and of the reference.

The surface integral weighs a pair by its straight distance, as if tissue lay between. Between the lips, the eyelids or
the walls of a nostril there is air: light would have to go around. The rule keeps a pair apart when both normals point
into the gap along the joining line, and face one another:

    n_i . (x_j - x_i) > 0,    n_j . (x_i - x_j) > 0,    n_i . n_j < 0.

A pair on the two sides of thin tissue (an ear, a nostril's wing) has normals that point away from one another along
the line: it is never kept apart, so light still passes. The rule is symmetric and depends on nothing but the pair.

It approximates a test of "does the joining line leave the tissue" by its two ends. It errs where a third part lies
between (three folds in a row), and at the bottom of a crease sharper than 90 degrees, whose two walls it parts although
they join: there too little light crosses. It falls off smoothly (below), so no line shows where it sets in.
"""

from __future__ import annotations

import numpy as np

from skinbake.kernels.compile import kernel

_ONE = np.float32(1)
_TWO = np.float32(2)
_THREE = np.float32(3)
_SIXTEEN = np.float32(16)
_ZERO = np.float32(0)


@kernel(inline=True)
def pair_weight(cos_normals, toward_i, toward_j, distance2):  # type: ignore[no-untyped-def]
    """Share of a pair's weight that stays, 0 ... 1.

    Parameters
    ----------
    cos_normals : float
        n_i . n_j; apart only below 0, fully from -1/2 (120 degrees) on.
    toward_i, toward_j : float
        n_i . (x_j - x_i) and n_j . (x_i - x_j), mm; fully apart where the product of both cosines reaches 1/16.
    distance2 : float
        |x_j - x_i|^2, mm^2, > 0.
    """
    facing = min(max(-_TWO * cos_normals, _ZERO), _ONE)
    across = min(_SIXTEEN * max(toward_i, _ZERO) * max(toward_j, _ZERO) / distance2, _ONE)
    apart = facing * facing * (_THREE - _TWO * facing) * across * across * (_THREE - _TWO * across)
    return _ONE - apart
