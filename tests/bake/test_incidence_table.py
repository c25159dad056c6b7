"""The table of a medium is walked once for all looks."""

from __future__ import annotations

import numpy as np

from skinbake.baking import incidence_table as module
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.skin_medium import SkinMedium


def medium(eta):
    return SkinMedium((Layer(Medium(np.array([0.3, 1.0, 2.0]), np.ones(3)), np.inf, eta),))


def test_a_table_is_walked_once_a_medium(tmp_path, monkeypatch):
    """A later process reads it from the user's cache; another index is another medium; no cache, no harm."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("SKINBAKE_CACHE", raising=False)
    said = []

    def table(eta):
        monkeypatch.setattr(module, "_KNOWN", {})
        return module.incidence_table(medium(eta), said.append)

    first, again = table(1.0), table(1.0)
    assert len(said) == 1
    assert list((tmp_path / "skinbake" / "results").glob("??/*.npz"))
    for name, values in vars(first).items():
        np.testing.assert_array_equal(values, getattr(again, name))
    assert not np.allclose(table(1.2).diffuse_rgb, first.diffuse_rgb)
    assert len(said) == 2
    monkeypatch.setenv("XDG_CACHE_HOME", "no/absolute/path")
    np.testing.assert_array_equal(table(1.0).diffuse_rgb, first.diffuse_rgb)
    assert len(said) == 3
