"""Decay of light from everywhere below faces of several forms, against closed forms and against walks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from skinbake.diffuse.terms.flesh_form import _groups, decay_below
from skinbake.diffuse.terms.flesh_sums import REACH, Elements, decay_at
from skinbake.io.mesh import read_mesh
from skinbake.profile.curved_skin import curved_gain, through_curved
from skinbake.profile.medium import Medium
from skinbake.profile.slab_transport import diffuse_mean, slab_transport
from skinbake.scene.lights import EnvironmentLight
from skinbake.scene.mesh import SkinMesh
from skinbake.transport.light_leaving import ESTIMATES, light_leaving
from skinbake.transport.medium import TransportMedium
from tests.shapes import joined, quad, sphere
from tests.transport.solids import rays_of

SKIN = Medium(np.array([0.032, 0.17, 0.48]), np.array([0.74, 0.88, 1.01]))
KAPPA = SKIN.sigma_tr_per_mm


def turned(mesh: SkinMesh, matrix, shift=(0.0, 0.0, 0.0)) -> SkinMesh:
    """A mesh turned and moved."""
    turn = np.asarray(matrix, np.float64)
    return SkinMesh(mesh.positions_mm @ turn.T + shift, mesh.faces, mesh.corner_uv, mesh.corner_normal @ turn.T)


def box(x_mm, y_mm, z_mm, step_mm=1.5) -> SkinMesh:
    """A closed box about the origin, its normals those of its faces."""
    sides = []
    for axis, (across, up, deep) in enumerate(((y_mm, z_mm, x_mm), (z_mm, x_mm, y_mm), (x_mm, y_mm, z_mm))):
        u, v, w = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3], np.eye(3)[axis]
        for sign in (1.0, -1.0):
            frame = np.stack([u, sign * v, sign * w], axis=1)
            columns, rows = max(2, round(across / step_mm)), max(2, round(up / step_mm))
            sides.append(turned(quad(across, up, 0.0, columns, rows), frame, sign * w * deep / 2))
    return joined(*sides)


def in_the_middle(mesh: SkinMesh, rate, z_mm, within_mm=2.0):
    """Mean rate at the vertices about the middle of the face at a height."""
    at = mesh.positions_mm
    mine = (np.abs(at[:, 2] - z_mm) < 1e-6) & (np.hypot(at[:, 0], at[:, 1]) < within_mm)
    return rate[mine].mean(axis=0)


@pytest.mark.parametrize("thick", [3.0, 6.0, 40.0])
def test_slabs(thick):
    """kappa tanh(kappa d / 2), as light that decays from both faces has it."""
    mesh = box(60.0, 60.0, thick)
    rate = in_the_middle(mesh, decay_below(mesh, KAPPA), thick / 2)
    np.testing.assert_allclose(rate, KAPPA * np.tanh(KAPPA * thick / 2), rtol=0.06)


@pytest.mark.parametrize("radius", [8.0, 20.0])
def test_balls(radius):
    """kappa coth(kappa r) - 1 / r, everywhere on it."""
    want = KAPPA / np.tanh(KAPPA * radius) - 1 / radius
    for segments, each, mean in ((48, 0.04, 0.02), (96, 0.025, 0.015)):  # facets are flat
        rate = decay_below(sphere(radius, "cube", segments), KAPPA)
        np.testing.assert_allclose(rate / want, 1, atol=each)
        np.testing.assert_allclose((rate.mean(axis=0) - want) / KAPPA, 0, atol=mean)


def test_planes_and_open_borders():
    """A plate is as half of space up to its open border, beyond which skin is taken to go on."""
    mesh = quad(80.0, 80.0, 0.0, columns=30, rows=30)
    want = np.broadcast_to(KAPPA, (len(mesh.positions_mm), 3))
    np.testing.assert_allclose(decay_below(mesh, KAPPA), want, rtol=1e-9)
    bowl = sphere(30.0, "cube", 48)
    upper = bowl.corner_position_mm[..., 2].min(axis=1) > -1e-3
    half = SkinMesh(bowl.positions_mm, bowl.faces[upper], bowl.corner_uv[upper], bowl.corner_normal[upper])
    rim = np.unique(half.faces)
    rim = rim[half.positions_mm[rim, 2] < 2.0]
    assert len(rim) > 10
    np.testing.assert_allclose(decay_below(half, KAPPA)[rim], decay_below(bowl, KAPPA)[rim], rtol=0.25)


def test_skin_that_is_turned_keeps_its_rates():
    """Which elements stand for which, and sources for which, goes by axes: no vertex of a head may tell."""
    path = Path(__file__).parents[2] / "data" / "head.obj"
    head = read_mesh(path, 1.0)
    quaternion = np.array([0.3, -0.5, 0.7, 0.2])
    matrix = Rotation.from_quat(quaternion).as_matrix()
    apart = np.abs(decay_below(turned(head, matrix), KAPPA) - decay_below(head, KAPPA)) / KAPPA
    assert apart.max() < 0.05
    np.testing.assert_array_less(np.sqrt((apart**2).mean(axis=0)), 0.003)


def test_skin_across_air_is_no_flesh():
    """Two thick plates with a gap of a millimetre are as each alone."""
    one, lower = box(40.0, 40.0, 20.0), box(40.0, 40.0, 20.0)
    both = joined(one, turned(lower, np.eye(3), (0.0, 0.0, 21.0)))
    alone, beside = decay_below(one, KAPPA), decay_below(both, KAPPA)[: len(one.positions_mm)]
    np.testing.assert_allclose(in_the_middle(one, beside, 10.0), in_the_middle(one, alone, 10.0), rtol=0.08)


@pytest.mark.parametrize("size", [(40.0, 40.0, 40.0), (40.0, 40.0, 6.0)])
def test_a_wedge_and_a_fin_shine_as_walks_in_them_say(size):
    """Next to an edge of a right angle, and at a fin's rim, a constant sky leaves the plane's light times the gain."""
    mesh = box(*size)
    centre = mesh.corner_position_mm.mean(axis=1)
    away = size[0] / 2 - np.abs(centre[:, 0])
    mine = (np.abs(centre[:, 2] - size[2] / 2) < 1e-6) & (away < 3.0) & (np.abs(centre[:, 1]) < 8.0)
    face = np.flatnonzero(mine).astype(np.int32)
    medium = TransportMedium(SKIN.sigma_a_per_mm, SKIN.sigma_sp_per_mm, 0.0, 1.4)
    sky = EnvironmentLight(type="environment", name="sky", radiance=(1 / np.pi,) * 3)
    found = light_leaving(rays_of(mesh), medium, [sky], face, np.full((len(face), 2), 1 / 3), 64, 3)
    walked = found.mean[ESTIMATES["whole"]][:, 0].mean(axis=0)
    plane = slab_transport(SKIN, 1.4, np.array([1.0]))
    rate = decay_below(mesh, KAPPA)[mesh.faces[face]].mean(axis=1)
    flat = diffuse_mean(plane.cosine, plane.back)
    shines = (flat * curved_gain(SKIN, 1.4, KAPPA - rate)).mean(axis=0)
    assert np.all(walked[:2] > 1.12 * flat[:2])
    np.testing.assert_allclose(shines[:2], walked[:2], rtol=0.13)


@pytest.mark.parametrize("thick", [3.0, 6.0])
def test_a_slab_shines_as_walks_say_with_what_comes_through_it(thick):
    """The gain, with transport's light from the other side in place of its own: that alone is a tenth too dark."""
    mesh = box(60.0, 60.0, thick)
    centre = mesh.corner_position_mm.mean(axis=1)
    middle = (np.abs(centre[:, 2] - thick / 2) < 1e-6) & (np.abs(centre[:, :2]).max(axis=1) < 6.0)
    face = np.flatnonzero(middle).astype(np.int32)
    medium = TransportMedium(SKIN.sigma_a_per_mm, SKIN.sigma_sp_per_mm, 0.0, 1.4)
    sky = EnvironmentLight(type="environment", name="sky", radiance=(1 / np.pi,) * 3)
    found = light_leaving(rays_of(mesh), medium, [sky], face, np.full((len(face), 2), 1 / 3), 96, 3)
    slab = slab_transport(SKIN, 1.4, np.array([thick]))
    flat, exact = diffuse_mean(slab.cosine, slab.back), diffuse_mean(slab.cosine, slab.through[0])
    walked = found.mean[ESTIMATES["hard"]][:, 0].mean(axis=0) / flat
    gain = curved_gain(SKIN, 1.4, (KAPPA * (1 - np.tanh(KAPPA * thick / 2)))[None])[0]
    whole = gain - through_curved(SKIN, 1.4, KAPPA, np.array([thick]))[0] + exact / flat
    np.testing.assert_allclose(whole[1:], walked[1:], rtol=0.03)
    np.testing.assert_allclose(whole[0], walked[0], rtol=0.08)  # two free paths are no diffusion
    if thick < 4:
        assert np.all(gain[1:] < 0.95 * walked[1:])


