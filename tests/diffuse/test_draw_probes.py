"""Probes are a fair sample of the skin."""

import numpy as np
import pytest

from skinbake.atlas import rasterize
from skinbake.diffuse.draw_probes import PLAN, VERIFY, draw_probes
from skinbake.diffuse.skin_geometry import SkinGeometry
from tests.shapes import joined, quad


def test_probes_are_drawn_by_area():
    """A chart of nine tenths of the skin and half of the texture gets nine tenths of the probes."""
    mesh = joined(quad(90, 40, uv_box=(0, 0, 0.5, 1)), quad(10, 40, 5, uv_box=(0.5, 0, 1, 1)))
    atlas = rasterize(mesh, (64, 64))
    geometry = SkinGeometry(atlas, mesh)
    left = [(draw_probes(geometry, 4000, 0, stream).place[:, 1] < 0.5).mean() for stream in (VERIFY, PLAN)]
    assert left == pytest.approx([0.9, 0.9], abs=0.02)
    assert left[0] != left[1]
    preference = {1001: (geometry.points[1001].position[:, 0] > 0).astype(np.float32)}
    preferred = draw_probes(geometry, 4000, 0, PLAN, preference)
    weight = preferred.weight * (preferred.place[:, 1] < 0.5)
    assert weight.mean() == pytest.approx(0.9, abs=0.03)
