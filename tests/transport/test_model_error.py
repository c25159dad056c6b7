"""A bake's distance from transport, with the walks' own noise taken off."""

import numpy as np
import pytest

from skinbake.transport.model_error import model_error, rms_words, term_share


def test_noise_is_not_the_bake_s_error():
    """A bake that is wrong by 5 % against a truth known to 10 %: 5 % are found, within the error that is told."""
    rng = np.random.default_rng(1)
    exact = 0.5 + rng.random((4000, 3))
    stderr = 0.1 * exact
    truth = exact + stderr * rng.standard_normal(exact.shape)
    baked = exact * [0.95, 1.05, 1.0]
    found = model_error(baked, truth, stderr, np.ones(4000), {})["all"]
    want = np.array([0.05, 0.05, 0.0])
    got, told = np.array(found["rms_rgb"]), np.array(found["stderr_rgb"])
    assert np.all(np.abs(got - want)[:2] < 3 * told[:2])
    assert np.all(told < 0.02)
    assert got[2] < 3 * told[2]
    np.testing.assert_allclose(found["bias_rgb"], [-0.05, 0.05, 0.0], atol=0.006)
    np.testing.assert_allclose(found["noise_rgb"], 0.1, rtol=0.03)


def test_a_distance_below_the_noise_is_not_called_none():
    assert rms_words(0.041, 0.003) == "4.1% +- 0.3%"
    assert rms_words(0.0, 0.02) == "below 2.0%, the noise of its walks"


def test_weights_and_groups_choose_the_points():
    """A point of weight 0 does not count; an empty group is left out."""
    truth = np.ones((3, 3))
    baked = np.array([[1.1], [1.2], [9.0]]) * truth
    groups = {"edges": np.array([False, True, False]), "thin": np.zeros(3, bool)}
    found = model_error(baked, truth, 0 * truth, np.array([1.0, 1.0, 0.0]), groups)
    assert set(found) == {"all", "edges"}
    np.testing.assert_allclose(found["all"]["rms_rgb"], np.sqrt((0.01 + 0.04) / 2))
    np.testing.assert_allclose(found["edges"]["rms_rgb"], 0.2)
    assert found["edges"]["points"] == 1


def test_light_that_is_not_there_gives_no_nan():
    """Black skin under no light: errors of 0, not 0 / 0."""
    found = model_error(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)), np.ones(2), {})["all"]
    assert found["rms_rgb"] == found["bias_rgb"] == found["stderr_rgb"] == [0.0, 0.0, 0.0]


def test_shapes_are_checked():
    """Different numbers of points, and none, are errors."""
    with pytest.raises(ValueError, match="shapes"):
        model_error(np.ones((2, 3)), np.ones((3, 3)), np.ones((3, 3)), np.ones(3), {})
    with pytest.raises(ValueError, match="empty"):
        model_error(np.ones((0, 3)), np.ones((0, 3)), np.ones((0, 3)), np.ones(0), {})


def test_a_term_takes_off_what_a_bake_without_it_is_further_away():
    """Exact without noise; with noise within the error that is told, which is less than that of each distance."""
    rng = np.random.default_rng(2)
    exact = 0.5 + rng.random((3000, 3))
    baked, without = exact * [1.02, 0.9, 1.0], exact * [0.9, 0.95, 1.0]
    groups = {"edges": np.arange(3000) < 1000}
    for noise in (0.0, 0.1):
        stderr = noise * exact
        truth = exact + stderr * rng.standard_normal(exact.shape)
        share = term_share(baked, without, truth, stderr, np.ones(3000), groups)
        for name in ("all", "edges"):
            got, told = np.array(share[name]["rms_rgb"]), np.array(share[name]["stderr_rgb"])
            assert np.all(np.abs(got - [0.08, -0.05, 0.0]) <= 3 * told + 1e-9)
            assert np.all(told < 0.02)
        assert noise == 0 or share["all"]["stderr_rgb"][0] > 0
