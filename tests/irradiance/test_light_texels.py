"""Irradiance against what can be computed apart from it."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.atlas import interpolate, rasterize
from skinbake.irradiance import light_texels
from skinbake.irradiance.oil_albedo import integrate_specular_albedo, mean_specular_albedo
from skinbake.irradiance.oil_layer import ENERGY_TRUE_STRENGTH
from skinbake.scene.lights import DirectionalLight, EnvironmentLight, PointLight, RectangleLight, SpotLight
from skinbake.scene.maps import SkinMaps
from skinbake.scene.spec import SpecularSpec
from tests.shapes import joined, quad, sphere

LEVELS = ("one", 1 / 3), ("two", 1e5), ("three", 0.7)
SUN = {"name": "sun", "type": "directional", "irradiance": (1.0, 0.5, 0.25)}


def sun(*direction, **more) -> DirectionalLight:
    return DirectionalLight(**SUN, direction=direction, **more)


def light_one(mesh, light, size=(64, 48), maps=None, **options):
    atlas = rasterize(mesh, size, gutter=2)
    (result,) = light_texels(atlas, mesh, maps or SkinMaps(), [light], **options)
    return atlas[0], result


@pytest.mark.parametrize("degrees", [0, 30, 60, 85, 89.9, 90, 120])
def test_a_quad_gets_the_cosine(degrees):
    """A flat 100 x 100 mm quad gets E = max(cos, 0), each channel its own, to 1e-6."""
    angle = np.radians(degrees)
    _, result = light_one(quad(), sun(np.sin(angle), 0, -np.cos(angle)))
    expected = max(np.cos(angle), 0) * np.array(SUN["irradiance"])
    np.testing.assert_allclose(result.rgb[0], np.broadcast_to(expected, (48, 64, 3)), atol=1e-6)


def test_a_light_that_no_skin_gets_is_told_of():
    """A sun from behind a quad is; one that lights it is not; nor one that lights one of two tiles."""
    sheets = joined(quad(uv_box=(0, 0, 1, 1)), quad(uv_box=(1, 0, 2, 1)))
    atlas = rasterize(sheets, (32, 32), udim=True)
    lights = [sun(0, 0, 1).model_copy(update={"name": "behind"}), sun(0, 0, -1)]
    for tile in light_texels(atlas, sheets, SkinMaps(), lights, shadows=False):
        assert [(name, line.enabled) for name, lines in tile.plan.items() for line in lines] == [("behind", False)]
    half = PointLight(name="near", type="point", position_mm=(30, 0, 5), intensity=(1, 1, 1))
    corner = joined(quad(uv_box=(0, 0, 1, 1)), quad(uv_box=(1, 0, 2, 1), z_mm=10))
    (first, second) = light_texels(rasterize(corner, (32, 32), udim=True), corner, SkinMaps(), [half], shadows=False)
    assert first.rgb.any()
    assert not second.rgb.any()
    assert not first.plan


@pytest.mark.parametrize("layout", ["latlong", "cube"])
def test_without_shadows_it_is_the_clamped_cosine(layout):
    """On a sphere, shadows off, E is clamp(N.L) of the interpolated normal computed apart, to 1e-6."""
    mesh = sphere(80.0, layout)
    direction = np.array([-0.6, -0.5, 0.3])
    raster, result = light_one(mesh, sun(*direction), (101, 77), shadows=False)
    normal = interpolate(raster, mesh.corner_normal).astype(float)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-30)
    cosine = np.maximum(normal @ (-direction / np.linalg.norm(direction)), 0)
    np.testing.assert_allclose(result.rgb[0, ..., 0], np.where(raster.addressed, cosine, 0), atol=1e-6)


@pytest.mark.parametrize(("segments", "size"), [(16, 512), (48, 256)])
@pytest.mark.parametrize("seed", range(4))
def test_a_coarse_sphere_does_not_shadow_itself(segments, size, seed):
    """No acne and no blocky terminator: on a convex body shadows change nothing, however coarse, at any angle."""
    mesh = sphere(100.0, "latlong", segments)
    light = sun(*np.random.default_rng(seed).normal(size=3))
    _, dark = light_one(mesh, light, (size, size))
    _, bright = light_one(mesh, light, (size, size), shadows=False)
    assert np.abs(dark.rgb - bright.rgb).max() < 0.02
    assert np.mean(dark.rgb != bright.rgb) < 2e-4


@pytest.mark.parametrize("seed", range(3))
def test_normals_that_disagree_do_not_fray_the_terminator(seed):
    """Scans have them. A coarse sphere whose normals are 3 degrees off here and there still shades itself nowhere."""
    mesh = sphere(100.0, "latlong", 24)
    off = np.random.default_rng(9).normal(size=mesh.positions_mm.shape) * np.radians(3)
    normal = mesh.corner_normal + off[mesh.faces]
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    mesh = type(mesh)(mesh.positions_mm, mesh.faces, mesh.corner_uv, normal)
    light = sun(*np.random.default_rng(seed).normal(size=3))
    _, dark = light_one(mesh, light, (256, 256))
    _, bright = light_one(mesh, light, (256, 256), shadows=False)
    assert np.mean(np.abs(dark.rgb - bright.rgb) > 0.01) < 5e-4  # 4e-3 to 9e-3 where rays start on the surface itself


def test_the_shadow_of_a_sphere_falls_where_geometry_says():
    """A sphere of 20 mm above a plane throws an ellipse; its edge is right to a texel and anti-aliased."""
    plane = quad(200.0, 200.0, uv_box=(0, 0, 0.9, 1.0))
    ball = sphere(20.0, "cube", 64)
    ball = type(ball)(
        ball.positions_mm + np.array([0, 0, 40.0]), ball.faces, ball.corner_uv * 0.05 + [0.93, 0.0], ball.corner_normal
    )
    direction = np.array([0.5, 0.2, -1.0])
    width, height = 300, 270
    raster, result = light_one(joined(plane, ball), sun(*direction), (width, height))
    d = direction / np.linalg.norm(direction)
    position = interpolate(raster, joined(plane, ball).corner_position_mm).astype(float)
    to_centre = position - [0, 0, 40.0]
    miss = np.linalg.norm(np.cross(to_centre, d), axis=-1) - 20.0  # mm from the shadow's edge, across the light
    on_plane = raster.face_index < len(plane.faces)
    on_plane &= raster.covered
    texel_mm = 200.0 / 270
    seen = result.visibility[0]
    assert (seen[on_plane & (miss > texel_mm)] == 1).all()
    assert (seen[on_plane & (miss < -texel_mm)] == 0).all()
    partial = on_plane & (seen > 0) & (seen < 1)
    assert partial.any()
    # The area in shadow, from visibility summed over the plane, is that of the ellipse
    shadow = ((1 - seen)[on_plane] * raster.area_mm2[on_plane]).sum(dtype=float)
    assert shadow == pytest.approx(np.pi * 20.0**2 / -d[2], rel=2e-3)


def test_nothing_leaks_into_a_closed_box():
    """Inside a closed sphere no light arrives, from anywhere."""
    outer, inner = sphere(60.0, "cube", 32), sphere(30.0, "cube", 32)
    outer = type(outer)(outer.positions_mm, outer.faces, outer.corner_uv * [0.5, 1.0], outer.corner_normal)
    inner = type(inner)(inner.positions_mm, inner.faces, inner.corner_uv * [0.5, 1.0] + [0.5, 0.0], inner.corner_normal)
    mesh = joined(outer, inner)
    raster, result = light_one(mesh, sun(1, -1, 0.5), (128, 64))
    inside = raster.face_index >= len(outer.faces)
    assert (result.rgb[0][inside] == 0).all()
    ao = EnvironmentLight(name="sky", type="environment", radiance=(1, 1, 1))
    _, result = light_one(mesh, ao, (128, 64))
    assert (result.rgb[0][inside] == 0).all()


def test_a_point_light_falls_with_the_square_of_distance():
    """E = I cos / d^2 at every texel of a quad."""
    light = PointLight(name="p", type="point", position_mm=(12.0, -7.0, 33.0), intensity=(5.0, 1.0, 0.0))
    raster, result = light_one(quad(), light)
    to_light = np.array(light.position_mm) - interpolate(raster, quad().corner_position_mm).astype(float)
    distance = np.linalg.norm(to_light, axis=-1)
    np.testing.assert_allclose(result.rgb[0, ..., 0], 5.0 * to_light[..., 2] / distance**3, rtol=1e-5)
    np.testing.assert_allclose(result.rgb[0, ..., 1] * 5, result.rgb[0, ..., 0], rtol=1e-5)


def test_a_spot_is_a_point_inside_its_cone_and_nothing_outside():
    """Full inside inner_deg, zero outside outer_deg, monotone and smooth between."""
    point = PointLight(name="s", type="point", position_mm=(0.0, 0.0, 80.0), intensity=(1.0, 1.0, 1.0))
    spot = SpotLight(
        name="s",
        type="spot",
        position_mm=(0.0, 0.0, 80.0),
        intensity=(1, 1, 1),
        axis=(0, 0, -1),
        inner_deg=12,
        outer_deg=25,
    )
    raster, full = light_one(quad(), point)
    _, cone = light_one(quad(), spot)
    position = interpolate(raster, quad().corner_position_mm)
    angle = np.degrees(np.arctan2(np.hypot(position[..., 0], position[..., 1]), 80.0))
    share = cone.rgb[0, ..., 0] / full.rgb[0, ..., 0]
    np.testing.assert_allclose(share[angle < 12], 1, rtol=1e-6)
    assert (share[angle > 25] == 0).all()
    order = np.argsort(angle.ravel())
    assert (np.diff(share.ravel()[order]) <= 1e-6).all()


def test_a_rectangle_has_the_form_factor_of_its_closed_form():
    """A parallel rectangle over a quad: E = pi L F with the textbook's form factor [Howell], to 1e-5, shadows on."""
    a, b, c = 30.0, 22.0, 40.0
    light = RectangleLight(
        name="r", type="rectangle", position_mm=(0, 0, c), edge_u_mm=(a, 0, 0), edge_v_mm=(0, -b, 0), radiance=(2, 1, 1)
    )
    raster, result = light_one(quad(), light, (33, 33))

    def corner(x, y):  # differential element to a rectangle x by y with one corner above it
        x, y = x / c, y / c
        sx, sy = np.sqrt(1 + x * x), np.sqrt(1 + y * y)
        return (x / sx * np.arctan(y / sx) + y / sy * np.arctan(x / sy)) / (2 * np.pi)

    p = interpolate(raster, quad().corner_position_mm).astype(float)
    factor = sum(
        sx * sy * corner(sx * (a / 2) - p[..., 0], sy * (b / 2) - p[..., 1]) for sx in (1, -1) for sy in (1, -1)
    )
    np.testing.assert_allclose(result.rgb[0, ..., 0], 2 * np.pi * factor, rtol=1e-4)
    np.testing.assert_allclose(result.visibility[0], 1)


