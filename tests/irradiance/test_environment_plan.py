"""The plan of an environment keeps what it promises, and spends no more than that takes."""

from __future__ import annotations

import re

import numpy as np
import pytest

from skinbake.atlas import rasterize
from skinbake.irradiance import light_texels
from skinbake.irradiance.environment_plan import plan_environment
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.sky_points import SkyPoints
from skinbake.irradiance.sky_texels import sky_texels
from skinbake.scene.decision import Decision
from skinbake.scene.lights import EnvironmentLight
from skinbake.scene.maps import SkinMaps
from tests.shapes import joined, quad, relief, sphere

SIZE = (96, 64)


def sky(**more) -> EnvironmentLight:
    return EnvironmentLight(**({"name": "sky", "type": "environment", "radiance": (1.0, 0.7, 0.4)} | more))


def plan(mesh, light, tolerance=0.01, shadows=True, radiance=None):
    points = SkyPoints(sky_texels(mesh, Occluder(mesh), SIZE, 2, False), SIZE, tolerance)
    return plan_environment(light, radiance, points, shadows, tolerance, 0)


def light_one(mesh, light, **options):
    atlas = rasterize(mesh, SIZE, gutter=2)
    (result,) = light_texels(atlas, mesh, SkinMaps(), [light], **options)
    return atlas[0], result


def street(contrast: float):
    """A sky of low frequency with `contrast` of a sun in it."""
    rows, cols = np.mgrid[:32, :64]
    image = 1 + 0.5 * np.cos(np.pi * (rows + 0.5) / 32) + 0.2 * np.sin(2 * np.pi * (cols + 0.5) / 64)
    image[8, 20] += contrast
    return np.repeat(image[..., None], 3, axis=2).astype(np.float32)


def terms(found):
    return {line.term: line.enabled for line in found.lines}


def test_a_smooth_sky_takes_harmonics_and_a_sun_the_table():
    """Order 2 is taken while it is within a quarter of the tolerance, and the light it gives is within that."""
    mesh, light = sphere(60.0, "cube", 24), sky(radiance=None, path="street.exr")
    found = {c: plan(mesh, light, radiance=street(c)) for c in (0.0, 1.0, 3000.0)}
    assert [terms(f)["sky.harmonics"] for f in found.values()] == [True, True, False]
    assert found[0.0].matrix.size
    assert not found[0.0].table.size
    assert found[3000.0].table.size
    # A stricter tolerance takes the table where the wider one took the harmonics, and they differ by what was promised
    options = {"environments": {"sky": street(1.0)}, "shadows": False}
    _, exact = light_one(mesh, light, tolerance=1e-5, **options)
    _, harmonic = light_one(mesh, light, tolerance=0.01, **options)
    assert exact.plan["sky"][0].enabled is False
    assert harmonic.plan["sky"][0].enabled is True
    error = np.linalg.norm(harmonic.rgb - exact.rgb) / np.linalg.norm(exact.rgb)
    assert 0 < error < 0.0025


def test_a_convex_body_needs_no_shadow_rays():
    """A sphere shades itself nowhere: shadows are left out with the number that says so, and E stays pi."""
    mesh = sphere(60.0, "cube", 24)
    found = plan(mesh, sky())
    assert terms(found) == {"sky.harmonics": True, "sky.shadows": False}
    assert found.samples == 0
    assert "0.00% rms" in found.lines[1].why
    raster, result = light_one(mesh, sky())
    expected = np.where(raster.addressed[..., None], np.pi * np.float32([1, 0.7, 0.4]), 0)
    np.testing.assert_allclose(result.rgb[0], expected, rtol=1e-5)
    assert (result.visibility[0][raster.addressed] == 1).all()


def test_who_asks_for_shadows_gets_them():
    """`samples` and the light's own `shadows: true` are not overruled; `shadows: false` has no line."""
    mesh = sphere(60.0, "cube", 24)
    assert plan(mesh, sky(samples=37)).samples == 37
    assert plan(mesh, sky(shadows=True)).samples > 0
    assert plan(mesh, sky(shadows=False)).samples == 0
    assert terms(plan(mesh, sky(shadows=False))) == {"sky.harmonics": True}
    assert terms(plan(mesh, sky(), shadows=False)) == {"sky.harmonics": True}


