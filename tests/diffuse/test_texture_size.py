"""The size to work at: what a coarser texture loses is what brute force says, and the tolerance decides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from skinbake.diffuse.planning import texture_size
from skinbake.diffuse.planning.texture_size import SHARE, at_size, choose_size, detail_lost, may_be_reduced
from skinbake.io.config import parse_scene
from skinbake.profile import GaussianSum
from skinbake.profile.weight_table import WeightTable
from skinbake.scene.maps import SkinMaps
from tests.shapes import quad

SIDE, MM = 1024, 200.0
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


def speckled(contrast, seed=0):
    """Albedo with as much detail in every octave of a texture, row 0 at v = 1."""
    rng = np.random.default_rng(seed)
    frequency = np.fft.fftfreq(SIDE)
    radius = np.hypot(frequency[:, None], frequency)
    radius[0, 0] = np.inf
    noise = np.fft.ifft2(np.fft.fft2(rng.normal(size=(SIDE, SIDE))) / radius).real
    return np.repeat(0.5 * np.exp(contrast * noise / noise.std())[..., None], 3, axis=2).astype(np.float32)


def brute_force(albedo, side):
    """Share of the blurred light that a texture of `side` times wider texels loses: M of both, texel by texel."""
    count = SIDE // side
    means = albedo.reshape(count, side, count, side, 3).mean(axis=(1, 3))
    wide = np.pad(means, ((1, 1), (1, 1), (0, 0)), mode="wrap")
    place = (np.arange(SIDE) + 0.5) / side + 0.5
    low = place.astype(int)
    share = (place - low)[:, None, None]
    rows = wide[low] * (1 - share) + wide[low + 1] * share
    share = share.transpose(1, 0, 2)
    back = rows[:, low] * (1 - share) + rows[:, low + 1] * share
    frequency = 2 * np.pi * np.fft.fftfreq(SIDE) * SIDE / MM  # per mm
    squared = frequency[:, None] ** 2 + frequency**2
    passed = sum(
        w * np.exp(-0.5 * v * squared)[..., None] for v, w in zip(SKIN.variance_mm2, SKIN.weight_rgb, strict=True)
    )
    full, lost = (np.fft.ifft2(np.fft.fft2(x, axes=(0, 1)) * passed, axes=(0, 1)).real for x in (albedo, albedo - back))
    return np.sqrt(np.mean(lost**2) / np.mean(full**2))


def test_the_estimate_is_what_two_textures_differ_by(monkeypatch):
    """Ninety-six patches tell it to a tenth; edges of light come on top, as squares."""
    albedo, mesh = speckled(0.4), quad(MM, MM)
    maps = SkinMaps(albedo={1001: albedo})
    spec = look(texturing={"mode": "pre-scatter"})
    with_edges = detail_lost(spec, mesh, maps, SKIN)
    monkeypatch.setattr(texture_size, "EDGES_PER_MM", 0.0)
    found = detail_lost(spec, mesh, maps, SKIN)
    assert len(found) == 1  # a quarter would be below the smallest size
    assert found[0] == pytest.approx(brute_force(albedo, 2), rel=0.1)
    edges = 0.012 * 2 * MM / SIDE
    assert with_edges[0] == pytest.approx(np.hypot(found[0], edges), rel=1e-6)


def test_albedo_that_comes_after_scattering_loses_nothing():
    """It is read at its own size by whoever shows the bake; edges of light are all that is left."""
    maps = SkinMaps(albedo={1001: speckled(0.4)})
    (found,) = detail_lost(look(texturing={"mode": "post-scatter"}), quad(MM, MM), maps, SKIN)
    assert found == pytest.approx(0.012 * 2 * MM / SIDE, rel=1e-3)


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
    (lost,) = detail_lost(look(), mesh, maps, SKIN)
    above, below = (choose_size(look(t), mesh, maps, SKIN) for t in (lost / (SHARE - 0.01), lost / (SHARE + 0.01)))
    assert above.size == (512, 512)
    assert below.size == (1024, 1024)
    assert not above.decision.enabled
    assert below.decision.enabled
    assert "1024 x 1024 of 1024 x 1024: 512 x 512 loses" in below.decision.why
    worked = at_size(look(lost / (SHARE - 0.01)), above)
    assert worked.texture.size == (512, 512)
    assert worked.diffusion == look(lost / (SHARE - 0.01)).diffusion
    assert (above.decision.error, below.decision.error) == (round(above.lost, 6), 0.0)
    assert at_size(look(lost / (SHARE + 0.01)), below) == look(lost / (SHARE + 0.01))


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
