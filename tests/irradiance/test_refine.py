"""Values traced on a lattice and interpolated stay within what was promised."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.irradiance.refine import refine


def run(field, wanted, tolerance, coarsest, normal=None):
    traced = []

    def trace(texels, stride):
        traced.extend(texels)
        return field.reshape(-1, field.shape[2])[texels].astype(np.float32)

    if normal is None:
        normal = np.zeros((*wanted.shape, 3), np.float32)
        normal[..., 2] = 1
    return refine(wanted, normal, field.shape[2], trace, tolerance, coarsest), np.array(traced)


@pytest.mark.parametrize("coarsest", [1, 4, 16])
@pytest.mark.parametrize("tolerance", [0.02, 0.1])
def test_a_smooth_field_is_met_within_the_tolerance_with_few_samples(coarsest, tolerance):
    """A slow wave over 97 x 131 texels: error below the tolerance, far fewer texels traced, none twice."""
    y, x = np.mgrid[:97, :131] / 160.0
    field = np.stack([np.sin(x) * np.cos(y), x / 4], -1)
    wanted = np.ones((97, 131), bool)
    values, traced = run(field, wanted, tolerance, coarsest)
    assert np.abs(values - field).max() <= tolerance
    assert len(traced) == len(set(traced))
    assert len(traced) < (97 * 131 if coarsest == 1 else 97 * 131 / 2) + 1


def test_an_edge_is_traced_to_the_texel():
    """A step between texels comes out exactly, with a number of samples that follows its length."""
    field = (np.add.outer(np.arange(120), 0.4 * np.arange(90)) > 80).astype(float)[..., None]
    values, traced = run(field, np.ones((120, 90), bool), 0.0, 8)
    np.testing.assert_array_equal(values, field)
    assert len(traced) < 0.3 * field.size


def test_only_what_is_wanted_is_traced():
    """Holes stay zero and are never asked for."""
    rng = np.random.default_rng(1)
    wanted = rng.random((50, 61)) > 0.4
    field = np.ones((50, 61, 1))
    values, traced = run(field, wanted, 0.1, 4)
    assert wanted.ravel()[traced].all()
    np.testing.assert_array_equal(values[..., 0], wanted)


def test_a_crease_between_lattice_points_is_found_by_its_normals():
    """A dark line one texel wide, which the lattice misses, is traced because its normals turn."""
    field = np.ones((64, 64, 1))
    field[:, 33] = 0
    normal = np.zeros((64, 64, 3), np.float32)
    normal[..., 2] = 1
    normal[:, 33] = [0.6, 0, 0.8]
    values, _ = run(field, np.ones((64, 64), bool), 0.05, 8, normal)
    np.testing.assert_array_equal(values, field)


def test_a_close_lattice_speaks_for_texels_beside_a_border():
    """On a disc of a gentle slope: fewer texels traced along its rim, and none off by more than two texels of slope."""
    y, x = np.mgrid[:100, :100] - 50.0
    wanted = np.hypot(x, y) < 40
    field = (0.01 * x)[..., None]
    found = {}
    for close in (0, 2):
        traced = []

        def trace(texels, stride, traced=traced):
            traced.extend(texels)
            return field.reshape(-1, 1)[texels].astype(np.float32)

        normal = np.tile(np.float32([0, 0, 1]), (100, 100, 1))
        values = refine(wanted, normal, 1, trace, 0.1, 8, close)
        assert np.abs(values - field)[wanted].max() <= 0.02 + 1e-6
        assert len(traced) == len(set(traced))
        found[close] = len(traced)
    assert found[2] < 0.75 * found[0]
