"""No gain: with every term on, no more light leaves closed bodies than arrives, in a white furnace and under a sun."""

import numpy as np
import pytest

import skinbake
from skinbake.atlas import rasterize
from skinbake.io.exr import Part, write_parts
from skinbake.io.mesh import write_obj
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SceneSpec
from tests.shapes import sphere

SIZE = (96, 64)
# What oil keeps off would hide as much gain: energy_conservation is off
TERMS = ("incidence", "beam", "curvature", "interreflection", "transmission", "diffuse_profile")
SKY = {"name": "furnace", "type": "environment", "radiance": [1, 1, 1]}
SUN = {"name": "sun", "type": "directional", "direction": [-0.7, -0.2, -0.6], "irradiance": [1, 1, 1]}
# The pale one absorbs a thousandth of what it scatters in red: all but 3 % come back of a plane, and any gain shows
MEDIA = {
    "skin": {"sigma_a_per_mm": [0.032, 0.17, 0.48], "sigma_sp_per_mm": [0.74, 0.88, 1.01]},
    "pale": {"sigma_a_per_mm": [0.001, 0.004, 0.016], "sigma_sp_per_mm": [1.0, 2.0, 4.0]},
}
TOLERANCE = (
    0.003  # of the bakes: at .01 the sky's directions and the rays to skin leave 1.3 % in single texels of a crease
)
GAIN_ANYWHERE = 0.005  # of what a furnace allows: what they leave at this tolerance, .2 %
GAIN_IN_ALL = 0.002  # of what a sun sends: of the blur's own estimate
SAME_BALL = 0.025  # by which a sun's total may differ from a furnace's: a ball of 4 mm 1.9 %, of 12 mm 0.02 %


def ball(radius_mm):
    """Convex."""
    return sphere(radius_mm, "cube", 48)


def creased(radius_mm):
    """Two balls as one body, 1.4 radii apart: a crease of 90 degrees all around, in which skin lights skin."""
    mesh, aside = sphere(1.0, "cube", 48), 0.7 * radius_mm
    along = np.abs(mesh.positions_mm[:, 0]) * aside  # to the centre of the ball that is further out
    positions = mesh.positions_mm * (along + np.sqrt(along**2 + radius_mm**2 - aside**2))[:, None]
    corner = positions[mesh.faces]
    centre = np.sign(corner[..., 0].mean(axis=1))[:, None, None] * [aside, 0, 0]
    return SkinMesh(positions, mesh.faces, mesh.corner_uv, (corner - centre) / radius_mm)


def baked(folder, mesh, medium, eta, light, more=None):
    """What leaves and what arrives at texels of the skin, (n, 3), their areas (n, 1), and the terms that are on."""
    write_obj(folder / "body.obj", mesh)
    look = {
        "mesh": {"path": str(folder / "body.obj"), "unit": "mm", "any_size": True},
        "skin": {"model": "dipole", "normalise": "none", "eta": eta, **MEDIA[medium]},
        "texture": {"size": list(SIZE), "gutter": 2}, "lights": [light],
        "terms": {"energy_conservation": "off"} | dict.fromkeys(TERMS, "on"),
        "diffusion": {"probes": 50}, "tolerance": TOLERANCE,
        "output": {"dir": str(folder / "out"), "precision": "float"},
    } | (more or {})  # fmt: skip
    found = skinbake.bake(SceneSpec.model_validate(look))
    (raster,) = rasterize(mesh, SIZE, 2)
    on = {line.term.split(".")[-1] for line in found.plan if line.enabled}
    where = raster.covered
    return found.radiant_exitance()[where], found.irradiance()[where], raster.area_mm2[where][:, None], on


@pytest.mark.parametrize("eta", [1.0, 1.4])
@pytest.mark.parametrize(
    ("body", "radius_mm", "medium"),
    [
        (ball, 12.0, "skin"),
        (creased, 12.0, "skin"),
        (ball, 40.0, "pale"),
        (creased, 40.0, "pale"),
        # About as small as light goes, 4 mm in skin, 18 in the pale medium
        (ball, 4.0, "skin"),
        (ball, 12.0, "pale"),
        (creased, 12.0, "pale"),
    ],
)
def test_closed_bodies_gain_nothing(tmp_path, body, radius_mm, medium, eta):
    """In a furnace of radiance 1 nowhere more than pi leaves, nor under a sun more for good than arrives.

    A ball looks the same to all suns, and a furnace is all of them: either has the same share sent back.
    """
    mesh = body(radius_mm)
    leaving, arriving, area_mm2, on = baked(tmp_path, mesh, medium, eta, SKY)
    assert {"incidence", "curvature", "interreflection", "transmission", "diffuse_profile"} <= on
    assert np.all(arriving <= np.pi * (1 + 1e-5))
    assert leaving.max() <= np.pi * (1 + GAIN_ANYWHERE)
    open_share = arriving / np.pi
    of_furnace = (area_mm2 * leaving).sum(axis=0) / (area_mm2 * arriving).sum(axis=0)
    leaving, arriving, area_mm2, on = baked(tmp_path, mesh, medium, eta, SUN)
    assert {"incidence", "beam", "curvature", "interreflection", "transmission"} <= on
    share = (area_mm2 * leaving * open_share).sum(axis=0) / (area_mm2 * arriving).sum(axis=0)
    assert np.all(share <= 1 + GAIN_IN_ALL), share
    if body is ball:
        np.testing.assert_allclose(share, of_furnace, rtol=SAME_BALL)


@pytest.mark.parametrize("albedo", [1.0, 0.8])
def test_paint_that_is_lighter_than_its_medium_does_not_shine(tmp_path, albedo):
    """A white profile lets through what its dark medium does, as a share of what that sends back: many times as much
    as paint leaves.
    """
    paint = tmp_path / "paint.exr"
    write_parts(paint, [Part("", {"RGB": np.full((4, 4, 3), albedo, np.float32)})], precision="float")
    more = {
        "skin": {"model": "dipole", "normalise": "white", **MEDIA["skin"]},
        "maps": {"albedo": {"path": str(paint)}},
    }
    leaving, _, _, on = baked(tmp_path, ball(3.0), "skin", 1.0, SKY, more)
    assert "transmission" in on
    assert leaving.max() <= np.pi * (1 + GAIN_ANYWHERE)
    assert leaving.max() >= np.pi * 0.99  # its room is used
