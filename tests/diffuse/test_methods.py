"""Every method keeps what planning and making rely on, and a new one needs nothing but its class and its line."""

import numpy as np
import pytest

from skinbake.atlas import rasterize
from skinbake.diffuse import diffuse, methods
from skinbake.diffuse.draw_probes import draw_probes
from skinbake.diffuse.methods import METHODS, DiffusionMethod, LobeParameters, method_asked_for
from skinbake.diffuse.on_demand import OnDemand
from skinbake.diffuse.probes import read_at_probes
from skinbake.diffuse.resources import Resource
from skinbake.errors import ConfigError, InputError
from skinbake.io.config import parse_scene
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.scene.spec import DiffusionSpec
from tests.diffuse.lobes import resources_of
from tests.shapes import joined, quad, relief, sphere

LOBES = [LobeParameters(0.3, 0, 0.8, 0.02), LobeParameters(40.0, 1, 0.8, 0.02)]


def lit(lights=2, tiles=1, size=(120, 90), **spec):
    """Stripes and their opposite on a sphere, over one tile or two."""
    mesh = sphere(25.0, "latlong", 48, tiles)
    atlas = rasterize(mesh, size, udim=tiles > 1)
    light = []
    for raster in atlas:
        stripes = np.indices(raster.shape)[1] // 9 % 2
        both = np.stack([stripes, 1 - stripes])[:lights]
        light.append((both[..., None] * np.array([1, 0.5, 2]) * raster.addressed[..., None]).astype(np.float32))
    return resources_of(light, atlas, mesh, **spec)


@pytest.fixture(params=METHODS.values(), ids=METHODS)
def method(request):
    """Each method of the registry."""
    return request.param


@pytest.mark.parametrize("lobe", LOBES)
def test_what_is_read_is_what_the_map_holds(method, lobe):
    """From the texels around the probes alone, on two tiles; the shapes are those that are promised."""
    resources = lit(tiles=2, tolerance=1e-7)  # sums that look far, for the little they add depends on their batch
    probes = draw_probes(resources.geometry, 200, 0)
    tiles = method.map(resources, lobe)
    level = lobe.level if method.blurs else 0
    for raster in resources.geometry.level_atlas(level):
        assert tiles[raster.tile].shape == (2, *raster.shape, 3)
        assert tiles[raster.tile].dtype == np.float32
    read = method.read_stored(resources, lobe, probes)
    assert read.shape == method.at_probes(resources, lobe, probes).shape == (200, 6)
    # The light is up to 2; a map's shares of sums have steps of 1 / 255
    np.testing.assert_allclose(read, read_at_probes(tiles, probes), atol=4e-3)
    assert np.abs(read - read_at_probes(tiles, probes)).mean() < 2e-4


@pytest.mark.parametrize("lobe", LOBES)
def test_a_light_does_not_see_the_others(method, lobe):
    """Its map is the same to the last bit, alone and together."""
    together = lit()
    alone = together.of_lights([1])
    np.testing.assert_array_equal(method.map(alone, lobe)[1001][0], method.map(together, lobe)[1001][1])


@pytest.mark.parametrize("lobe", LOBES)
def test_a_method_takes_only_what_it_says(method, lobe):
    """Resources that it does not ask for are not made."""
    resources = lit(1)

    def refuse():
        raise AssertionError("made without having been asked for")

    needs = method.needs(resources, lobe)
    for resource, name, refusing in (
        (Resource.TEXELS, "texels", refuse),
        (Resource.PYRAMIDS, "pyramids", OnDemand(refuse)),
    ):
        if resource not in needs:
            setattr(resources, name, refusing)
    method.map(resources, lobe)


def test_released_resources_are_made_again_the_same(method):
    """To the last bit."""
    resources = lit(1)
    first = method.map(resources, LOBES[0])[1001].copy()
    resources.release(Resource)
    np.testing.assert_array_equal(method.map(resources, LOBES[0])[1001], first)


def test_only_what_carries_light_through_flesh_says_so():
    """A sheet lit on one side: in texture space the other stays dark, where distance is measured in space it glows."""
    front, back = quad(40, 40, 0.0, uv_box=(0.02, 0.02, 0.48, 0.98)), quad(40, 40, 1.0, uv_box=(0.52, 0.02, 0.98, 0.98))
    mesh = joined(front, back)
    atlas = rasterize(mesh, (120, 60))
    light = np.zeros((1, 60, 120, 3), np.float32)
    light[:, :, :60] = 1
    for each in METHODS.values():
        resources = resources_of([light], atlas, mesh, separate=False)
        glow = each.map(resources, LobeParameters(4.0, 0, 0.8, 0.01))[1001][0, 30, 90, 0]
        assert (glow > 0.4) == each.through_flesh, each.name


