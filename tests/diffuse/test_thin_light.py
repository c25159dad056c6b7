"""Light through flesh that lights other skin: plates a side apart, one of which gets its light from behind."""

import numpy as np
import pytest

from skinbake.diffuse.diffuse_map import Lobe
from skinbake.diffuse.small_blur import SmallBlur
from skinbake.diffuse.terms.bounced_light import SkinLight
from skinbake.diffuse.terms.skin_hits import TexturedSkin
from skinbake.diffuse.terms.skin_view import look_around
from skinbake.diffuse.terms.thin_parts import ThinParts, TranslucentSkin
from skinbake.diffuse.thin_light import SmallLight, sent_on
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.scene_data import SceneData
from skinbake.profile import GaussianSum
from skinbake.profile.skin_medium import SkinMedium
from skinbake.scene.maps import SkinMaps
from skinbake.scene.spec import SceneSpec
from tests.diffuse.test_interreflection import SIZE, plates

ALBEDO = np.array([0.8, 0.5, 0.25])
WEIGHT = np.array([0.9, 0.6, 0.3])
FACING = 0.1998  # [Howell], of squares a side apart


def found(through, blurred, arrived, mode="pre-scatter"):
    """What `sent_on` makes of constants on the lower plate, and a mean over each plate."""
    mesh = plates()
    occluder = Occluder(mesh)
    spec = SceneSpec.model_validate(
        {
            "mesh": {"path": "m.obj", "unit": "mm"}, "texture": {"size": list(SIZE), "gutter": 4},
            "texturing": {"mode": mode},
            "skin": {"model": "burley", "mean_free_path_mm": 1, "albedo_rgb": 0.5}, "output": {"dir": "out"},
            "tolerance": 1e-4,
            "lights": [{"name": "sun", "type": "directional", "direction": [0, 0, 1], "irradiance": [1, 1, 1]}],
        }
    )  # fmt: skip
    gaussians = GaussianSum(np.ones(1), WEIGHT[None], np.zeros(3), WEIGHT)
    thin = ThinParts.of(TranslucentSkin(mesh, occluder, spec.texture, gaussians, ALBEDO, SkinMedium()))
    (tile,) = thin.tiles
    height, width = tile.raster.shape

    def lower(value):
        image = np.zeros((1, height, width, 3), np.float32)
        image[:, :, : width // 2] = value
        return image

    view = look_around(TexturedSkin(mesh, occluder, SIZE), 4, 2.0, 256)
    reflected = np.broadcast_to((ALBEDO * WEIGHT).astype(np.float32), (*view.atlas[0].shape, 3))
    light = SkinLight(view, [reflected], {"sun": np.ones(3, np.float32)}, {"sun": 1})
    lobe = Lobe(1.0, (1.0, 1.0, 1.0), None, {1001: lower(through)})
    lobes = (Lobe(1.0, tuple(WEIGHT), "surface", {1001: lower(blurred)}),)
    maps = SkinMaps(albedo_rgb=tuple(ALBEDO))
    scene = SceneData(mesh, maps, {})
    blur = SmallBlur(view.atlas, mesh, gaussians, maps, spec.diffusion, lobes)
    entered = SmallLight.of({1001: lower(arrived)}, thin)
    out = sent_on(lobe, lobes, entered, ("sun",), light, blur, spec, scene, gaussians).rgb[1001][0]
    area = np.where(tile.raster.covered, tile.raster.area_mm2, 0)[..., None]
    half = np.arange(width) < width // 2
    return [(out * area)[:, side].sum(axis=(0, 1)) / area[:, side].sum() for side in (half, ~half)]


@pytest.mark.parametrize("mode", ["pre-scatter", "post-scatter"])
def test_a_plate_lit_from_behind_lights_the_other_one(mode):
    """By the form factor and what leaves of it, as shown: times the albedo wherever that is multiplied."""
    shown = 1.0 if mode == "pre-scatter" else ALBEDO
    lower, upper = found(0.5, 0.0, 0.0, mode)
    np.testing.assert_allclose(lower, 0.5, rtol=1e-4)
    np.testing.assert_allclose(upper * shown, FACING * 0.5 * shown * ALBEDO * WEIGHT, rtol=0.03)


def test_what_leaves_where_it_arrived_is_sent_already():
    """Light whose blur is itself adds nothing; what a blur has taken away is not sent, and nothing falls below 0."""
    lower, upper = found(0.0, 0.7, 0.7)
    assert np.abs([lower, upper]).max() < 1e-6
    assert np.abs(found(0.0, 0.2, 0.7)).max() == 0
    _, upper = found(0.0, 0.7, 0.2)
    np.testing.assert_allclose(upper, FACING * 0.5 * WEIGHT * ALBEDO * WEIGHT, rtol=0.03)