def test_a_rectangle_behind_or_across_the_horizon():
    """Nothing from the back of the light; light across the horizon is cut there, against brute force."""
    back = RectangleLight(
        name="r", type="rectangle", position_mm=(0, 0, 40), edge_u_mm=(9, 0, 0), edge_v_mm=(0, 9, 0), radiance=(1, 1, 1)
    )
    _, result = light_one(quad(), back, (8, 8))
    assert (result.rgb == 0).all()
    across = RectangleLight(
        name="r",
        type="rectangle",
        position_mm=(70, 0, 0),
        edge_u_mm=(0, 30, 0),
        edge_v_mm=(0, 0, 60),
        radiance=(1, 1, 1),
    )
    flipped = across.model_copy(update={"edge_u_mm": (0, -30, 0)})
    raster, result = light_one(
        quad(), flipped if np.cross((0, 30, 0), (0, 0, 60))[0] > 0 else across, (16, 16), shadows=False
    )
    p = interpolate(raster, quad().corner_position_mm).astype(float)
    t = (np.arange(400) + 0.5) / 400 - 0.5
    y, z = np.meshgrid(30 * t, 60 * t)
    brute = np.zeros((16, 16))
    for row in range(16):
        for col in range(16):
            d = np.stack([np.full(y.shape, 70.0), y, z], -1) - p[row, col]
            r2 = (d * d).sum(-1)
            brute[row, col] = (np.maximum(d[..., 2], 0) * np.maximum(d[..., 0], 0) / r2**2).sum() * 30 * 60 / 400**2
    np.testing.assert_allclose(result.rgb[0, ..., 0], brute, rtol=2e-3)


