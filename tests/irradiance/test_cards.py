"""Rays meet what is not skin: all of it, or by chance where a picture lets some through."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pydantic import TypeAdapter

from skinbake.atlas import rasterize
from skinbake.irradiance.light_texels import light_texels
from skinbake.irradiance.occluder import Occluder
from skinbake.scene.casters import OPAQUE, Casters, joined_casters
from skinbake.scene.lights import LightSpec
from skinbake.scene.maps import SkinMaps
from tests.shapes import quad

FLAT = quad(100.0, 100.0)
SKIN = replace(FLAT, positions_mm=FLAT.positions_mm - FLAT.positions_mm.min(axis=0))
UP = np.array([[0, 0, 1]], np.float32)


def card(height_mm, opacity=None, repeat=1.0):
    """A square of the skin's size above it."""
    picture = () if opacity is None else (np.asarray(opacity, np.float32),)
    image = np.full(2, OPAQUE if opacity is None else 0, np.int32)
    lifted = SKIN.positions_mm + np.array([0, 0, height_mm])
    return Casters(lifted, SKIN.faces, SKIN.corner_uv * repeat, image, picture)


def origins(count=20000):
    points = np.random.default_rng(1).uniform(1, 99, (count, 2))
    return points, np.concatenate([points, np.ones((count, 1))], axis=1)


def met(casters, reach=np.inf, direction=UP, count=20000):
    occluder = Occluder(replace(SKIN, casters=joined_casters(casters)))
    points, rows = origins(count)
    start = (rows - occluder.centre_mm).astype(np.float32)
    return points, occluder.occluded(start, direction, np.full(count, reach, np.float32))


def test_an_opaque_caster_stops_every_ray_within_reach():
    """Above the skin all rays, none that ends below it, none downwards from above."""
    assert met([card(30.0)])[1].all()
    assert not met([card(30.0)], reach=20.0)[1].any()
    assert not met([])[1].any()


def test_a_picture_says_where_light_passes():
    """Black and white fields, row 0 at v = 1, repeated beyond the unit square."""
    fields = np.array([[1, 0, 0], [0, 0, 1]])
    points, stopped = met([card(30.0, fields)])
    row, col = (points[:, 1] < 50).astype(int), (points[:, 0] / 100 * 3).astype(int)
    np.testing.assert_array_equal(stopped, fields[row, col] == 1)
    points, stopped = met([card(30.0, fields, repeat=2.0)])
    place = points / 50 % 1
    row, col = (place[:, 1] < 0.5).astype(int), (place[:, 0] * 3).astype(int)
    assert (stopped == (fields[row, col] == 1)).mean() > 0.999  # float32 on a field's edge


@pytest.mark.parametrize("opacity", [0.1, 0.5, 0.93])
def test_half_opaque_cards_stop_their_share_layer_by_layer(opacity):
    """n layers of opacity a let (1 - a)^n pass, behind one another in any order, opaque ones beside them."""
    shares = [1 - met([card(10.0 * (k + 1), [[opacity]]) for k in range(layers)])[1].mean() for layers in (1, 2, 5)]
    wanted = [(1 - opacity) ** layers for layers in (1, 2, 5)]
    np.testing.assert_allclose(shares, wanted, atol=4 * np.sqrt(0.25 / 20000))


def test_chance_does_not_depend_on_what_is_asked_beside(monkeypatch):
    """Whole, in parts, with one direction for all or one each: the same answers."""
    casters = [card(20.0, [[0.5]]), card(40.0, [[0.3]])]
    whole = met(casters)[1]
    monkeypatch.setattr("skinbake.irradiance.occluder.BATCH", 777)
    np.testing.assert_array_equal(met(casters)[1], whole)
    np.testing.assert_array_equal(met(casters, direction=np.repeat(UP, 20000, axis=0))[1], whole)


def test_the_first_hit_is_skin_or_none():
    """A caster that is met first hides the skin behind it; cards with a picture do not."""
    start = np.array([[0, 0, 90.0]], np.float32)  # about the middle of the skin
    for casters, wanted in (([card(30.0)], [-1]), ([card(30.0, [[1.0]])], [0, 1]), ([], [0, 1])):
        occluder = Occluder(replace(SKIN, casters=joined_casters(casters)))
        triangle, *_ = occluder.first_hit(start, -UP)
        assert triangle[0] // 4**occluder.subdivided.levels in wanted


