"""What texels see of the skin, of rays that were traced to look at the sky."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.diffuse.terms.bounced_light import bounced_light
from skinbake.diffuse.terms.skin_hits import TexturedSkin
from skinbake.diffuse.terms.skin_view import look_around
from skinbake.irradiance import sky_texels as sky_texels_module
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.scene_data import SceneData
from skinbake.irradiance.sky_texels import SkyTexels
from skinbake.relight import open_sky as open_sky_module
from skinbake.relight.open_sky import open_sky
from skinbake.relight.seen_skin import RAYS, seen_skin
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SceneSpec
from tests.shapes import joined, quad

SIZE = (120, 96)


@pytest.fixture(scope="module")
def corner():
    """Two squares that meet at a right angle, their scene, and what an atlas of half the size sees of the sky."""
    floor = quad(40.0, 40.0, columns=8, rows=8, uv_box=(0.02, 0.02, 0.48, 0.98))
    wall = quad(40.0, 40.0, columns=8, rows=8, uv_box=(0.52, 0.02, 0.98, 0.98))
    x, y, z = wall.positions_mm.T
    wall = SkinMesh(np.stack([z - 20, y, 20 + x], 1), wall.faces, wall.corner_uv, wall.corner_normal[..., [2, 1, 0]])
    scene = SceneData(joined(floor, wall), SkinMaps(), {})
    look = {
        "mesh": {"path": "corner.obj", "unit": "mm"},
        "skin": {"model": "gaussians", "variance_mm2": [1.0], "weight_rgb": [[1.0, 1.0, 1.0]]},
        "texture": {"size": SIZE, "gutter": 4},
        "lights": [],
        "relight": {},
        "output": {"dir": "out"},
    }
    looks = {shadows: SceneSpec.model_validate({**look, "shadows": shadows}) for shadows in (True, False)}
    found = {shadows: open_sky(look, scene, texels(scene)) for shadows, look in looks.items()}
    return scene, {**found, "look": looks[True]}


def texels(scene):
    """Those of an atlas of half the size."""
    return SkyTexels(scene.mesh, scene.occluder, (SIZE[0] // 2, SIZE[1] // 2))


def lit(scene, view):
    """Light that skin gets of skin that sends more at one end, over the small atlas, (h, w)."""
    sent = np.linspace(0.1, 1, SIZE[0], dtype=np.float32)[None, None, :, None] * np.ones((1, SIZE[1], 1, 3), np.float32)
    return bounced_light(view, [sent], [np.ones((1, 1, 3), np.float32)]).tiles[0][0, ..., 0]


def test_it_is_what_rays_of_its_own_see(corner):
    """Light from skin to skin is that of a thousand rays of each texel, as near as that of as many rays is."""
    scene, found = corner
    sky, skin = found[True], TexturedSkin(scene.mesh, scene.occluder, SIZE)
    reference = look_around(skin, 4, 1.6, 1024.0)
    assert reference.atlas[0].shape == sky.atlas[0].shape
    want = lit(scene, reference)
    alike = lit(scene, look_around(skin, 4, 1.6, float(RAYS)))
    got = lit(scene, seen_skin(sky, skin))
    assert np.linalg.norm(got - want) < 1.5 * np.linalg.norm(alike - want) < 0.1 * np.linalg.norm(want)
    assert got.sum() == pytest.approx(want.sum(), rel=0.01)


def test_only_what_is_not_open_is_traced_on(corner, monkeypatch):
    """No ray is traced to the open sky; where no ray told what is open, every one is, and meets the same skin."""
    scene, found = corner
    asked = []
    once = scene.occluder.first_hit
    monkeypatch.setattr(scene.occluder, "first_hit", lambda o, d: asked.append(len(o)) or once(o, d))
    skin = TexturedSkin(scene.mesh, scene.occluder, SIZE)
    few, every = (seen_skin(found[shadows], skin) for shadows in (True, False))
    assert asked[1] == RAYS * len(found[False].normal[1001])
    assert len(few.seen) <= asked[0] < 0.5 * asked[1]
    np.testing.assert_allclose(lit(scene, few), lit(scene, every), rtol=1e-5, atol=1e-6)


def test_texels_between_others_ask_what_these_do_not_agree_on(corner, monkeypatch):
    """Half of the rays and fewer are traced; a shadow's edge moves for few."""
    scene, found = corner
    asked, unhindered = [], Occluder.unhindered
    monkeypatch.setattr(
        Occluder, "unhindered", lambda self, *rays: asked.append(len(rays[0])) or unhindered(self, *rays)
    )
    shares, rays = [], []
    for apart in (1, 2):
        for module in (open_sky_module, sky_texels_module):
            monkeypatch.setattr(module, "lattice", lambda raster, apart=apart: apart)
        asked.clear()
        shares.append(open_sky(found["look"], scene, texels(scene)).share[1001])
        rays.append(sum(asked))
    assert 0 < rays[1] < 0.6 * rays[0]
    assert (shares[0] == 0).any()
    assert np.abs(shares[1].astype(int) - shares[0]).mean() < 0.002 * 255