def test_a_soft_shadow_against_many_samples():
    """A penumbra from 36 jittered samples agrees with 4096 within its noise, and without bias."""
    blocker = quad(30.0, 30.0, z_mm=25.0, uv_box=(0.95, 0, 1, 1))
    mesh = joined(quad(100.0, 100.0, uv_box=(0, 0, 0.9, 1)), blocker)
    shape = {
        "name": "r", "type": "rectangle", "position_mm": (10, 0, 70), "edge_u_mm": (25, 0, 0), "edge_v_mm": (0, -25, 0),
        "radiance": (1, 1, 1),
    }  # fmt: skip
    _, fine = light_one(mesh, RectangleLight(**shape, samples=1600), (40, 32))
    _, coarse = light_one(mesh, RectangleLight(**shape), (40, 32))
    soft = (fine.visibility[0] > 0.05) & (fine.visibility[0] < 0.95)
    assert soft.sum() > 100
    error = (coarse.visibility[0] - fine.visibility[0])[soft]
    assert np.sqrt((error**2).mean()) < 0.05
    assert abs(error.mean()) < 0.01


def test_a_constant_environment_gives_pi_on_a_convex_body():
    """Radiance 1 from everywhere is E = pi to 0.5 %, with shadow rays."""
    light = EnvironmentLight(name="sky", type="environment", radiance=(1.0, 0.5, 0.0))
    raster, result = light_one(sphere(70.0, "cube", 32), light, (96, 64))
    np.testing.assert_allclose(result.rgb[0][raster.covered][:, 0], np.pi, rtol=5e-3)
    assert (result.rgb[0][..., 2] == 0).all()


