"""The size to work at: what a coarser texture loses is what brute force says, and the tolerance decides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import convolve1d, map_coordinates
from scipy.special import ive

from skinbake.atlas.sample import shrink
from skinbake.diffuse.planning import texture_size
from skinbake.diffuse.planning.texture_size import (
    EDGES_PER_MM,
    SHARE,
    LitPatches,
    at_size,
    choose_size,
    coarser_sizes,
    may_be_reduced,
)
from skinbake.io.config import parse_scene
from skinbake.profile import GaussianSum
from skinbake.profile.weight_table import WeightTable
from skinbake.scene.maps import SkinMaps
from tests.shapes import quad

SIDE, MM = 1024, 200.0
SLANTED_EDGES = 0.2  # a texel averages over a longer way across an edge that slants to its sides
SKIN = GaussianSum(
    np.array([0.0016, 0.09, 4.0]),
    np.array([[0.2, 0.3, 0.5], [0.3, 0.3, 0.3], [0.5, 0.4, 0.2]]),
    np.ones(3),
    np.zeros(3),
)


def look(tolerance=0.05, **more):
    """A look whose texture, tolerance and texturing count."""
    raw = {
        "mesh": {"path": "x.obj", "unit": "mm"},
        "texture": {"size": SIDE} | more.pop("texture", {}),
        "skin": {"model": "dipole", "sigma_a_per_mm": [0.1, 0.1, 0.1], "sigma_sp_per_mm": [1, 1, 1]},
        "lights": [{"name": "sun", "type": "directional", "direction": [0, 0, -1], "irradiance": [1, 1, 1]}],
        "diffusion": {"tolerance": tolerance},
        "output": {"dir": "out"},
    } | more
    return parse_scene(raw, lambda key, text: f"{key}: {text}")


def detail_lost(spec, mesh, maps, gaussians):
    """What each of the coarser sizes loses."""
    patches = LitPatches(spec, mesh, maps, gaussians)
    return [patches.lost(share) for share in coarser_sizes(spec.texture.size)]


def speckled(contrast, seed=0):
    """Albedo with as much detail in every octave of a texture, row 0 at v = 1."""
    rng = np.random.default_rng(seed)
    frequency = np.fft.fftfreq(SIDE)
    radius = np.hypot(frequency[:, None], frequency)
    radius[0, 0] = np.inf
    noise = np.fft.ifft2(np.fft.fft2(rng.normal(size=(SIDE, SIDE))) / radius).real
    return np.repeat(0.5 * np.exp(contrast * noise / noise.std())[..., None], 3, axis=2).astype(np.float32)


def blurred(image, texel_mm, skin):
    """An image, periodic, blurred on its own lattice by discrete Gaussians, (H, W, 3)."""
    total = np.zeros(image.shape)
    for variance, weight in zip(skin.variance_mm2, skin.weight_rgb, strict=True):
        texels2 = variance / texel_mm**2
        far = int(6 * texels2**0.5) + 6
        taps = ive(np.abs(np.arange(-far, far + 1)), texels2)
        total += weight * convolve1d(convolve1d(image, taps, 0, float, "wrap"), taps, 1, float, "wrap")
    return total


def read_back(image, shape):
    """An image, periodic, read bilinearly at the texels of another size."""
    wide = np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="wrap")
    row, column = ((np.arange(n) + 0.5) * m / n + 0.5 for n, m in zip(shape[:2], image.shape[:2], strict=True))
    at = np.meshgrid(row, column, indexing="ij")
    return np.stack([map_coordinates(wide[..., k], at, order=1) for k in range(3)], axis=-1)


def brute_force(albedo, share, skin=SKIN):
    """Share of the light leaving that a texture of `share` of the size loses: M of both, texel by texel."""
    mm, count = MM / SIDE, int(SIDE * share)
    full = blurred(albedo, mm, skin)
    lost = full - read_back(blurred(shrink(albedo, (count, count)), mm / share, skin), full.shape)
    return np.sqrt(np.mean(lost**2) / np.mean(full**2))


def lost_by_an_edge(share, skin):
    """Square of what a millimetre of a straight edge of light loses, mm: along one axis, the mean over its places."""
    mm, side = MM / SIDE, 64
    across, squares = (np.arange(side) + 0.5)[None, :, None], []
    for off in np.arange(16) / 4:
        light = np.clip(across - 16 - off, 0, 1) - np.clip(across - 48 - off, 0, 1)  # two edges
        light = np.repeat(light, 3, axis=2)
        # Rows are all the same: they are averaged away from what a row is read back from
        coarse = np.repeat(shrink(np.repeat(light, side, axis=0), (int(side * share),) * 2)[:1], 1, axis=0)
        seen = read_back(blurred(coarse, mm / share, skin), (1, side))
        squares.append(np.mean((seen - blurred(light, mm, skin)) ** 2, axis=(0, 2)).sum() * mm / 2)
    return np.mean(squares)


@pytest.mark.parametrize("share", [0.5, 0.75])
def test_the_estimate_is_what_two_textures_differ_by(monkeypatch, share):
    """Ninety-six patches tell it to a tenth; edges of shadows come on top, as squares."""
    albedo, mesh = speckled(0.4), quad(MM, MM)
    maps = SkinMaps(albedo={1001: albedo})
    spec, at = look(texturing={"mode": "pre-scatter"}), (0.5, 0.75).index(share)
    edges, with_edges = (detail_lost(spec, mesh, each, SKIN)[at] for each in (SkinMaps(), maps))
    monkeypatch.setattr(texture_size, "EDGES_PER_MM", 0.0)
    found = detail_lost(spec, mesh, maps, SKIN)
    assert len(found) == 2  # a quarter would be below the smallest size
    assert found[at] == pytest.approx(brute_force(albedo, share), rel=0.1)
    assert with_edges == pytest.approx(np.hypot(found[at], edges), rel=1e-6)


@pytest.mark.parametrize("variance_mm2", [0.0016, 0.03, 0.3])
def test_edges_of_shadows_lose_what_the_lobes_show_of_them(variance_mm2):
    """From narrow lobes, where they lose a root of a texel, to wide ones, by the same EDGES_PER_MM."""
    skin = replace(SKIN, variance_mm2=np.array([variance_mm2]), weight_rgb=np.ones((1, 3)))
    for share, found in zip((0.5, 0.75), detail_lost(look(), quad(MM, MM), SkinMaps(), skin), strict=True):
        wanted = np.sqrt(EDGES_PER_MM * lost_by_an_edge(share, skin))
        assert found == pytest.approx(wanted, rel=SLANTED_EDGES)


def test_albedo_that_comes_after_scattering_loses_nothing():
    """It is read at its own size by whoever shows the bake; edges of shadows are all that is left."""
    maps, spec = SkinMaps(albedo={1001: speckled(0.4)}), look(texturing={"mode": "post-scatter"})
    found, edges = (detail_lost(spec, quad(MM, MM), each, SKIN)[0] for each in (maps, SkinMaps()))
    assert found == pytest.approx(edges, rel=1e-3)


def test_normals_count_alike_in_tangent_and_in_object_space():
    """On a flat square that faces +z the two are the same vectors."""
    rng = np.random.default_rng(3)
    normal = rng.normal(0, 0.2, (SIDE, SIDE, 3)).astype(np.float32)
    normal[..., 2] = 1
    found = [
        detail_lost(look(), quad(MM, MM), SkinMaps(normal={1001: normal}, normal_space=space), SKIN)[0]
        for space in ("tangent", "object")
    ]
    assert found[0] == pytest.approx(found[1], rel=0.02)
    assert found[0] > 0.02


def test_skin_that_varies_loses_what_its_own_lobes_show():
    """A map of one value loses what skin of these weights does; two halves lose the mean of both squares."""
    zero, wide, narrow = np.zeros((2, 1, 3)), [[0.0] * 3, [0.0] * 3, [1.0] * 3], [[1.0] * 3, [0.0] * 3, [0.0] * 3]
    weight = np.array([wide, narrow])[:, None]
    table = WeightTable(("melanin",), (np.array([0.0, 1.0]), np.zeros(1)), weight, zero, zero[:1], {"melanin": 0.5})
    varying = replace(SKIN, weight_rgb=weight.mean(axis=(0, 1)), table=table)
    albedo, halves = speckled(0.4), np.zeros((SIDE, SIDE), np.float32)
    halves[:, SIDE // 2 :] = 1
    uniform = [
        detail_lost(look(), quad(MM, MM), SkinMaps(albedo={1001: albedo}), replace(SKIN, weight_rgb=np.array(each)))[0]
        for each in (wide, narrow)
    ]
    for melanin, wanted, within in (
        (np.ones_like(halves), uniform[1], 1e-3),
        (halves, np.hypot(*uniform) / 2**0.5, 0.1),
    ):
        maps = SkinMaps(albedo={1001: albedo}, melanin={1001: melanin})
        assert detail_lost(look(), quad(MM, MM), maps, varying)[0] == pytest.approx(wanted, rel=within)
    assert uniform[1] > 2 * uniform[0]


def test_the_tolerance_decides():
    """The coarsest size within its part of the tolerance; what it loses is the decision's error."""
    mesh, maps = quad(MM, MM), SkinMaps(albedo={1001: speckled(0.4)})
    lost, less = detail_lost(look(), mesh, maps, SKIN)
    tolerances = (lost / (SHARE - 0.01), lost / (SHARE + 0.01), less / (SHARE + 0.01))
    above, between, below = (choose_size(look(tolerance), mesh, maps, SKIN) for tolerance in tolerances)
    assert [each.size for each in (above, between, below)] == [(512, 512), (768, 768), (1024, 1024)]
    assert [each.decision.enabled for each in (above, between, below)] == [False, False, True]
    assert "1024 x 1024 of 1024 x 1024: 768 x 768 loses" in below.decision.why
    assert between.decision.why.index("768 x 768 loses") < between.decision.why.index("512 x 512 loses")
    worked = at_size(look(lost / (SHARE - 0.01)), above)
    assert worked.texture.size == (512, 512)
    assert worked.diffusion == look(lost / (SHARE - 0.01)).diffusion
    assert (above.decision.error, below.decision.error) == (round(above.lost, 6), 0.0)
    assert at_size(look(less / (SHARE + 0.01)), below) == look(less / (SHARE + 0.01))


@pytest.mark.parametrize(
    ("tolerance", "texture"),
    [(0.01, {}), (0.5, {"reduce": "off"}), (0.5, {"size": [1022, 4096]}), (0.5, {"size": 1025})],
    ids=["the default", "off", "small", "odd"],
)
def test_what_is_asked_for_is_kept(tolerance, texture):
    """At the default tolerance and below, where it is said, and where no half is left."""
    spec = look(tolerance, texture=texture)
    assert not may_be_reduced(spec)
    assert choose_size(spec, quad(MM, MM), SkinMaps(), SKIN) == (spec.texture.size, 0.0, None)