class Doubled(DiffusionMethod):
    """Twice the light that arrives."""

    name = "doubled"
    bilinear_error = 0.0

    def map(self, resources, lobe):
        """At the full size."""
        return {tile: 2 * rgb for tile, rgb in resources.source.items()}

    def coarsest_level(self, size, level):
        """The full size alone."""
        return 0


def test_a_new_method_needs_its_line_alone(monkeypatch):
    """It can be asked for in a look, baked, measured, and is named in the plan."""
    monkeypatch.setitem(methods.METHODS, "doubled", Doubled())
    mesh = relief(12)
    atlas = rasterize(mesh, (40, 33))
    light = np.ones((1, 33, 40, 3), np.float32)
    skin = GaussianSum(np.array([50.0]), np.ones((1, 3)), np.zeros(3), np.ones(3))
    look = {
        "mesh": {"path": "x.obj", "unit": "mm"},
        "skin": {"model": "dipole", "sigma_a_per_mm": [0.1, 0.1, 0.1], "sigma_sp_per_mm": [1, 1, 1]},
        "lights": [{"name": "sun", "type": "directional", "direction": [0, 0, -1], "irradiance": [1, 1, 1]}],
        "diffusion": {"method": "doubled", "probes": 100},
        "output": {"dir": "out"},
    }
    spec = parse_scene(look, lambda key, text: f"{key}: {text}").diffusion
    baked = diffuse({1001: light}, ("sun",), atlas, mesh, skin, spec, 0, "float")
    assert baked.lobes[0].method == "doubled"
    np.testing.assert_array_equal(baked.lobes[0].rgb[1001], 2)
    assert baked.error.rms == pytest.approx(1, abs=1e-3)
    assert "doubled" in baked.plan[0].why


def test_a_method_of_another_size_than_planned_is_told(monkeypatch):
    """Else the plan would speak of texels that nobody has stored."""
    monkeypatch.setattr(Doubled, "coarsest_level", DiffusionMethod.coarsest_level)
    monkeypatch.setitem(methods.METHODS, "doubled", Doubled())
    mesh = relief(12)
    atlas = rasterize(mesh, (64, 64))
    skin = GaussianSum(np.array([400.0]), np.ones((1, 3)), np.zeros(3), np.ones(3))
    spec = DiffusionSpec(method="doubled", probes=0)
    with pytest.raises(ValueError, match=r"method doubled, tile 1001: expected a lobe of shape .* see coarsest_level"):
        diffuse({1001: np.ones((1, 64, 64, 3), np.float32)}, ("sun",), atlas, mesh, skin, spec, 0, "float")


def test_a_method_that_there_is_not_is_refused_with_those_there_are():
    """In a look with its key, and by the stage itself."""
    look = {"diffusion": {"method": "textur"}}
    with pytest.raises(ConfigError) as caught:
        parse_scene(look, lambda key, text: f"{'.'.join(map(str, key))}: {text}")
    (line,) = [fault for fault in caught.value.faults if "diffusion" in fault]
    assert line == (
        "diffusion.method: expected 'auto', 'texture', 'stretch', 'hybrid', 'surface' or 'reference', got 'textur'; "
        "did you mean texture?"
    )
    with pytest.raises(InputError, match="expected one of auto, texture, stretch, hybrid, surface, reference, got no"):
        method_asked_for("no")


def test_sums_that_are_not_normalised_need_a_method_that_knows_them():
    """Said in a look, and by the stage itself."""
    with pytest.raises(ConfigError) as caught:
        parse_scene({"diffusion": {"normalise": False}}, lambda key, text: f"{'.'.join(map(str, key))}: {text}")
    assert "diffusion: normalise: false needs method surface or reference, got auto" in caught.value.faults
    mesh = relief(12)
    atlas = rasterize(mesh, (20, 20))
    skin = GaussianSum(np.array([1.0]), np.ones((1, 3)), np.zeros(3), np.ones(3))
    spec = DiffusionSpec(method="texture", normalise=False)
    with pytest.raises(InputError, match="needs method surface or reference, got texture"):
        diffuse({1001: np.ones((1, 20, 20, 3), np.float32)}, ("sun",), atlas, mesh, skin, spec, 0)