def test_ambient_occlusion_beside_a_wall():
    """At distance a from a wall of height h, E / pi = (1 + a / hypot(a, h)) / 2: half the sky at its foot."""
    floor = quad(100.0, 100.0, uv_box=(0, 0, 0.45, 1))
    wall = quad(4000.0, 2000.0, uv_box=(0.55, 0, 1, 1))
    turned = np.stack(
        [np.full(len(wall.positions_mm), 50.0), wall.positions_mm[:, 0], wall.positions_mm[:, 1] + 1000], 1
    )
    wall = type(wall)(
        turned, wall.faces[:, ::-1].copy(), wall.corner_uv[:, ::-1], wall.corner_normal * 0 + [-1.0, 0, 0]
    )
    mesh = joined(floor, wall)
    light = EnvironmentLight(name="sky", type="environment", radiance=(1, 1, 1), samples=1024)
    raster, result = light_one(mesh, light, (128, 64))
    x = interpolate(raster, mesh.corner_position_mm)[..., 0].astype(float)
    on_floor = (raster.face_index < len(floor.faces)) & (raster.coverage == 1)
    height, away = 2000.0, 50.0 - x
    expected = np.pi * (0.5 + 0.5 * away / np.hypot(away, height))  # an infinitely long wall of that height
    np.testing.assert_allclose(result.rgb[0, ..., 0][on_floor], expected[on_floor], rtol=0.02)


