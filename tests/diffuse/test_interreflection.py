"""Skin that lights skin, against cavities and plates with known exchange."""

from dataclasses import replace

import numpy as np
import pytest

from skinbake.atlas import rasterize
from skinbake.diffuse.terms.bounced_light import add_at_full_size, bounced_light
from skinbake.diffuse.terms.interreflection import decide_interreflection, texels_by_area
from skinbake.diffuse.terms.skin_hits import TexturedSkin
from skinbake.diffuse.terms.skin_view import look_around
from skinbake.irradiance.occluder import Occluder
from skinbake.scene.mesh import SkinMesh
from tests.shapes import joined, quad, sphere

SIZE = (96, 96)


def cavity(radius_mm=40.0) -> SkinMesh:
    """A sphere seen from inside."""
    ball = sphere(radius_mm, "cube", 48)
    turn = [0, 2, 1]
    return SkinMesh(
        ball.positions_mm, np.ascontiguousarray(ball.faces[:, turn]), ball.corner_uv[:, turn],
        np.ascontiguousarray(-ball.corner_normal[:, turn]),
    )  # fmt: skip


def plates(side_mm=40.0, apart_mm=40.0) -> SkinMesh:
    """Two equal squares that face each other, side by side in the texture."""
    lower = quad(side_mm, side_mm, columns=4, rows=4, uv_box=(0.02, 0.02, 0.48, 0.98))
    upper = quad(side_mm, side_mm, columns=4, rows=4, uv_box=(0.52, 0.02, 0.98, 0.98))
    turn = [0, 2, 1]
    above = upper.positions_mm + np.array([0, 0, apart_mm])
    upper = SkinMesh(
        above, np.ascontiguousarray(upper.faces[:, turn]), upper.corner_uv[:, turn],
        -upper.corner_normal[:, turn],
    )  # fmt: skip
    return joined(lower, upper)


@pytest.mark.parametrize("bounces", [1, 2, 3])
def test_a_cavity_lights_itself_by_the_geometric_series(bounces):
    """Every ray in a closed cavity meets it: E sum_k rho^k, everywhere alike, light by light."""
    mesh = cavity()
    view = look_around(TexturedSkin(mesh, Occluder(mesh), SIZE), 4, 4.0, 16)
    rho = np.array([0.8, 0.5, 0.2], np.float32)
    sent = np.ones((2, *SIZE, 3), np.float32) * rho
    sent[1] *= 3
    got = bounced_light(view, [sent], [rho.reshape(1, 1, 3)], bounces).tiles[0]
    want = sum(rho.astype(float) ** k for k in range(1, bounces + 1))
    here = view.atlas[0].addressed
    assert here.any()
    np.testing.assert_allclose(got[0][here], np.broadcast_to(want, got[0][here].shape), rtol=2e-6)
    np.testing.assert_allclose(got[1], 3 * got[0], rtol=1e-6)


def test_bounces_go_on_until_the_rest_is_negligible():
    """A closed cavity's series is known: what is said to be left is the rest, and it is below what was asked for."""
    mesh = cavity()
    view = look_around(TexturedSkin(mesh, Occluder(mesh), SIZE), 4, 4.0, 16)
    for rho, negligible, bounces in ((0.5, 0.1, 5), (0.5, 0.3, 3), (0.2, 0.3, 1), (0.9, 0.001, 16)):
        grey = np.full((1, 1, 3), rho, np.float32)
        lit = bounced_light(view, [np.ones((1, *SIZE, 3), np.float32) * rho], [grey], 16, negligible)
        rest = rho**lit.bounces / (1 - rho)
        assert (lit.bounces, lit.left) == (bounces, pytest.approx(rest, rel=1e-4))
        assert rest <= negligible or bounces == 16


