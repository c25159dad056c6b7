"""Curvature of balls, hollows, plates and bumps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinbake.diffuse.terms.mean_curvature import mean_curvature
from tests.shapes import quad, sphere


@pytest.mark.parametrize("smoothing", [1.0, 3.0])
def test_a_ball_has_its_radius(smoothing):
    """1 / r at nearly every vertex of a ball of 20 mm; the smoothing takes its own share, s^2 / r^2."""
    mesh = sphere(20.0, "cube", 48)
    found = 20 * mean_curvature(mesh, [smoothing])[:, 0]
    assert np.median(found) == pytest.approx(
        1 / (1 + smoothing**2 / 400), rel=0.08
    )  # obtuse triangles count as right ones


def test_a_hollow_is_below_zero():
    """The same ball from inside."""
    mesh = sphere(20.0, "cube", 24)
    turned = replace(mesh, faces=mesh.faces[:, ::-1].copy(), corner_normal=-mesh.corner_normal[:, ::-1])
    np.testing.assert_allclose(mean_curvature(turned, [2.0]), -mean_curvature(mesh, [2.0]), rtol=1e-6)


def test_a_plate_has_none_and_bumps_below_the_smoothing_have_little():
    """A plane, and one with waves of 2 mm and .05 mm high: by how much the smoothing keeps them down."""
    plate = quad(40.0, 40.0, 0.0, columns=120, rows=120, uv_box=(0, 0, 1, 1))
    inside = np.abs(plate.positions_mm[:, :2] - plate.positions_mm[:, :2].mean(axis=0)).max(axis=1) < 15
    np.testing.assert_allclose(mean_curvature(plate, [2.0])[inside], 0, atol=1e-6)
    waves = plate.positions_mm.copy()
    waves[:, 2] += 0.05 * np.sin(np.pi * waves[:, 0])
    wavy = replace(plate, positions_mm=waves)
    sharp, smooth = (np.abs(mean_curvature(wavy, [s])[inside]).max() for s in (0.2, 4.0))
    assert sharp > 0.15  # half of .05 pi^2 and less
    assert smooth < 0.01


def test_triangles_of_very_unequal_sizes_are_smoothed_as_far():
    """A ball of rings that are narrow about its poles: the same curvature as between its even ones."""
    mesh = sphere(20.0, "latlong", 192)
    found = 20 * mean_curvature(mesh, [4.0])[:, 0]
    around = np.abs(mesh.positions_mm[:, 1]) < 19
    np.testing.assert_allclose(found[around], 1 / (1 + 16 / 400), rtol=0.1)
