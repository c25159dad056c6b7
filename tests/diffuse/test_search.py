"""The search takes the cheapest candidates whose sum is right."""

import itertools

import numpy as np
import pytest

from skinbake.diffuse.methods import METHODS, LobeParameters
from skinbake.diffuse.planning.judge import Judge
from skinbake.diffuse.planning.search import Candidate, search


def lobes(rng, count, probes=400):
    """Exact lobes, and for each five candidates whose errors fall as their costs rise."""
    exact = [rng.uniform(0.5, 1.5, (probes, 3)) for _ in range(count)]
    options = []
    for want in exact:
        noise = rng.standard_normal((5, probes, 3))
        reads = [want + size * each for size, each in zip((0.3, 0.1, 0.03, 0.01, 0.0), noise, strict=True)]
        costs = np.sort(rng.uniform(1, 10, 5))
        options.append(
            [
                Candidate(METHODS["texture"], LobeParameters(1.0), float(cost), read, float(np.abs(read - want).mean()))
                for cost, read in zip(costs, reads, strict=True)
            ]
        )
    return exact, options


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("limit", [0.2, 0.03, 0.003])
def test_within_the_limit_and_near_the_cheapest_there_is(seed, limit):
    """Against all combinations of three lobes: never beyond the limit, at most a fifth dearer than the best."""
    rng = np.random.default_rng(seed)
    exact, options = lobes(rng, 3)
    weight = rng.uniform(0.1, 1, (3, 3))
    judge = Judge(sum(e * w for e, w in zip(exact, weight, strict=True)), np.ones(400), 2000, peak=1e9)

    def total(chosen):
        error = sum(options[i][k].read * weight[i] for i, k in enumerate(chosen)) - judge.want
        return judge.unlucky_rms(error), sum(options[i][k].cost for i, k in enumerate(chosen))

    error, cost = total(search(options, weight, judge, limit))
    allowed = [c for e, c in map(total, itertools.product(range(5), repeat=3)) if e <= limit]
    assert error <= limit
    assert cost <= 1.2 * min(allowed)


def test_a_thin_line_far_off_is_not_taken():
    """A candidate right on average, but a tenth of the mean off at one probe in a hundred, is passed over."""
    exact = np.ones((1000, 3))
    line = exact.copy()
    line[::100] += 0.5
    spread = exact * (1 + 0.05)
    judge = Judge(exact, np.ones(1000), 2000, peak=0.1)
    texture, lobe = METHODS["texture"], LobeParameters(1.0)
    options = [
        [
            Candidate(texture, lobe, 1.0, line, 0.05),
            Candidate(texture, lobe, 2.0, spread, 0.0499),
            Candidate(texture, lobe, 3.0, exact, 0.0),
        ]
    ]
    assert search(options, np.ones((1, 3)), judge, 0.1) == [1]