def test_a_small_blocker_is_left_out_only_while_it_is_small():
    """A lid of 3 % of the skin above a plate is kept; one that shades a part in ten thousand is not."""
    plate = quad(200.0, 200.0, uv_box=(0, 0, 0.9, 1))
    large = joined(plate, quad(40.0, 40.0, z_mm=15.0, uv_box=(0.92, 0, 1, 1)))
    small = joined(plate, quad(1.0, 1.0, z_mm=0.3, uv_box=(0.92, 0, 1, 1)))
    assert plan(large, sky()).samples > 0
    assert plan(small, sky()).samples == 0


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [0.03, 0.01, 0.004])
def test_shadowed_light_is_within_the_tolerance(tolerance):
    """Rms error of the light on a lid over a plate, against 4096 directions everywhere, is within what was asked."""
    mesh = joined(relief(), quad(25.0, 25.0, z_mm=30.0, uv_box=(0.97, 0, 1, 0.03)))
    raster, ours = light_one(mesh, sky(), tolerance=tolerance)
    _, exact = light_one(mesh, sky(samples=4096), tolerance=1e-6)
    weight = np.sqrt(raster.area_mm2[..., None])
    error = np.linalg.norm((ours.rgb[0] - exact.rgb[0]) * weight) / np.linalg.norm(exact.rgb[0] * weight)
    assert error < tolerance
    line = ours.plan["sky"][1]
    assert line.enabled
    assert "directions" in line.why


def test_finer_tolerances_ask_for_more_directions():
    """Each step to a finer tolerance takes at least as many, from few to many, and never above the most."""
    mesh = joined(quad(200.0, 200.0, uv_box=(0, 0, 0.9, 1)), quad(90.0, 90.0, z_mm=25.0, uv_box=(0.92, 0, 1, 1)))
    counts = [plan(mesh, sky(), tolerance).samples for tolerance in (0.1, 0.03, 0.01, 0.003, 1e-5)]
    assert counts == sorted(counts)
    assert counts[0] < counts[2] < counts[3]
    assert counts[-1] == 4096
    assert "the most there are" in plan(mesh, sky(), 1e-5).lines[1].why


@pytest.mark.parametrize("tolerance", [0.03, 0.02, 0.013, 0.01, 0.007, 0.005, 0.004])
def test_a_fifth_fewer_directions_would_be_too_few(tolerance):
    """The number of directions is found to an eighth of a power of two: the next fewer, as told, are too few."""
    mesh = joined(relief(), quad(25.0, 25.0, z_mm=30.0, uv_box=(0.97, 0, 1, 0.03)))
    found = plan(mesh, sky(), tolerance)
    told = re.search(
        r"(\d+) directions are off by ([\d.]+)% \((\d+) by ([\d.]+)%\), within ([\d.]+)%", found.lines[1].why
    )
    assert told
    enough, error, fewer, of_fewer, limit = map(float, told.groups())
    assert enough == found.samples > 16
    assert 0.8 * enough <= fewer < enough
    assert error <= limit
    assert of_fewer > 0.9 * limit - 0.005  # room is left for others


def test_a_black_sky_is_black():
    """Nothing to measure, nothing to trace, nothing that is not finite."""
    _, result = light_one(quad(), sky(radiance=(0, 0, 0)))
    assert (result.rgb == 0).all()
    assert not result.plan["sky"][1].enabled


LOOK = """
mesh: {{path: {mesh}, unit: mm, any_size: true}}
texture: {{size: [48, 40], gutter: 2}}
skin: {{model: gaussians, variance_mm2: [0.5], weight_rgb: [[1, 1, 1]]}}
lights:
  - {{name: sky, type: environment, radiance: [1, 1, 1]}}
  - {{name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}}
diffusion: {{probes: 50, tolerance: 0.05}}
output: {{dir: out}}
"""


def test_the_plan_is_kept_with_the_light(tmp_path):
    """bake.json tells the decision when the light was traced, when its file is reused, and when the cache had it."""
    import json

    from skinbake.cli import run
    from skinbake.io.mesh import write_obj

    write_obj(tmp_path / "mesh.obj", relief())
    look = tmp_path / "look.yaml"
    look.write_text(LOOK.format(mesh=tmp_path / "mesh.obj"))
    told, lines = [], ["sky.harmonics", "sky.shadows"]
    cache = ["--cache", str(tmp_path / "cache")]
    for out, more in (("a", cache), ("a", ["--set", "skin.variance_mm2=[0.6]"]), ("b", cache)):
        assert run(["bake", str(look), "--out", str(tmp_path / out), "--quiet", "--no-preview", *more]) in (0, 1)
        plan = json.loads((tmp_path / out / "bake.json").read_text())["plan"]
        told.append([Decision.from_record(line) for line in plan if line["term"] in lines])
    assert [line.term for line in told[0]] == lines
    assert told[0] == told[1] == told[2]
