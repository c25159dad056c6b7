"""Light comes through a slab as the slab's transmittance says, and through nothing else."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from skinbake.atlas import interpolate, rasterize
from skinbake.diffuse.diffuse_map import DiffuseMap, Lobe
from skinbake.diffuse.terms.far_side import far_side
from skinbake.diffuse.terms.flesh_rays import AROUND, NOISE
from skinbake.diffuse.terms.slab_weights import SlabWeights, fit_slabs, slab_weights
from skinbake.diffuse.terms.thin_parts import FEW_MM, ThinParts, TranslucentSkin
from skinbake.diffuse.terms.transmission import TransmissionSwitch, TransmittedLight, look_behind, transmit
from skinbake.irradiance import light_texels
from skinbake.irradiance.occluder import Occluder
from skinbake.profile import GaussianSum
from skinbake.profile.effective_medium import effective_medium
from skinbake.profile.fresnel import boundary_factor
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.photons import fresnel
from skinbake.profile.skin_medium import SkinMedium
from skinbake.profile.slab import half_space
from skinbake.profile.slab_transport import diffuse_mean, slab_transport
from skinbake.scene.lights import DirectionalLight
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import TextureSpec
from tests.shapes import joined, quad, sphere

WIDE = np.array([0.02, 0.1, 0.5, 2.0, 8.0])
ON = TransmissionSwitch("on", 0.01)


def gaussians(weight_rgb=None, energy=1.0, variance=WIDE):
    weight = np.full((len(variance), 3), 1 / len(variance)) if weight_rgb is None else weight_rgb
    return GaussianSum(variance, weight, np.zeros(3), np.full(3, energy))


def translucent(mesh, profile, size, medium=None, udim=False, scatter=1.0) -> TranslucentSkin:
    """Skin of albedo 0.5."""
    texture = TextureSpec(size=size, gutter=4, udim=udim)
    return TranslucentSkin(mesh, Occluder(mesh), texture, profile, np.full(3, 0.5), medium or SkinMedium(), scatter)


def at(weights: SlabWeights, thickness_mm: float, channel=0, factor=1.0) -> float:
    total = (weights.through_rgb * factor)[:, channel]
    return float(np.interp(np.log(thickness_mm), np.log(weights.thickness_mm), total))


def slab_mesh(thickness_mm: float) -> SkinMesh:
    """Two square faces, 60 mm wide: the lower one, u below one half, faces down."""
    upper = quad(60.0, 60.0, thickness_mm, columns=4, rows=4, uv_box=(0.55, 0, 1, 1))
    lower = quad(60.0, 60.0, 0.0, columns=4, rows=4, uv_box=(0, 0, 0.45, 1))
    lower = SkinMesh(
        lower.positions_mm, lower.faces[:, ::-1].copy(), lower.corner_uv[:, ::-1].copy(), -lower.corner_normal
    )
    return joined(lower, upper)


def lit_below(mesh, profile, size, light=(3.0, 2.0, 1.0), method="texture"):
    """Every lobe holds `light` on the lower face and nothing on the upper one."""
    (raster,) = rasterize(mesh, size)
    lower = interpolate(raster, mesh.corner_normal)[..., 2] < 0
    image = np.where(lower[..., None], np.float32(light), np.float32(0))[None]
    lobes = tuple(
        Lobe(float(v), tuple(w), method, {1001: image})
        for v, w in zip(profile.variance_mm2, profile.weight_rgb, strict=True)
    )
    return raster, DiffuseMap(("sun",), lobes, None)


@pytest.mark.parametrize("normalise", ["white", "none"])
@pytest.mark.parametrize(
    ("thickness", "published", "scattered"), [(2, 0.222, 0.284), (4, 0.105, 0.234), (8, 0.027, 0.093)]
)
def test_the_slab_s_total_is_transport_s(thickness, published, scattered, normalise):
    """Skin1 red, n = 1.3, along the normal: T(d) of Monte Carlo less its ballistic part."""
    medium = Medium(np.full(3, 0.032), np.full(3, 0.74))
    light = slab_transport(medium, 1.3, np.array([1.0]))
    # A profile that gives back R(1), whose light counts by R(1) / R_ref
    total = 1.0 if normalise == "white" else light.back[-1, 0]
    reference = diffuse_mean(light.cosine, light.back)[0] if normalise == "white" else total
    profile = GaussianSum(WIDE, np.full((5, 3), total / 5), np.zeros(3), np.full(3, total), normalise=normalise)
    slabs = fit_slabs(profile, medium, 1.3)
    counted = at(slabs, thickness, factor=slabs.counted_rgb[:, -2]) * light.back[-1, 0] / reference
    plain = at(slabs, thickness, factor=slabs.plain_rgb[:, -2])
    assert counted * reference / total == pytest.approx(scattered, rel=0.03)
    assert plain == pytest.approx(counted, rel=1e-6)
    assert published / scattered < 0.8


def test_the_effective_medium_has_the_reflectance_and_the_width():
    """Its dipole reflects what was asked, with the profile's mean square radius."""
    profile = gaussians()
    asked = np.array([0.6, 0.4, 0.2])
    medium = effective_medium(profile, asked)
    boundary = boundary_factor(1.4)
    step = 1e-3
    low, _ = half_space(medium, boundary, np.full((1, 1), 1e-9))
    high, _ = half_space(medium, boundary, np.full((1, 1), step))
    np.testing.assert_allclose(low[:, 0], asked, rtol=1e-6)
    # R~(s) = R (1 - s^2 <r^2> / 4 + ...)
    np.testing.assert_allclose(4 * (1 - high / low)[:, 0] / step**2, 2 * WIDE.mean(), rtol=1e-3)


