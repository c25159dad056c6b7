"""How wrong light through a basis is, in words."""

import pytest

from skinbake.relight.light_error import KindError


@pytest.mark.parametrize(("tile", "where"), [(1001, "u 0.250 v 0.500)"), (1012, "u 0.250 v 0.500 of tile 1012)")])
def test_the_worst_place_is_told_with_its_tile(tile, where):
    """Where the skin has several."""
    error = KindError(16, 0.02, 0.06, 0.03, {"name": "sky-4"}, {"tile": tile, "uv": [0.25, 0.5]}, 0.0)
    assert f"worst 3.00% (sky-4, most at {where}, 0.00% below 0" in error.sentence("skies")
