"""Classical sums on oblong and sheared texels: constant light on a plane stays what it is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinbake.atlas import rasterize
from skinbake.diffuse.methods import METHODS, LobeParameters
from skinbake.diffuse.planning.rules import cluster_spacing
from skinbake.diffuse.surface_space.oblong import oblong_gain
from tests.diffuse.lobes import lobe_map, probes_of, resources_of
from tests.shapes import quad

SIGMA = (0.05, 0.2, 0.37, 0.6, 1.0, 1.7, 3.0, 10.0)  # mean texels
SPACING = cluster_spacing(0.01)


def plane(aspect, texels, shear=0.0):
    """A plane of texels of 1 mm^2, so many times as long along a row as along a column, in constant light."""
    width, height = texels
    mesh = quad(width * np.sqrt(aspect), height / np.sqrt(aspect))
    if shear:
        mesh.corner_position_mm  # noqa: B018  # made before its corners are moved
        position = mesh.positions_mm + mesh.positions_mm[:, 1:2] * [shear, 0, 0]
        mesh = replace(mesh, positions_mm=position)
    atlas = rasterize(mesh, texels, 2)
    return resources_of([np.ones((1, height, width, 3), np.float32)], atlas, mesh, normalise=False, tolerance=0.01)


def of_middle(probes):
    """Those far from the plane's borders."""
    inside = np.flatnonzero((np.abs(probes.place - 0.5) < 0.05).all(axis=1))[:12]
    names = ("tile", "flat_index", "place", "position", "normal", "texel_mm2")
    return type(probes)(*(getattr(probes, name)[inside] for name in names))


@pytest.mark.parametrize("method", ["surface", "reference"])
@pytest.mark.parametrize("aspect", [1.0, 1.25, 2.0, 4.0, 0.25])
def test_constant_light_stays_constant_on_oblong_texels(method, aspect):
    """To half a per cent, from a twentieth of a texel to ten; in the map as at probes."""
    long = max(aspect, 1 / aspect)
    resources = plane(aspect, (round(110 * long / aspect**0.5), round(110 * long * aspect**0.5)))
    probes = of_middle(probes_of(resources, 4000))
    assert len(probes) > 5
    for sigma in SIGMA:
        got = METHODS[method].at_probes(resources, LobeParameters(sigma**2, 0, SPACING), probes)
        np.testing.assert_allclose(got, 1, atol=0.005, err_msg=f"sigma {sigma}")


@pytest.mark.parametrize("method", ["surface", "reference"])
def test_map_and_reading_have_the_same_gain_as_probes(method):
    """Narrow lobes, aspect 3; without the gain they were 1.9 and 2.9 times too bright."""
    resources = plane(3.0, (37, 41))
    probes = of_middle(probes_of(resources, 4000))
    for sigma in (0.1, 0.37, 0.8):
        lobe = LobeParameters(sigma**2, 0, SPACING)
        np.testing.assert_allclose(lobe_map(resources, method, *lobe)[0, 20, 18], 1, atol=0.005)
        if method == "surface":
            np.testing.assert_allclose(METHODS[method].read_stored(resources, lobe, probes), 1, atol=0.005)


@pytest.mark.parametrize("shear", [0.3, 1.0, 2.5])
def test_constant_light_stays_constant_on_sheared_texels(shear):
    """Rhombs: the lattice is the same by its shortest steps."""
    resources = plane(1.0, (60, 61), shear)
    probes = of_middle(probes_of(resources, 4000))
    for sigma in (0.1, 0.37, 0.6, 1.0, 2.0):
        got = METHODS["reference"].at_probes(resources, LobeParameters(sigma**2), probes)
        np.testing.assert_allclose(got, 1, atol=0.005, err_msg=f"sigma {sigma}")


def test_square_texels_and_wide_lobes_have_no_gain():
    """So nothing changes where nothing was wrong."""
    assert np.abs(oblong_gain(quad(30, 30), (30, 30), 0.1) - 1).max() < 2e-3
    assert (oblong_gain(quad(30, 90), (30, 30), 40.0) == 1).all()