def test_lights_together_are_what_each_is_alone():
    """To the bit, whenever each stops and whatever of it counts; in a number that fills no whole vector."""
    mesh = cavity()
    view = look_around(TexturedSkin(mesh, Occluder(mesh), SIZE), 4, 4.0, 16)
    rng = np.random.default_rng(2)
    sent, gain = rng.random((7, *SIZE, 3), np.float32), rng.uniform(0.5, 1, (7, 3)).astype(np.float32)
    grey, most, enough = (
        [np.full((1, 1, 3), 0.6, np.float32)],
        [1, 2, 3, 16, 16, 16, 16],
        [0, 0, 0, 0.5, 0.2, 0.1, 0.05],
    )
    together = bounced_light(view, [sent], grey, most, enough, gain)
    assert len(set(together.bounces)) > 3
    for k in range(7):
        alone = bounced_light(view, [sent[k : k + 1]], [grey[0] * gain[k]], most[k], enough[k])
        assert (alone.bounces, alone.left, alone.noise) == (together.bounces[k], together.left[k], together.noise[k])
        np.testing.assert_array_equal(alone.tiles[0][0], together.tiles[0][k])
        unmeasured = bounced_light(view, [sent[k : k + 1]], [grey[0] * gain[k]], alone.bounces, measured=False)
        np.testing.assert_array_equal(alone.tiles[0], unmeasured.tiles[0])