def test_an_environment_of_one_bright_texel_is_a_sun():
    """A small bright patch lights like a directional light from there; this fixes the map's orientation."""
    image = np.zeros((64, 128, 3), np.float32)
    image[16, 96] = 1000.0  # u = 0.754 towards -x, v = 0.74: 43 degrees up
    light = EnvironmentLight(name="sky", type="environment", path="sky.exr")
    mesh = sphere(50.0, "cube", 32)
    raster, result = light_one(mesh, light, (96, 64), environments={"sky": image}, shadows=False)
    normal = interpolate(raster, mesh.corner_normal)
    brightest = normal[np.unravel_index(result.rgb[0, ..., 0].argmax(), raster.shape)]
    expected = np.array([-np.cos(np.radians(43.6)), np.sin(np.radians(43.6)), 0.0])
    assert brightest @ expected > 0.995
    solid = 2 * np.pi / 128 * (np.cos(np.pi * 16 / 64) - np.cos(np.pi * 17 / 64))
    assert result.rgb.max() == pytest.approx(1000 * solid, rel=0.01)


def test_the_oil_takes_its_share():
    """With energy conservation E is multiplied by 1 - rho_s A(N.L, m), the roughness and specular maps included."""
    rng = np.random.default_rng(0)
    m = rng.uniform(0.15, 0.9, (48, 64)).astype(np.float32)
    factor = rng.uniform(0, 1, (48, 64)).astype(np.float32)
    maps = SkinMaps(roughness={1001: m}, specular={1001: factor})
    angle = np.radians(60)
    spec = SpecularSpec(f0=0.028, strength=ENERGY_TRUE_STRENGTH)
    _, result = light_one(
        quad(), sun(np.sin(angle), 0, -np.cos(angle)), maps=maps, specular=spec, energy_conservation=True
    )
    split = integrate_specular_albedo(np.full(m.shape, 0.5), m.astype(float))
    expected = 0.5 * (1 - factor * ENERGY_TRUE_STRENGTH * (0.028 * split[..., 0] + split[..., 1]))
    np.testing.assert_allclose(result.rgb[0, ..., 0], expected, rtol=2e-4)


def test_oil_under_an_environment_is_the_mean_share():
    """In a constant environment the factor is 1 - rho_s 2 int A c dc, theory.md 6.4."""
    light = EnvironmentLight(name="sky", type="environment", radiance=(1, 1, 1), samples=1024)
    spec = SpecularSpec(f0=1 / 36, roughness=0.3, strength=ENERGY_TRUE_STRENGTH)
    raster, result = light_one(sphere(50.0, "cube", 32), light, (48, 32), specular=spec, energy_conservation=True)
    np.testing.assert_allclose(result.rgb[0][raster.covered], np.pi * (1 - 0.14789 / np.pi), rtol=5e-3)