def test_weights_are_positive_and_fall_beyond_two_free_paths():
    """No weight is negative; what comes through rises until it has scattered, and falls then."""
    profile, asked = gaussians(), np.array([0.6, 0.4, 0.3])
    weights = slab_weights(profile, asked, SkinMedium())
    assert (weights.through_rgb >= 0).all()
    for channel, free_path in enumerate(effective_medium(profile, asked).free_path_mm):
        total = weights.through_rgb[:, channel]
        thick = weights.thickness_mm > 2 * free_path
        assert (np.diff(total[thick]) <= 1e-9).all()
        assert total[0] < total.max()


def test_no_more_comes_through_than_arrives():
    """A white profile of a medium that scatters forwards, and sends next to nothing back."""
    forward = SkinMedium((Layer(Medium(np.full(3, 2.0), np.array([0.02, 0.2, 300.0])), np.inf, 1.4, 0.9),))
    through = slab_weights(gaussians(), np.full(3, 0.5), forward).through_rgb
    np.testing.assert_allclose(through[:, 0].max(), 1)
    assert through.max() <= 1 + 1e-12
    assert through[:, 2].max() < 0.9


@pytest.mark.parametrize("method", ["texture", "surface"])
def test_a_slab_takes_the_light_once(method):
    """Whatever lobes have of it: the weights of what they carry through themselves are of what they have."""
    profile, mesh, size = gaussians(energy=0.5), slab_mesh(3.0), (90, 40)
    _, diffused = lit_below(mesh, profile, size, method=method)
    times = np.linspace(0.7, 1.3, len(profile.variance_mm2))[None, :, None] * np.ones(3)
    more = [
        replace(lobe, rgb={1001: lobe.rgb[1001] * of.astype(np.float32)})
        for lobe, of in zip(diffused.lobes, times[0], strict=True)
    ]
    thin = ThinParts.of(translucent(mesh, profile, size))
    once, same = (
        transmit(diffused, thin, ON)[0],
        transmit(replace(diffused, lobes=tuple(more)), thin, ON, times=times)[0],
    )
    through = np.exp(-9 / (2 * profile.variance_mm2[:, None]))
    carried = through / (1 + through) * profile.weight_rgb if method == "surface" else 0  # of a sum over both sides
    place = (1001, (0, size[1] // 2, int(0.775 * size[0])))
    less = ((times[0] - 1) * carried).sum(axis=0) * (3.0, 2.0, 1.0)
    np.testing.assert_allclose(same.rgb[1001][place[1]], once.rgb[1001][place[1]] - less, rtol=0.02)


@pytest.mark.parametrize("method", ["texture", "surface"])
def test_a_lit_slab_glows_with_its_transmittance(method):
    """The dark side of a 3 mm slab gets T(3 mm) of the light below, less what a surface lobe already carries."""
    profile, mesh, size = gaussians(energy=0.5), slab_mesh(3.0), (90, 40)
    _, diffused = lit_below(mesh, profile, size, method=method)
    lobe, plan = transmit(diffused, ThinParts.of(translucent(mesh, profile, size)), ON)
    assert plan.enabled
    weights = slab_weights(profile, np.full(3, 0.5), SkinMedium())
    expected = at(weights, 3.0)
    if method == "surface":
        carried = np.exp(-9 / (2 * WIDE))
        expected -= (0.2 * carried / (1 + carried)).sum()  # of a sum over both sides
    height, width = lobe.rgb[1001].shape[1:3]
    centre = lobe.rgb[1001][0, height // 2, int(0.775 * width)]
    np.testing.assert_allclose(centre, expected * np.array([3.0, 2.0, 1.0]), rtol=0.02)
    # The lit side gets nothing from the dark one
    assert lobe.rgb[1001][0, height // 2, int(0.2 * width)].max() < 1e-6


def through_by_photons(thickness_mm: float, degrees: float, eta: float = 1.4, photons: int = 60_000) -> float:
    """Share of the photons that entered a slab of skin1 (red) at an angle to the normal and leave at its back.

    A random walk of its own: isotropic scattering, refraction at entry, Fresnel's reflection at both faces.
    """
    rng = np.random.default_rng(int(10 * thickness_mm + degrees))
    absorbed, scattered = 0.032, 0.74
    z, weight, left = np.zeros(photons), np.ones(photons), 0.0
    cosine = np.full(photons, np.sqrt(1 - (np.sin(np.radians(degrees)) / eta) ** 2))
    while len(z):
        z = z + cosine * rng.exponential(1 / (absorbed + scattered), len(z))
        outside = (z < 0) | (z > thickness_mm)
        while outside.any():
            inside = np.abs(cosine[outside])
            out = np.sqrt(np.maximum(1 - eta**2 * (1 - inside**2), 0))
            parallel, across = (inside - eta * out) / (inside + eta * out), (eta * inside - out) / (eta * inside + out)
            kept = np.where(out > 0, (parallel**2 + across**2) / 2, 1.0)
            back = z[outside] > thickness_mm
            left += (weight[outside] * (1 - kept))[back].sum()
            weight[outside] *= kept
            z[outside] = np.where(back, 2 * thickness_mm - z[outside], -z[outside])
            cosine[outside] *= -1
            outside = (z < 0) | (z > thickness_mm)
        weight *= scattered / (absorbed + scattered)
        cosine = rng.uniform(-1, 1, len(z))
        alive = weight > 1e-4
        z, weight, cosine = z[alive], weight[alive], cosine[alive]
    return left / photons


@pytest.mark.parametrize("thickness", [2.0, 4.0])
@pytest.mark.parametrize("degrees", [0, 30, 60])
def test_slanted_light_comes_through_as_photons_do(thickness, degrees):
    """A slab of skin1 (red) lit from behind at an angle: what entered and scattered, within 3 % of 60,000 photons."""
    medium = Medium(np.full(3, 0.032), np.full(3, 0.74))
    inside = np.sqrt(1 - (np.sin(np.radians(degrees)) / 1.4) ** 2)
    back = fresnel.py_func(1.4, 1.0, inside)[0]
    passed = np.exp(-0.772 * thickness / inside)
    want = through_by_photons(thickness, degrees) - (1 - back) * passed / (1 - (back * passed) ** 2)
    light = slab_transport(medium, 1.4, np.array([thickness]))
    got = np.interp(np.cos(np.radians(degrees)), light.cosine, light.through[0, :, 0])
    assert got == pytest.approx(want, rel=0.03)


@pytest.mark.parametrize("counted", [True, False])
@pytest.mark.parametrize("degrees", [0, 30, 60])
def test_light_from_behind_comes_through_by_its_slant(degrees, counted):
    """A sun behind a 3 mm slab: of E cos(angle) that arrives there T(cos; 3 mm) leaves here, whether it was counted by
    its incidence or not."""
    medium = Medium(np.array([0.032, 0.17, 0.48]), np.array([0.74, 0.88, 1.01]))
    slab = slab_transport(medium, 1.4, np.array([3.0]))
    profile, mesh, size = gaussians(energy=0.5), slab_mesh(3.0), (90, 40)
    profile = GaussianSum(WIDE, np.tile(slab.back[-1] / 5, (5, 1)), np.zeros(3), slab.back[-1], normalise="none")
    angle = np.radians(degrees)
    light = DirectionalLight(
        name="sun", type="directional", direction=(np.sin(angle), 0, np.cos(angle)), irradiance=(3, 2, 1)
    )
    (lit,) = light_texels(rasterize(mesh, size), mesh, SkinMaps(), [light])

    def at_slant(values):
        return np.array([np.interp(np.cos(angle), slab.cosine, values[:, c]) for c in range(3)])

    enters = at_slant(slab.back) / slab.back[-1] if counted else np.ones(3)
    pairs = zip(profile.variance_mm2, profile.weight_rgb, strict=True)
    rgb = (lit.rgb * enters).astype(np.float32)
    lobes = tuple(Lobe(float(v), tuple(w), "texture", {1001: rgb}) for v, w in pairs)
    thin = ThinParts.of(translucent(mesh, profile, size, SkinMedium((Layer(medium, np.inf, 1.4),))))
    lobe, _ = transmit(DiffuseMap(("sun",), lobes, None), thin, ON, {"sun": TransmittedLight(light, counted)})
    height, width = lobe.rgb[1001].shape[1:3]
    expected = at_slant(slab.through[0]) * np.cos(angle) * np.array([3.0, 2.0, 1.0])
    np.testing.assert_allclose(lobe.rgb[1001][0, height // 2, int(0.775 * width)], expected, rtol=0.04)


def test_far_side_of_a_sphere_is_its_antipode():
    """Along the inward normal of a sphere: a diameter away, squarely opposed, at the antipode's UV."""
    mesh = sphere(20.0, "cube", 48)
    occluder = Occluder(mesh)
    (raster,) = rasterize(mesh, (64, 48), gutter=0)
    rows, cols = np.nonzero(raster.coverage == 1)
    normal = interpolate(raster, mesh.corner_normal)[rows, cols]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    point = 20 * normal
    far = far_side(occluder, mesh, point.astype(np.float32) * np.float32(0.999), normal)
    np.testing.assert_allclose(far.thickness_mm, 40, atol=0.15)
    assert far.opposed.min() > 0.99
    np.testing.assert_allclose(far.point, -point, atol=0.15)
    np.testing.assert_allclose(far.normal, -normal, atol=0.02)
    there = mesh.corner_position_mm[far.face].mean(axis=1)
    assert np.einsum("ij,ij->i", there / 20, -normal).min() > 0.98


def test_auto_leaves_out_what_is_too_thick():
    """A slab of 40 mm transmits nothing worth a file, one of 2 mm does."""
    profile, mesh, size = gaussians(energy=0.5), slab_mesh(39.0), (60, 30)
    _, diffused = lit_below(mesh, profile, size)
    auto = TransmissionSwitch("auto", 0.01)
    lobe, plan = transmit(diffused, ThinParts.of(translucent(mesh, profile, size)), auto)
    assert lobe is None
    assert not plan.enabled
    assert "%" in plan.why
    _, diffused = lit_below(slab_mesh(2.0), profile, size)
    assert transmit(diffused, ThinParts.of(translucent(slab_mesh(2.0), profile, size)), auto)[1].enabled


def test_a_few_texels_say_what_comes_through_as_all_do():
    """Behind a sixteenth of the texels there is as much light as behind all; half of the limit leaves out no more."""
    profile, mesh, size = gaussians(energy=0.5), slab_mesh(6.0), (240, 120)
    _, diffused = lit_below(mesh, profile, size)
    skin, auto = translucent(mesh, profile, size), TransmissionSwitch("auto", 9.0)
    all_of_it, few = ThinParts.of(skin), ThinParts.of(skin, FEW_MM)
    assert few.tiles[0].raster.shape < all_of_it.tiles[0].raster.shape
    whole, guess = (transmit(diffused, thin, auto)[1].error for thin in (all_of_it, few))
    assert guess == pytest.approx(whole, rel=0.05)
    limited = auto._replace(limit=1.5 * whole)
    kept = [transmit(diffused, few, limited, margin=margin)[1].enabled for margin in (1, 0.5)]
    assert kept == [False, True]


def test_a_medium_that_is_known_is_the_slab_s():
    """One layer that fills the head is taken as it is, with its own index; of several the index is."""
    skin1 = Medium(np.array([0.032, 0.17, 0.48]), np.array([0.74, 0.88, 1.01]))
    reflectance = np.array([0.5, 0.3, 0.2])
    profile = gaussians(np.tile(reflectance / 5, (5, 1)))
    for eta in (1.0, 1.4):
        known = slab_weights(profile, reflectance, SkinMedium((Layer(skin1, np.inf, eta, 0.3),)))
        np.testing.assert_array_equal(known.through_rgb, fit_slabs(profile, skin1, eta, 0.3).through_rgb)
        layers = SkinMedium((Layer(skin1, 0.3, eta), Layer(skin1, np.inf, eta)))
        several = slab_weights(profile, reflectance, layers).through_rgb
        effective = fit_slabs(profile, effective_medium(profile, reflectance, eta), eta).through_rgb
        np.testing.assert_array_equal(several, effective)
    np.testing.assert_array_equal(
        slab_weights(profile, reflectance, SkinMedium()).through_rgb, several
    )  # 1.4 where nobody says


def test_more_rays_are_taken_where_the_tolerance_wants_them_and_what_they_leave_is_said():
    """A slab lit below one half: against twenty rays at a cosine, and by the plan's line."""
    profile, mesh, size = gaussians(), slab_mesh(4.0), (180, 80)
    raster, diffused = lit_below(mesh, profile, size)
    dark = interpolate(raster, mesh.corner_position_mm)[..., 0] < 3.0
    for lobe in diffused.lobes:
        lobe.rgb[1001][:, dark] = 0
    skin = translucent(mesh, profile, size)

    def through(switch):
        thin, _ = look_behind(skin, switch, partial(transmit, diffused))
        assert thin is not None
        lobe, line = transmit(diffused, thin, switch)
        return lobe.rgb[1001], line.error, thin.around

    exact, least, most = through(TransmissionSwitch("on", 1e-4, 1e-6))
    few, said, fewest = through(TransmissionSwitch("on", 0.5, 1.0))
    more, less, between = through(TransmissionSwitch("on", 0.01, said))
    assert (fewest, most) == (AROUND[0], AROUND[-1])
    assert fewest < between < most
    assert 0 < least < less <= 0.55 * said  # the first look is at few texels

    def off(image):
        return np.sqrt(((image - exact) ** 2).sum() / (exact**2).sum())

    assert off(more) < 0.6 * off(few)
    assert off(few) < 2 * NOISE  # of the light that comes through
