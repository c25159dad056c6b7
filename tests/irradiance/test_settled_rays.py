"""Rays that texels around have settled: what four of them agree on, and nothing else."""

from __future__ import annotations

import numpy as np

from skinbake.irradiance.environment_share import open_shares
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.settled_rays import SettledRays, no_answers
from tests.shapes import sphere

WIDTH, HEIGHT, DIRECTIONS = 23, 17, 150  # two words and a part of a third


def lattice(stride):
    rows, cols = np.mgrid[:HEIGHT:stride, :WIDTH:stride]
    return (rows * WIDTH + cols).ravel()


def packed(bits):
    """Answers of booleans (n, 2, directions)."""
    out = no_answers(len(bits), bits.shape[2])
    for s in range(bits.shape[2]):
        out[..., s // 64] |= bits[..., s].astype(np.int64) << np.int64(s % 64)
    return out


def all_up():
    normal = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    normal[..., 2] = 1
    return normal


def test_a_texel_has_what_the_four_around_have_in_common():
    """Random answers on a lattice of 4: those of the lattice of 2 are the bitwise and of the corners, 0 at the rim."""
    bits = np.random.default_rng(3).random((len(lattice(4)), 2, DIRECTIONS)) < 0.7
    rays = SettledRays(np.ones((HEIGHT, WIDTH), np.bool_), all_up(), 4, DIRECTIONS)
    assert not rays.of(lattice(4), 4).any()
    rays.keep(lattice(4), packed(bits))
    of = dict(zip(lattice(4), bits, strict=True))
    row, col = 6, 9  # asked for on the lattice of 1: its corners lie on that of 2 and were interpolated
    want = np.ones((2, DIRECTIONS), np.bool_)
    for r, c in ((4, 8), (4, 12), (8, 8), (8, 12)):
        want &= of[r * WIDTH + c]
    assert np.array_equal(rays.of(np.array([6 * WIDTH + 10]), 2), packed(want[None]))
    above, below = (of[r * WIDTH + 8] & of[r * WIDTH + 12] for r in (4, 8))
    assert np.array_equal(rays.of(np.array([row * WIDTH + col]), 1), packed((above & below)[None]))
    beyond = np.array([16 * WIDTH + 22])  # there is no lattice on two sides of it
    assert not rays.of(beyond, 2).any()


def test_texels_that_look_elsewhere_and_holes_settle_nothing():
    """One corner turned by 53 degrees, or left out, and its neighbours are traced in full."""
    bits = np.ones((len(lattice(4)), 2, DIRECTIONS), np.bool_)
    turned, wanted = all_up(), np.ones((HEIGHT, WIDTH), np.bool_)
    turned[4, 4] = (0.8, 0, 0.6)
    wanted[4, 4] = False
    for normal, here in ((turned, np.ones((HEIGHT, WIDTH), np.bool_)), (all_up(), wanted)):
        rays = SettledRays(here, normal, 4, DIRECTIONS)
        rays.keep(lattice(4), packed(bits))
        near, far = (rays.of(np.array([r * WIDTH + c]), 2) for r, c in ((6, 6), (10, 10)))
        assert not near.any()
        assert np.array_equal(far, packed(bits[:1]))


def test_settled_rays_are_not_traced_and_count_as_they_did():
    """Shares of points on a ball in a ball: the same with answers to be completed, and with those answers alone."""
    ball, rng = sphere(20.0, "cube", 12), np.random.default_rng(5)
    normal = rng.normal(size=(60, 3)).astype(np.float32)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    directions = rng.normal(size=(DIRECTIONS, 3)).astype(np.float32)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    weights = rng.random((DIRECTIONS, 3)).astype(np.float32)
    origin = (normal[::-1] * np.float32(21)).copy()  # outside, and turned any way: some rays meet the ball
    occluder, answers = Occluder(ball), no_answers(60, DIRECTIONS)
    plain = open_shares(origin, normal, directions, weights, occluder)
    found = open_shares(origin, normal, directions, weights, occluder, answers=answers)
    assert np.array_equal(plain, found)
    assert 0 < plain.min() + 1e-9 < plain.max() <= 1
    # Without an occluder every ray that is traced is open: none is
    assert np.array_equal(plain, open_shares(origin, normal, directions, weights, None, answers=answers))