@pytest.mark.parametrize("kind", ["sky", "box"])
def test_maps_of_the_oil_are_finer_than_the_lattice_of_rays(kind):
    """Where rays are interpolated, the oil is not: under a sky, and under a box from afar, each texel has its own."""
    rng = np.random.default_rng(0)
    m, factor = (rng.uniform(*bounds, (96, 128)).astype(np.float32) for bounds in ((0.15, 0.9), (0.0, 1.0)))
    f0 = rng.uniform(0.01, 0.2, m.shape).astype(np.float32)
    maps = SkinMaps(roughness={1001: m}, specular={1001: factor}, f0={1001: f0})
    if kind == "sky":
        light = EnvironmentLight(name="sky", type="environment", radiance=(1, 1, 1))
        arriving, albedo = np.pi, np.vectorize(mean_specular_albedo)(m, f0)
    else:
        box = {"position_mm": (0, 0, 10000), "edge_u_mm": (0, 100, 0), "edge_v_mm": (100, 0, 0)}
        light = RectangleLight(name="box", type="rectangle", radiance=(1, 1, 1), **box)
        split = integrate_specular_albedo(1.0, m.astype(float))
        arriving, albedo = 1e-4, f0 * split[..., 0] + split[..., 1]
    _, result = light_one(quad(), light, (128, 96), maps, specular=SpecularSpec(strength=0.3), energy_conservation=True)
    np.testing.assert_allclose(result.rgb[0, ..., 0], arriving * (1 - 0.3 * factor * albedo), rtol=5e-4)


@pytest.mark.parametrize("green", [0.0, 0.4])
def test_a_normal_map_tilts_along_u_and_v(green):
    """A constant tangent normal on a quad turns the normal towards +u and +v by its slopes, mirrored charts too."""
    tilt = np.array([0.3, green, 0.85])
    maps = SkinMaps(normal={1001: np.broadcast_to(tilt.astype(np.float32), (5, 7, 3)).copy()})
    direction = np.array([-0.4, -0.3, -1.0])
    to_light = -direction / np.linalg.norm(direction)
    unit = tilt / np.linalg.norm(tilt)
    _, result = light_one(quad(), sun(*direction), maps=maps)
    np.testing.assert_allclose(result.rgb[0, ..., 0], unit @ to_light, rtol=1e-5)
    mirrored = quad()
    uv = mirrored.corner_uv.copy()
    uv[..., 0] = 1 - uv[..., 0]
    _, result = light_one(
        type(mirrored)(mirrored.positions_mm, mirrored.faces, uv, mirrored.corner_normal), sun(*direction), maps=maps
    )
    np.testing.assert_allclose(result.rgb[0, ..., 0], (unit * [-1, 1, 1]) @ to_light, rtol=1e-5)


def test_bumps_fade_at_the_terminator_without_shadows_too():
    """A box that grazes a quad lights a bump that faces it as a lamp there does, with shadows or without."""
    tilt = np.array([0.9, 0.0, 0.4])
    maps = SkinMaps(normal={1001: np.broadcast_to(tilt.astype(np.float32), (4, 4, 3)).copy()})
    box = {"position_mm": (10000, 0, 300), "edge_u_mm": (0, 0, 100), "edge_v_mm": (0, 100, 0), "radiance": (1, 1, 1)}
    lamp = PointLight(name="lamp", type="point", position_mm=box["position_mm"], intensity=(10000, 10000, 10000))
    _, expected = light_one(quad(), lamp, maps=maps, shadows=False)
    for shadows in (False, True):
        light = RectangleLight(name="box", type="rectangle", **box, shadows=shadows)
        _, result = light_one(quad(), light, maps=maps)
        np.testing.assert_allclose(result.rgb, expected.rgb, rtol=0.02)


def test_an_object_space_map_is_the_normal():
    """Object-space normals replace the mesh's own."""
    tilt = np.array([0.3, -0.2, 0.85])
    maps = SkinMaps(normal={1001: np.broadcast_to(tilt.astype(np.float32), (4, 4, 3)).copy()}, normal_space="object")
    _, result = light_one(quad(), sun(0.2, 0.1, -1), maps=maps, shadows=False)
    to_light = np.array([-0.2, -0.1, 1]) / np.linalg.norm([0.2, 0.1, 1])
    np.testing.assert_allclose(result.rgb[0, ..., 0], tilt @ to_light / np.linalg.norm(tilt), rtol=1e-5)


