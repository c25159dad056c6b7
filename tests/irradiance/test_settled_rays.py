"""Rays that texels or directions around have settled: what all of them agree on, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.atlas import rasterize
from skinbake.irradiance import light_texels, settled_rays
from skinbake.irradiance.environment_share import open_shares
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.settled_rays import AROUND, FEWEST_FIRST, FirstDirections, SettledRays, no_answers
from skinbake.irradiance.sky_directions import all_around
from skinbake.scene.lights import EnvironmentLight
from skinbake.scene.maps import SkinMaps
from tests.extremes.moves import moved
from tests.shapes import joined, sphere

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


def test_directions_are_settled_by_the_first_ones_around():
    """Random answers of the first ones: those between are set where the nearest eight all say so, and nowhere else."""
    rng, directions = np.random.default_rng(7), all_around(2 * FEWEST_FIRST + 44)
    directions = rng.permutation(directions).astype(np.float32)
    first = FirstDirections(directions)
    assert first.count == FEWEST_FIRST
    bits = np.zeros((40, 2, len(directions)), np.bool_)
    state = rng.choice(3, (40, first.count), p=[0.85, 0.1, 0.05])
    state[1::2] = rng.choice(3, (20, first.count), p=[0.1, 0.85, 0.05])
    bits[:, 0, : first.count], bits[:, 1, : first.count] = state == 0, state == 1
    near = np.argsort(-(directions[first.count :] @ directions[: first.count].T), axis=1)[:, :AROUND]
    want = bits.copy()
    want[..., first.count :] = bits[..., near].all(axis=-1)
    answers = packed(bits)
    first.settle(answers)
    assert np.array_equal(answers, packed(want))
    assert want[:, 0, first.count :].any()
    assert want[:, 1, first.count :].any()


def test_few_directions_are_all_asked():
    """Where the first ones would be more than half, there are none."""
    assert FirstDirections(all_around(2 * FEWEST_FIRST - 1).astype(np.float32)).count == 0


@pytest.mark.parametrize("path", [False, True])
def test_a_sky_asks_fewer_rays_for_the_same_light(monkeypatch, path):
    """On a ball beside another, of an even sky and of one bright in places: as of all rays to a thousandth."""
    mesh, sky = sphere(20.0, "cube", 24), {"radiance": (1.0, 1.0, 1.0)}
    occluder = Occluder(joined(mesh, moved(mesh, np.eye(3), (42.0, 10.0, 0.0))))
    environments = {}
    if path:
        sky = {"path": "sky.exr"}
        environments["sky"] = np.random.default_rng(2).gamma(0.2, 1.0, (16, 32, 3)).astype(np.float32)
    light = EnvironmentLight(name="sky", type="environment", samples=512, **sky)
    asked, unhindered = list[int](), Occluder.unhindered

    def counted(self, origin, towards, reach):
        asked.append(len(origin))
        return unhindered(self, origin, towards, reach)

    monkeypatch.setattr(Occluder, "unhindered", counted)
    found = []
    for fewest in (FEWEST_FIRST, 10**9):
        monkeypatch.setattr(settled_rays, "FEWEST_FIRST", fewest)
        asked.clear()
        atlas = rasterize(mesh, (64, 64), gutter=2)
        (tile,) = light_texels(atlas, mesh, SkinMaps(), [light], environments=environments, occluder=occluder)
        found.append((tile.rgb[0], sum(asked)))
    (rgb, rays), (of_all, all_rays) = found
    assert rays < 0.9 * all_rays
    assert of_all[of_all > 0].min() < 0.9 * of_all.max()  # a shadow is there
    assert np.abs(rgb - of_all).max() < 1e-3 * of_all.max()
