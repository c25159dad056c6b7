"""Light through flesh whose rays are weighed once is the light of rays that are weighed for each batch of lights."""

import numpy as np
import pytest

from skinbake.diffuse.diffuse_map import DiffuseMap, Lobe
from skinbake.diffuse.terms.even_share import hold_back
from skinbake.diffuse.terms.thin_parts import ThinParts
from skinbake.diffuse.terms.transmission import transmitted_lobe
from skinbake.relight.flesh_light import SIDE_BY_SIDE, FleshLight
from skinbake.scene.mesh import SkinMesh
from tests.diffuse.test_transmission import gaussians, slab_mesh, translucent

SIZE = (120, 60)


def blurred(lights, tiles, method):
    """Lobes of lights that vary by chance over the texture."""
    rng = np.random.default_rng(lights)
    light = {tile: rng.uniform(0, 2, (lights, *SIZE[::-1], 3)).astype(np.float32) for tile in tiles}
    profile = gaussians(energy=0.5)
    lobes = tuple(
        Lobe(float(v), tuple(w), method, {tile: image * np.float32(1 + k) for tile, image in light.items()})
        for k, (v, w) in enumerate(zip(profile.variance_mm2, profile.weight_rgb, strict=True))
    )
    return DiffuseMap(tuple(f"basis.{k}" for k in range(lights)), lobes, None)


@pytest.mark.parametrize("method", ["texture", "surface"])
@pytest.mark.parametrize("lights", [1, SIDE_BY_SIDE + 3])
def test_it_is_what_comes_through(lights, method):
    """Of any number of lights, and where the lobes carry light through the flesh themselves."""
    mesh, profile = slab_mesh(2.0), gaussians(energy=0.5)
    thin = ThinParts.of(translucent(mesh, profile, SIZE, scatter=0.9))
    first, later = blurred(1, (1001,), method), blurred(lights, (1001,), method)
    made = FleshLight(first, thin).lobe(later)
    asked = transmitted_lobe(later, thin)
    assert asked.rgb[1001].max() > 0.1
    np.testing.assert_allclose(made.rgb[1001], asked.rgb[1001], rtol=1e-5, atol=1e-6)
    assert (made.variance_mm2, made.weight_rgb) == (asked.variance_mm2, asked.weight_rgb)


def test_rays_come_out_on_another_tile():
    """One side of a slab lies on tile 1001, the other one on 1002."""
    slab, profile = slab_mesh(2.0), gaussians(energy=0.5)
    uv = slab.corner_uv.copy()
    uv[uv[..., 0].mean(axis=1) > 0.5, :, 0] += 0.5
    mesh = SkinMesh(slab.positions_mm, slab.faces, uv, slab.corner_normal)
    thin = ThinParts.of(translucent(mesh, profile, SIZE, udim=True))
    light = blurred(2, (1001, 1002), "texture")
    made, asked = FleshLight(light, thin).lobe(light), transmitted_lobe(light, thin)
    assert set(made.rgb) == {1001, 1002}
    for tile, image in asked.rgb.items():
        assert image.max() > 0.1
        np.testing.assert_allclose(made.rgb[tile], image, rtol=1e-5, atol=1e-6)


def test_what_is_held_back_of_a_texel_is_held_back_of_all_its_rays():
    """Some texels keep a part of one channel."""
    mesh, profile = slab_mesh(2.0), gaussians(energy=0.5)
    thin = ThinParts.of(translucent(mesh, profile, SIZE))
    light, (tile,) = blurred(3, (1001,), "texture"), thin.tiles
    kept = np.ones((1, len(tile.rows), 3), np.float32)
    kept[0, ::2, 1] = 0.25
    made = FleshLight(light, thin, [kept]).lobe(light)
    asked = transmitted_lobe(light, thin)
    hold_back(asked, thin, [kept])
    np.testing.assert_allclose(made.rgb[1001], asked.rgb[1001], rtol=1e-5, atol=1e-6)
    of_all = FleshLight(light, thin).lobe(light).rgb[1001]
    assert not np.allclose(of_all[..., 1], made.rgb[1001][..., 1])
