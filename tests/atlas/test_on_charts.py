"""Texels on charts, as a painting program takes them: by their centres."""

from __future__ import annotations

import numpy as np

from skinbake.atlas import on_charts
from tests.shapes import joined, quad, sphere


def test_a_rectangle_holds_the_centres_in_it():
    """u from .25 to .6, v from .5 to 1, at 20 x 10 texels: columns 5 to 11, rows 0 to 4; the second tile is empty."""
    mesh = quad(columns=3, rows=2, uv_box=(0.25, 0.5, 0.6, 1.0))
    expected = np.zeros((10, 20), bool)
    expected[:5, 5:12] = True
    np.testing.assert_array_equal(on_charts(mesh, 1001, (10, 20)), expected)
    assert not on_charts(mesh, 1002, (10, 20)).any()


def test_against_every_triangle_at_every_centre():
    """The charts of a sphere and a flipped quad on two tiles, by half planes, but for centres that lie on edges."""
    mesh = joined(sphere(20.0, "cube", 12), quad(uv_box=(1.9, 0.1, 1.2, 0.7)))
    height, width = 23, 37
    for tile in (1001, 1002):
        x, y = np.meshgrid((np.arange(width) + 0.5) / width + tile - 1001, 1 - (np.arange(height) + 0.5) / height)
        inside, near = np.zeros(x.shape, bool), np.zeros(x.shape, bool)
        for a, b, c in mesh.corner_uv:
            sides = np.stack(
                [(q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) for p, q in ((a, b), (b, c), (c, a))]
            )
            sides = sides * np.sign((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
            inside |= (sides >= 0).all(axis=0)
            near |= (np.abs(sides) < 1e-6).any(axis=0)
        found = on_charts(mesh, tile, (height, width))
        np.testing.assert_array_equal(found[~near], inside[~near])
        assert 0.1 < found.mean() < 1