def test_joined_casters_keep_their_pictures():
    """Indices of faces and of pictures move along."""
    both = joined_casters([card(10.0, [[1.0]]), card(20.0), card(30.0, [[0.0]])])
    assert both.image.tolist() == [0, 0, OPAQUE, OPAQUE, 1, 1]
    assert both.positions_mm[both.faces].max(axis=1)[:, 2].tolist() == [10, 10, 20, 20, 30, 30]
    assert joined_casters([]) is None


def test_what_passes_cards_is_no_chance():
    """Every ray keeps (1 - a)(1 - b) behind two cards, nothing behind an opaque caster, all of it where none stands."""
    for casters, share in (
        ([card(20.0, [[0.5]]), card(40.0, [[0.3]])], 0.35),
        ([card(20.0, [[0.5]]), card(40.0)], 0.0),
        ([card(20.0, [[0.0]])], 1.0),
        ([card(10.0 * (k + 1), [[0.9]]) for k in range(4)], 0.0),  # less than anybody sees
    ):
        occluder = Occluder(replace(SKIN, casters=joined_casters(casters)))
        start = (origins(500)[1] - occluder.centre_mm).astype(np.float32)
        kept = occluder.unhindered(start, UP, np.full(500, np.inf, np.float32))
        np.testing.assert_allclose(kept, share, rtol=1e-5)
    assert Occluder(SKIN).unhindered(start, UP, np.full(500, np.inf, np.float32)).dtype == np.bool_


LIGHTS = {
    "directional": {"direction": [0, 0, -1], "irradiance": [1, 1, 1]},
    "rectangle": {
        "position_mm": [50, 50, 60],
        "edge_u_mm": [-20, 0, 0],
        "edge_v_mm": [0, 20, 0],
        "radiance": [1, 1, 1],
    },
    "environment": {"radiance": [1, 1, 1], "samples": 64},
}


@pytest.mark.parametrize("kind", LIGHTS)
def test_light_behind_a_half_transparent_card_is_smooth(kind):
    """Under one large enough for every ray to meet it, the unshadowed share is 1 - a at every texel, without noise."""
    wide = card(2.0, [[0.3]])
    wide = replace(wide, positions_mm=(wide.positions_mm - [50, 50, 0]) * [200, 200, 1] + [50, 50, 0])
    mesh = replace(SKIN, casters=wide)
    light = TypeAdapter(LightSpec).validate_python({"name": "k", "type": kind, **LIGHTS[kind]})
    (found,) = light_texels(rasterize(mesh, (32, 32), 1), mesh, SkinMaps(), [light])
    np.testing.assert_allclose(found.visibility[0][4:-4, 4:-4], 0.7, atol=2e-3)


def test_strands_two_texels_apart_are_not_missed():
    """Stripes that lie alike at every fourth texel, under a lamp so small that no penumbra gives them away."""
    stripes = np.array([[0, 1]])  # two texels clear, two dark
    mesh = replace(SKIN, casters=card(2.0, stripes, repeat=8.0))
    far = {"position_mm": [50, 50, 6000], "edge_u_mm": [-60, 0, 0], "edge_v_mm": [0, 60, 0], "radiance": [1, 1, 1]}
    light = TypeAdapter(LightSpec).validate_python({"name": "k", "type": "rectangle", "samples": 4, **far})
    (found,) = light_texels(rasterize(mesh, (32, 32), 1), mesh, SkinMaps(), [light])
    wanted = np.broadcast_to(np.tile([1, 1, 0, 0], 8), (32, 32))
    np.testing.assert_array_equal(found.visibility[0][2:-2, 2:-2], wanted[2:-2, 2:-2])


@pytest.mark.parametrize("kind", ["directional", "point"])
def test_strands_narrower_than_a_texel_shade_their_share(kind):
    """Four stripes a texel: half of the light arrives, though the middles of all texels see the same."""
    stripes = np.array([[1, 0]])
    mesh = replace(SKIN, casters=card(2.0, stripes, repeat=32.0))
    keys = {"direction": [0, 0, -1], "irradiance": [1, 1, 1]}
    if kind == "point":
        keys = {"position_mm": [50, 50, 1e5], "intensity": [1, 1, 1]}
    light = TypeAdapter(LightSpec).validate_python({"name": "k", "type": kind, **keys})
    (found,) = light_texels(rasterize(mesh, (16, 16), 1), mesh, SkinMaps(), [light])
    whole = np.eye(16)[::-1] == 0  # on the diagonal all rays of a texel start in one triangle, so unevenly
    np.testing.assert_allclose(found.visibility[0][whole], 0.5, atol=1e-6)