def test_two_plates_exchange_what_their_form_factor_says():
    """Equal squares a side apart: F = 0.1998 [Howell]; the lit one sends, the dark one receives and nothing else."""
    mesh = plates()
    view = look_around(TexturedSkin(mesh, Occluder(mesh), SIZE), 4, 2.0, 256)
    sent = np.zeros((1, *SIZE, 3), np.float32)
    sent[:, :, : SIZE[0] // 2] = 1
    got = bounced_light(view, [sent], [np.ones((1, 1, 3), np.float32)]).tiles[0][0, ..., 0]
    raster = view.atlas[0]
    dark = np.arange(raster.shape[1]) >= raster.shape[1] // 2
    mean = (got * raster.area_mm2)[:, dark].sum() / raster.area_mm2[:, dark].sum()
    assert abs(mean - 0.1998) < 0.002
    assert got[:, ~dark].max() == 0


@pytest.mark.parametrize("with_neighbours", [False, True])
def test_what_is_said_of_the_noise_is_what_it_was(with_neighbours):
    """Two plates, one lit as by a lamp: against sixteen times as many rays; with neighbours fewer are sent."""
    mesh = plates()
    occluder = Occluder(mesh)
    sent = np.zeros((1, *SIZE, 3), np.float32)
    sent[:, :, : SIZE[0] // 2] = np.linspace(0.2, 1, SIZE[1])[:, None, None]
    grey = [np.full((1, 1, 3), 0.5, np.float32)]

    def lit(rays, means):
        view = look_around(TexturedSkin(mesh, occluder, SIZE), 4, 1.0, rays, means)
        return view, bounced_light(view, [sent], grey)

    view, found = lit(64, with_neighbours)
    _, wanted = lit(1024, False)
    area = view.atlas[0].area_mm2[..., None]
    wrong, of = (
        np.sqrt((area * image**2).sum()) for image in (found.tiles[0][0] - wanted.tiles[0][0], wanted.tiles[0][0])
    )
    assert 0.75 * wrong < found.noise * of < 2 * wrong
    assert (view.rays.mean() < 40) == with_neighbours


def test_light_that_few_rays_find_is_not_dotted():
    """A plate that sees the lit one as 1.9 % of its view, of which a texel's rays find one or none."""
    mesh = plates(40.0, 160.0)
    view = look_around(TexturedSkin(mesh, Occluder(mesh), SIZE), 4, 1.0, 32)
    sent = np.zeros((1, *SIZE, 3), np.float32)
    sent[:, :, : SIZE[0] // 2] = 1

    def spread_and_mean(view):
        got = bounced_light(view, [sent], [np.ones((1, 1, 3), np.float32)]).tiles[0][0, ..., 0]
        area = view.atlas[0].area_mm2
        dark = (np.arange(area.shape[1]) >= area.shape[1] // 2) & (area > 0)
        return got[dark].std() / got[dark].mean(), np.average(got[dark], weights=area[dark])

    (spread, mean), (of_each, wanted) = spread_and_mean(view), spread_and_mean(replace(view, skin=None))
    assert spread < 0.15 < 1 < of_each
    assert mean == pytest.approx(wanted, rel=0.01)


def test_skin_seen_from_behind_and_no_skin_bring_nothing():
    """Open squares that look the same way: no exchange, and no texel is kept."""
    mesh = joined(
        quad(40, 40, 0.0, uv_box=(0.02, 0.02, 0.48, 0.98)), quad(40, 40, 30.0, uv_box=(0.52, 0.02, 0.98, 0.98))
    )
    view = look_around(TexturedSkin(mesh, Occluder(mesh), SIZE), 4, 2.0, 32)
    assert len(view.seen) == 0
    got = bounced_light(view, [np.ones((1, *SIZE, 3), np.float32)], [np.ones((1, 1, 3), np.float32)]).tiles[0]
    assert not got.any()


def test_reading_at_the_full_size_keeps_a_plane():
    """Bilinear: a constant stays one, texels outside every chart stay 0."""
    mesh = plates()
    raster = rasterize(mesh, SIZE, 4)[0]
    found = np.zeros((*raster.shape, 3), np.float32)
    found[raster.addressed] = 1
    add_at_full_size(np.full((12, 12, 3), 0.25, np.float32), raster, found)
    assert (found[raster.addressed] == 1.25).all()
    assert not found[~raster.addressed].any()


def test_auto_asks_whether_it_is_worth_it():
    """A cavity is; a ball from outside is not, by its number; on and off are obeyed."""
    white = np.ones((1, 1, 3), np.float32)
    for mesh, kept in ((cavity(), True), (sphere(40.0, "cube", 48), False)):
        atlas = rasterize(mesh, SIZE, 4)
        skin = TexturedSkin(mesh, Occluder(mesh), SIZE)
        light = [np.stack([np.ones((*SIZE, 3)), np.zeros((*SIZE, 3))]).astype(np.float32)]

        def decide(switch, skin=skin, light=light, atlas=atlas):
            return decide_interreflection(skin, ("sun", "none"), light, [0.5 * white], atlas, switch, [0.01, 0.01])

        (sun, none), ((share, _), (nothing, noise)) = decide("auto")
        assert (share > 0.4, nothing, noise) == (kept, 0, 0)
        assert (sun.term, sun.enabled, none.enabled) == ("sun.interreflection", kept, False)
        assert ("50.00% of its light" in sun.why) == kept
        assert all(line.enabled for line in decide("on")[0])
        assert not any(line.enabled for line in decide("off")[0])


def test_bounces_below_one_are_refused():
    """None is said by switching the term off."""
    mesh = plates()
    view = look_around(TexturedSkin(mesh, Occluder(mesh), SIZE), 4, 8.0, 8)
    with pytest.raises(ValueError, match="bounces"):
        bounced_light(view, [np.ones((1, *SIZE, 3), np.float32)], [np.ones((1, 1, 3), np.float32)], 0)


@pytest.mark.parametrize("shape", [(1, 9), (31, 20), (70, 33)])
def test_texels_by_area_stand_for_as_much_each(shape):
    """Those that sums up to every texel give, none without area; of nothing there is nothing."""
    rng = np.random.default_rng(shape[0])
    area = (rng.uniform(0, 2, shape) * (rng.uniform(size=shape) < 0.7)).astype(np.float32)
    whole, flat = texels_by_area(area, 500)
    reached = np.cumsum(area.ravel(), dtype=np.float64)
    np.testing.assert_allclose(whole, reached[-1], rtol=1e-12)
    np.testing.assert_array_equal(flat, np.searchsorted(reached, (np.arange(500) + 0.5) / 500 * reached[-1]))
    assert (area.ravel()[flat] > 0).all()
    assert texels_by_area(np.zeros(shape, np.float32), 5)[0] == 0


def test_skin_that_the_whole_sky_sees_does_not_light_itself():
    """Rays start on the smooth surface, as those to lights do: of a facet whose normals lean a fortieth met itself."""
    flat = quad(40.0, 40.0, columns=4, rows=4)
    across = (flat.corner_position_mm - flat.positions_mm.mean(axis=0)) / 40.0
    lean = across * [1, 0, 0] + [0, 0, 1]
    leaning = lean / np.linalg.norm(lean, axis=-1, keepdims=True)
    mesh = SkinMesh(flat.positions_mm, flat.faces, flat.corner_uv, leaning)
    view = look_around(TexturedSkin(mesh, Occluder(mesh), SIZE), 4, 0.4, 256)
    assert len(view.tile) > 1000
    assert len(view.seen) < 0.005 * view.rays.sum()  # steep ones, below the facets' plane