def test_sums_of_sixteen_at_a_time_are_those_of_each_alone():
    """Small faces all around, some beyond reach: of the kernel and of its slope, in float64 one after another."""
    rng = np.random.default_rng(3)
    way = rng.normal(size=(700, 3))
    middle = way / np.linalg.norm(way, axis=1, keepdims=True) * rng.uniform(2.0, 24.0, (700, 1))
    middle[0] = 0.0
    corner = 0.25 * rng.normal(size=(700, 3, 3))
    corner[0] *= 1e-7  # which the place itself is in the middle of
    corner += middle[:, None] - corner.mean(axis=1, keepdims=True)
    elements = Elements(corner, np.zeros(700), np.arange(700))
    groups = _groups(corner)
    groups.sought.reshape(4, -1)[3, 700 : groups.start[-1]] = 1e6  # no group of them is one source
    found = np.empty((1, 3))
    decay_at(0, 1, np.array([0]), elements, groups, KAPPA, found)

    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) / 2
    area, r = np.linalg.norm(across, axis=1)[1:], np.linalg.norm(middle[1:], axis=1)
    spread = ((corner - middle[:, None]) ** 2).sum(axis=(1, 2))[1:] / 24
    along = (across[1:] * middle[1:]).sum(axis=1) / r
    value, slope = np.zeros(3), np.zeros(3)
    for c, kappa in enumerate(KAPPA):
        screened = np.where(kappa * r <= REACH, np.exp(-kappa * r) / r, 0.0)
        value[c] = (area * screened * (1 + spread / 2 * (kappa**2 + (kappa + 1 / r) / r))).sum()
        slope[c] = -(along * screened * (kappa + 1 / r)).sum()
    assert np.count_nonzero(KAPPA.min() * r > REACH) > 50
    assert value[0] > 1
    want = (2 * np.pi + slope) / (value + 2 * np.pi * np.exp(-REACH) / KAPPA)
    np.testing.assert_allclose(found[0], want, rtol=1e-4)
