"""Rays that need not be traced: those that all texels around, or all directions around, have found open or blocked.

Shadows of a sky have edges, and a texel is traced where one passes; but each edge is that of a few directions, and the
others are as they are all around. So of a hundred rays most are known before: in space from the texels around, and
in direction from those that each texel asks first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for

Image = NDArray[np.float32]
Index = NDArray[np.int64]
Answers = NDArray[np.int64]  # (n, 2, words): a bit a direction, of those that are open, and of those that are blocked
SAME_COSINE = 0.8  # 37 degrees: texels that look further apart than that know nothing of one another
FIRST, FEWEST_FIRST = 8, 128  # one direction in so many is asked first, but no fewer than that
AROUND = 8  # of them that settle one: at 0.003 that is wrong by a twentieth of what the directions themselves are
_BITS = 64


def no_answers(count: int, directions: int) -> Answers:
    """Answers of points of which none has been asked."""
    return np.zeros((count, 2, -(-directions // _BITS)), np.int64)


@kernel(inline=True)
def has_bit(words, s):  # type: ignore[no-untyped-def]
    """Whether the bit of direction s is set in some words."""
    return (words[s >> 6] >> np.int64(s & 63)) & 1 == 1


@kernel(inline=True)
def set_bit(words, s):  # type: ignore[no-untyped-def]
    """Set the bit of direction s."""
    words[s >> 6] |= np.int64(1) << np.int64(s & 63)


class SettledRays:
    """What texels of a lattice have found of a sky's directions, and what that says of texels between them.

    A direction is settled for a texel where all four texels around it on the lattice twice as wide agree on it, each as
    it was traced or is settled itself.

    Parameters
    ----------
    wanted : ndarray of shape (H, W)
        Texels that have answers; beside the others nothing is settled.
    normal : ndarray of shape (H, W, 3)
        Unit, smooth.
    coarsest : int
        Texels between the points of the first lattice, all of which are traced.
    directions : int
        How many.
    """

    def __init__(self, wanted: NDArray[np.bool_], normal: Image, coarsest: int, directions: int) -> None:
        self._wanted, self._normal, self._coarsest = wanted, normal.reshape(-1, 3), coarsest
        self._texels: Index = np.zeros(0, np.int64)  # ascending
        self._answers = no_answers(0, directions)
        self._directions = directions

    def of(self, texels: Index, stride: int) -> Answers:
        """What is settled for texels (row * W + col) of the lattice of a stride."""
        found = no_answers(len(texels), self._directions)
        if stride == self._coarsest:
            return found
        corners = self._corners(texels, 2 * stride)
        inside = np.flatnonzero((corners >= 0).all(axis=1))
        corners = corners[inside]
        # Those that were interpolated have answers of theirs, where they are asked for
        lacking = np.setdiff1d(corners, self._texels)
        if len(lacking):
            self.keep(lacking, self.of(lacking, 2 * stride))
        rows = np.searchsorted(self._texels, corners)
        ends = texels[inside], corners
        parallel_for(_agree, len(inside), ends, self._normal, (inside, rows), self._answers, found)
        return found

    def keep(self, texels: Index, answers: Answers) -> None:
        """Keep what was found at texels."""
        texels, answers = np.concatenate([self._texels, texels]), np.concatenate([self._answers, answers])
        order = np.argsort(texels)
        self._texels, self._answers = texels[order], answers[order]

    def _corners(self, texels: Index, wide: int) -> Index:
        """The four texels around each on the lattice of a stride, (n, 4); -1 where that is not wanted."""
        height, width = self._wanted.shape
        row, col = np.divmod(texels, width)
        r0, c0 = row - row % wide, col - col % wide
        r1, c1 = np.where(row % wide, r0 + wide, r0), np.where(col % wide, c0 + wide, c0)
        found = np.full((len(texels), 4), -1, np.int64)
        for k, (r, c) in enumerate(((r0, c0), (r0, c1), (r1, c0), (r1, c1))):
            there = np.flatnonzero((r < height) & (c < width))
            there = there[self._wanted[r[there], c[there]]]
            found[there, k] = r[there] * width + c[there]
        return found


class FirstDirections:
    """Those of a sky's directions that are asked first, and what they say of those between them.

    A direction is settled for a texel where the `AROUND` nearest of the first ones agree on it.

    Parameters
    ----------
    directions : ndarray of shape (s, 3)
        Unit vectors of a sequence that is spread as evenly wherever it stops.

    Attributes
    ----------
    count : int
        How many are asked first; 0 where there are too few for that.
    """

    def __init__(self, directions: Image) -> None:
        count = max(len(directions) // FIRST, FEWEST_FIRST)
        self.count = count if 2 * count <= len(directions) else 0
        if self.count:
            cosine = directions[count:] @ directions[:count].T
            self._around: Index = np.argpartition(cosine, -AROUND, axis=1)[:, -AROUND:].astype(np.int64)

    def settle(self, answers: Answers) -> None:
        """Add what the first ones' answers settle of the others.

        Parameters
        ----------
        answers : ndarray of shape (n, 2, words), changed in place
        """
        parallel_for(_settle_between, len(answers), self._around, self.count, answers)


@kernel
def _settle_between(first, stop, around, count, answers):  # type: ignore[no-untyped-def]
    """Set the bits of directions after the first `count` on which those around agree.

    Parameters
    ----------
    first, stop : int
    around : ndarray of shape (s - count, AROUND)
        Which of the first ones are near to each of the others.
    count : int
    answers : ndarray of shape (n, 2, words), changed in place
    """
    seen = np.empty(count, np.uint8)  # 1 open, 2 blocked, 0 below the horizon: a byte each is sooner read than a bit
    for n in range(first, stop):
        for s in range(count):
            seen[s] = np.uint8(has_bit(answers[n, 0], s)) | np.uint8(has_bit(answers[n, 1], s)) << np.uint8(1)
        for s in range(len(around)):
            alike = seen[around[s, 0]]
            for k in range(1, AROUND):
                alike &= seen[around[s, k]]
            if alike:
                set_bit(answers[n, alike - 1], count + s)


@kernel
def _agree(first, stop, ends, normal, rows, kept, out):  # type: ignore[no-untyped-def]
    """Answers that four texels have in common.

    Parameters
    ----------
    first, stop : int
    ends : tuple of ndarrays of shape (n,) and (n, 4)
        Texels, and those around.
    normal : ndarray of shape (H * W, 3)
    rows : tuple of ndarrays of shape (n,) and (n, 4)
        Rows of `out` that belong to the texels, and of `kept` to those around.
    kept, out : ndarrays of shape (..., 2, words)
        `out` is written.
    """
    texels, around = ends
    own, others = rows
    for n in range(first, stop):
        t, alike = texels[n], True
        for k in range(4):
            a = around[n, k]
            cosine = normal[t, 0] * normal[a, 0] + normal[t, 1] * normal[a, 1] + normal[t, 2] * normal[a, 2]
            alike = alike and cosine >= SAME_COSINE
        if not alike:
            continue
        for answer in range(2):
            for w in range(kept.shape[2]):
                both = kept[others[n, 0], answer, w] & kept[others[n, 1], answer, w]
                out[own[n], answer, w] = both & kept[others[n, 2], answer, w] & kept[others[n, 3], answer, w]
