"""Stored sizes and spacings take their share of the tolerance, and no more."""

import pytest

from skinbake.diffuse.planning.rules import MAX_SPACING, MIN_SPACING, cluster_spacing, stored_level


@pytest.mark.parametrize("variance", [0.01, 0.3, 4.0, 100.0])
@pytest.mark.parametrize("tolerance", [1e-4, 0.01, 0.3])
def test_a_lobe_is_stored_as_small_as_its_share_allows(variance, tolerance):
    """0.055 (h / sigma)^2 <= 0.6 of the tolerance at the level taken, not at the next; never beyond the coarsest."""
    level = stored_level(0.055, variance, 0.02, tolerance, 30)
    share = [0.055 * 0.02 * 4**k / variance / (0.6 * tolerance) for k in (level, level + 1)]
    assert level == 0 or share[0] <= 1
    assert share[1] > 1
    assert stored_level(0.055, variance, 0.02, tolerance, 2) == min(level, 2)


def test_clusters_grow_with_the_tolerance_between_two_limits():
    """0.002 spacing^2 is 0.4 of the tolerance."""
    assert cluster_spacing(1e-6) == MIN_SPACING
    assert cluster_spacing(1.0) == MAX_SPACING
    assert 0.002 * cluster_spacing(0.003) ** 2 == pytest.approx(0.4 * 0.003)