LIGHTS = [
    sun(1, -1, -2),
    PointLight(name="p", type="point", position_mm=(90, 80, 120), intensity=(2e4, 1e4, 1e4)),
    RectangleLight(
        name="r",
        type="rectangle",
        position_mm=(80, 0, 90),
        edge_u_mm=(30, 0, 0),
        edge_v_mm=(0, -30, 0),
        radiance=(1, 1, 1),
    ),
    EnvironmentLight(name="sky", type="environment", radiance=(1, 1, 1), samples=64),
]  # fmt: skip


def test_a_light_alone_gives_the_same_bytes_as_among_others():
    """Each light can be computed on its own: per-light caching depends on it."""
    mesh = joined(sphere(40.0, "cube", 16), quad(120, 120, -60, uv_box=(0, 0, 0.3, 0.3)))
    atlas = rasterize(mesh, (80, 56))
    (together,) = light_texels(atlas, mesh, SkinMaps(), LIGHTS, seed=3)
    for i, light in enumerate(LIGHTS):
        (alone,) = light_texels(atlas, mesh, SkinMaps(), [light], seed=3)
        assert alone.rgb[0].tobytes() == together.rgb[i].tobytes()
        assert alone.visibility[0].tobytes() == together.visibility[i].tobytes()


def test_threads_do_not_change_a_byte(monkeypatch):
    """One thread and three give the same irradiance."""
    mesh = joined(sphere(40.0, "cube", 16), quad(120, 120, -60, uv_box=(0, 0, 0.3, 0.3)))
    atlas = rasterize(mesh, (300, 280))
    found = []
    for threads in (1, 3):
        monkeypatch.setenv("NUMBA_NUM_THREADS", str(threads))
        found.append(light_texels(atlas, mesh, SkinMaps(), LIGHTS, seed=3)[0].rgb.tobytes())
    assert found[0] == found[1]


@pytest.mark.parametrize("scale", [0.0, 1e-8, 1e5, 1e30])
def test_extreme_lights_stay_finite_and_linear(scale):
    """Irradiance scales with the light from 0 to 1e30 and never leaves the finite numbers."""
    light = DirectionalLight(name="sun", type="directional", direction=(0.3, 0, -1), irradiance=(scale,) * 3)
    _, result = light_one(quad(), light, (9, 7))
    expected = scale / np.hypot(0.3, 1)
    np.testing.assert_allclose(result.rgb, expected, rtol=1e-5)


def test_a_mesh_far_from_the_origin_is_lit_as_well():
    """A sphere a kilometre away: no acne from float32 positions."""
    near = sphere(80.0, "cube", 32)
    far = type(near)(near.positions_mm + np.array([1e6, -2e6, 5e5]), near.faces, near.corner_uv, near.corner_normal)
    _, expected = light_one(near, sun(-1, -0.4, 0.2), (90, 60))
    _, result = light_one(far, sun(-1, -0.4, 0.2), (90, 60))
    np.testing.assert_allclose(result.rgb, expected.rgb, atol=1e-4)


def test_a_light_that_is_no_half_has_all_kept_as_floats():
    """Rounded to half but for the second of three: all are floats then, each with its own values, once each."""
    mesh, done = quad(), []

    def rounded(image):
        done.append(image.copy())
        return image if len(done) == 2 else image.astype(np.float16)

    lights = [sun(0, 0, -1).model_copy(update={"name": name, "irradiance": (e, e, e)}) for name, e in LEVELS]
    (result,) = light_texels(rasterize(mesh, (16, 12)), mesh, SkinMaps(), lights, rounded=rounded)
    assert result.rgb.dtype == np.float32
    for k, (_, level) in enumerate(LEVELS):
        kept = done[k] if k == 1 else done[k].astype(np.float16)
        np.testing.assert_array_equal(result.rgb[k], kept[..., :3])
        np.testing.assert_array_equal(result.visibility[k], kept[..., 3])
        assert result.rgb[k].max() == pytest.approx(level, rel=1e-3)
