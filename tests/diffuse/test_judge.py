"""Sums of lobes are judged as the numbers at the probes say."""

import numpy as np
import pytest

from skinbake.diffuse.planning.judge import LUCK, Judge


def test_rms_and_peaks_of_numbers_worked_by_hand():
    """One probe of four is off by half of the mean, and stands for twice as much skin as the others."""
    want = np.full((4, 3), 2.0)
    weight = np.array([2.0, 2 / 3, 2 / 3, 2 / 3])
    error = np.zeros((4, 3))
    error[0, 1] = 1.0
    judge = Judge(want, weight, 100, peak=0.4)
    assert judge.rms(error) == pytest.approx(np.sqrt(2 / 4 / 12))
    assert judge.peaks(error) == pytest.approx(0.5)
    assert Judge(want, weight, 100, peak=0.6).peaks(error) == 0


def test_luck_is_the_spread_of_the_mean_square():
    """Two standard deviations of what that many probes measure, as drawing them again and again shows."""
    rng = np.random.default_rng(0)
    error = rng.standard_normal((4000, 3)) ** 3
    judge = Judge(np.ones((4000, 3)), np.ones(4000), 50)
    square = (error**2).sum(axis=1)
    drawn = square[rng.integers(0, 4000, (20_000, 50))].mean(axis=1)
    unlucky = judge.unlucky_rms(error) ** 2 * 3
    about_zero = np.sqrt(np.mean(drawn**2) - np.mean(drawn) ** 2 * (1 - 1 / 50))  # not about the mean: on the safe side
    assert unlucky == pytest.approx(square.mean() + LUCK * about_zero, rel=0.02)
    assert judge.unlucky_rms(error) > judge.rms(error)


def test_the_light_that_errors_are_worst_for_is_judged():
    """A lamp of a thousandth of the sky, off by a tenth; one that too few of the other probes will see is not."""
    want = np.full((400, 6), [1e3, 1e3, 1e3, 1, 1, 1])
    error = want * [0, 0, 0, 0.1, 0.1, 0.1]
    assert Judge(want, np.ones(400), 2000).rms(error) == pytest.approx(0.1)
    assert Judge(want, np.ones(400), 2000).unlucky_rms(error) > 0.1
    want[2:, 3:] = error[2:, 3:] = 0
    assert Judge(want, np.ones(400), 2000).rms(error) < 1e-3
    weight = np.full(400, 0.5)
    weight[:2] = 50  # of much more skin
    assert Judge(want, weight, 10_000).rms(error) == pytest.approx(0.1)


def test_darkness_is_right_and_light_in_it_infinitely_wrong():
    """Nothing is divided by zero, without probes either."""
    judge = Judge(np.zeros((3, 3)), np.ones(3), 10)
    assert judge.rms(np.zeros((3, 3))) == 0
    assert judge.rms(np.ones((3, 3))) == np.inf
    nobody = Judge(np.zeros((0, 3)), np.ones(0), 10)
    assert nobody.rms(np.zeros((0, 3))) == nobody.peaks(np.zeros((0, 3))) == 0
