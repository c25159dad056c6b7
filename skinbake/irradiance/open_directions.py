"""What points of the skin see of directions all around."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.environment_share import aim
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.settled_rays import Answers, has_bit, set_bit
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import for_slices

Image = NDArray[np.float32]
WHOLE = 255  # a share of 1
_RAYS = 1 << 16  # that a thread has in memory at a time


def open_directions(
    origin: Image, normal: Image, towards: Image, occluder: Occluder | None, answers: Answers
) -> NDArray[np.uint8]:
    """Share of light that arrives at n points from each direction, in parts of `WHOLE`, (n, D).

    Below the horizon of the smooth surface, where a mapped normal may still face, it is the point's mean.

    Parameters
    ----------
    origin, normal : ndarrays of shape (n, 3)
    towards : ndarray of shape (D, 3)
    occluder : Occluder, optional
        None: nothing is in the way.
    answers : ndarray of shape (n, 2, words), changed in place
        What is known; completed.
    """
    columns = np.ascontiguousarray(towards.T)
    share = np.empty((len(origin), len(towards)), np.uint8)

    def trace(part: slice) -> None:
        starts, rays = (np.empty((len(share[part]) * len(towards), 3), np.float32) for _ in range(2))
        count = aim(origin[part], normal[part], columns, answers[part], starts, rays)
        clear = np.ones(count, np.float32)
        if occluder is not None:
            reach = np.full(count, np.inf, np.float32)
            clear = occluder.unhindered(starts[:count], rays[:count], reach).astype(np.float32)
        _keep(clear, normal[part], columns, answers[part], share[part])

    for_slices(trace, len(origin), max(1, _RAYS // len(towards)))
    return share


@kernel
def _keep(clear: Image, normal: Image, columns: Image, answers: Answers, share: NDArray[np.uint8]) -> None:
    """Write the shares, by `aim`'s rays and what was known, and each texel's cosine-weighted mean below its horizon.

    Parameters
    ----------
    clear : ndarray of shape (rays,)
    normal : ndarray of shape (n, 3)
    columns : ndarray of shape (3, D)
    answers : ndarray of shape (n, 2, words)
        Completed; what a ray passes in part is neither open nor blocked.
    share : ndarray of shape (n, D)
        Written.
    """
    ray = 0
    for i in range(len(normal)):
        seen, whole = 0.0, 0.0
        for d in range(columns.shape[1]):
            cosine = normal[i, 0] * columns[0, d] + normal[i, 1] * columns[1, d] + normal[i, 2] * columns[2, d]
            if cosine > 0.0:
                if has_bit(answers[i, 0], d):
                    passed = np.float32(1)
                elif has_bit(answers[i, 1], d):
                    passed = np.float32(0)
                else:
                    passed = clear[ray]
                    ray += 1
                    if passed == 0.0 or passed == 1.0:
                        set_bit(answers[i, 0 if passed > 0.0 else 1], d)
                share[i, d] = np.uint8(255.0 * passed + 0.5)
                seen += cosine * passed
                whole += cosine
        mean = np.uint8(255.0 * seen / whole + 0.5) if whole > 0.0 else np.uint8(0)
        for d in range(columns.shape[1]):
            cosine = normal[i, 0] * columns[0, d] + normal[i, 1] * columns[1, d] + normal[i, 2] * columns[2, d]
            if not cosine > 0.0:
                share[i, d] = mean
