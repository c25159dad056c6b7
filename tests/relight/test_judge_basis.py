"""How a basis is judged, where the bake of a light has noise of its own."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.atlas import rasterize
from skinbake.relight.judge_basis import _error
from skinbake.relight.unseen_lights import unseen_lights
from tests.shapes import quad


@pytest.mark.parametrize("off", [0.0, 0.02])
def test_the_noise_of_a_sky_is_no_error_of_the_basis(off):
    """Two bakes with 3 % of noise each: a basis that is off by 2 % is said to be, one that is right is right."""
    mesh, rng = quad(), np.random.default_rng(2)
    atlas = rasterize(mesh, (64, 64), 2, False)
    exact = 1 + rng.random((64, 64, 3)).astype(np.float32)
    one, other = (exact * (1 + 0.03 * rng.standard_normal(exact.shape).astype(np.float32)) for _ in range(2))
    through = exact * (1 + off * rng.choice([-1, 1], exact.shape)).astype(np.float32)
    sky, sun = unseen_lights(0)[0], unseen_lights(0)[-1]
    found = _error(sky, {1001: (through, one, other)}, atlas, mesh)
    assert found.rms == pytest.approx(off, abs=0.004)
    assert _error(sun, {1001: (through, exact, exact)}, atlas, mesh).rms == pytest.approx(off, rel=1e-3)


def test_suns_are_baked_once():
    """Skies and soft boxes have a second draw of directions under another name, of the same radiance."""
    lights = unseen_lights(0)
    assert [light.drawn_again is None for light in lights] == [False] * 32 + [True] * 64
    again = lights[3].drawn_again
    assert again.radiance is lights[3].radiance
    assert again.light.name != lights[3].light.name
