"""Rays where they are worth most."""

import numpy as np

from skinbake.diffuse.terms.ray_counts import FEWEST, MOST, ray_counts


def noise(area, seen, rays):
    """Squared, as theory.md 9.7 has it."""
    v = seen * (1 - seen)
    return float((area * v / rays * (1 + v * rays) ** -0.7).sum())


def test_the_noise_is_that_of_as_many_from_each_by_fewer_rays():
    """Large texels and mixed views send more; the sum of squares is what was asked for, to a doubling's worth."""
    rng = np.random.default_rng(3)
    area, seen = np.exp(rng.normal(0, 1.2, 4000)), 0.003 + 0.9 * rng.beta(0.3, 2.0, 4000)
    ones = np.ones(len(area))
    count = ray_counts(area, seen, ones, 128.0)
    assert 0.9 < noise(area, seen, count) / noise(area, seen, 128.0) <= 1.0
    assert count.sum() < 0.8 * 128 * len(area)
    assert set(count) <= set(2 ** np.arange(2, 11))
    more = ray_counts(np.where(np.arange(4000) == 7, 100 * area, area), seen, ones, 128.0)
    assert more[7] > count[7]
    # Nothing is gained by giving one texel's rays to another
    gain = area * (seen * (1 - seen))
    assert count[np.argsort(gain)[-400:]].mean() > 4 * count[np.argsort(gain)[:400]].mean()


def test_shared_rays_are_saved():
    """A mean that is worth four times a texel's own rays takes a quarter of them."""
    area, seen = np.ones(500), np.full(500, 0.3)
    assert (ray_counts(area, seen, np.ones(500), 128.0) == 128).all()
    assert (ray_counts(area, seen, np.full(500, 4.0), 128.0) == 32).all()


def test_there_are_limits():
    """No texel sends fewer than `FEWEST`, none more than `MOST`, and of none at all nothing comes."""
    area, seen = np.array([1e-9, 1.0, 1e9]), np.array([0.01, 0.5, 0.5])
    count = ray_counts(area, seen, np.ones(3), 300.0)
    assert count.min() >= FEWEST
    assert count.max() <= MOST
    assert len(ray_counts(np.zeros(0), np.zeros(0), np.zeros(0), 64.0)) == 0
