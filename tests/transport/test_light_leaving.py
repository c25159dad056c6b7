"""Walks against closed forms and against walks that go the other way."""

import math

import numpy as np
import pytest
from numba import njit

from skinbake.profile.chandrasekhar import half_space_diffuse_reflectance, half_space_reflectance
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.slab_transport import slab_transport
from skinbake.profile.transport import trace_layers
from skinbake.scene.lights import DirectionalLight, EnvironmentLight, PointLight, RectangleLight
from skinbake.transport.light_leaving import ESTIMATES, light_leaving
from skinbake.transport.medium import TransportMedium
from tests.oil_brdf import fresnel_dielectric
from tests.shapes import joined, sphere
from tests.transport.solids import box, on_top, rays_of

SKIN = np.array([0.032, 0.17, 0.48]), np.array([0.74, 0.88, 1.01])
COSINES = 1.0, 0.5, 0.1
HARD, THROUGH, WHOLE = (ESTIMATES[name] for name in ("hard", "through", "whole"))


def sun(mu=1.0, name="sun", irradiance=1.0):
    """Light that falls at a cosine onto what faces +z."""
    direction = (math.sqrt(1 - mu * mu), 0.0, -mu)
    return DirectionalLight(type="directional", name=name, direction=direction, irradiance=(irradiance,) * 3)


def sky(radiance=1 / math.pi):
    return EnvironmentLight(type="environment", name="sky", radiance=(radiance,) * 3)


def pooled(found, estimate):
    """Mean over the points, and its standard error."""
    mean, stderr = found.mean[estimate], found.stderr[estimate]
    return mean.mean(axis=0), np.sqrt((stderr**2).sum(axis=0)) / len(mean)


def agree(got, stderr, want, most=3.5, floor=0.0, precise=0.03):
    """Whether all lie within `most` standard errors, which are small themselves."""
    assert np.all(stderr < precise * np.abs(want) + floor), (stderr, want)
    deviation = (got - want) / stderr
    assert np.all(np.abs(deviation) < most), deviation


@pytest.mark.slow
def test_a_half_space_reflects_what_chandrasekhar_says():
    """R(mu) at three cosines and of a sky, for the three albedos of skin, equal indices."""
    mesh = box([-300, -300, -300], [300, 300, 0])
    face, place = on_top(mesh, np.zeros(4), np.full(4, 20.0))
    lights = [*(sun(mu, f"s{i}", 1 / mu) for i, mu in enumerate(COSINES)), sky()]
    found = light_leaving(rays_of(mesh), TransportMedium(*SKIN), lights, face, place, 480, 5)
    albedo = SKIN[1] / (SKIN[0] + SKIN[1])
    want = np.stack([*(half_space_reflectance(mu, albedo) for mu in COSINES), half_space_diffuse_reflectance(albedo)])
    for estimate in (HARD, THROUGH, WHOLE):
        agree(*pooled(found, estimate), want)


def test_a_face_that_refracts_gives_the_totals_of_the_layered_walks():
    """eta = 1.4, light counted once it has entered: the same as photons that go the other way (normal incidence)."""
    mesh = box([-300, -300, -300], [300, 300, 0])
    face, place = on_top(mesh, np.zeros(4), np.full(4, 20.0))
    found = light_leaving(rays_of(mesh), TransportMedium(*SKIN, 0.0, 1.4), [sun()], face, place, 480, 7)
    photons = trace_layers([Layer(Medium(*SKIN), np.inf, 1.4)], 150_000)
    got, stderr = pooled(found, WHOLE)
    agree(got, np.hypot(stderr, photons.total_stderr), photons.total_reflectance[None])


@pytest.mark.parametrize("eta", [1.0, 1.4])
def test_what_comes_through_a_plate_is_what_doubling_says(eta):
    """On the side that no light reaches, where the sun enters by a face that looks the other way."""
    mesh = box([-40, -40, -3], [40, 40, 0])
    face, place = np.full(8, 8, np.int32), np.full((8, 2), 1 / 3)
    assert np.all(mesh.corner_position_mm[8, :, 2] == -3)
    plate = slab_transport(Medium(*SKIN), eta, np.array([3.0]))
    mu = plate.cosine[[len(plate.cosine) // 2, -1]]
    lights = [sun(cosine, f"s{i}", 1 / cosine) for i, cosine in enumerate(mu)]
    found = light_leaving(rays_of(mesh), TransportMedium(*SKIN, 0.0, eta), lights, face, place, 480, 5)
    agree(*pooled(found, WHOLE), plate.through[0, [len(plate.cosine) // 2, -1]], precise=0.06)


@pytest.mark.slow
def test_forward_scattering_gives_the_totals_of_the_layered_walks():
    """Henyey-Greenstein with g = 0.8 and an index ratio: phase function in the walk and towards the light."""
    mesh = box([-200, -200, -200], [200, 200, 0])
    face, place = on_top(mesh, np.zeros(4), np.full(4, 20.0))
    medium = TransportMedium(SKIN[0], SKIN[1] / 0.2, 0.8, 1.3)
    found = light_leaving(rays_of(mesh), medium, [sun()], face, place, 960, 11)
    photons = trace_layers([Layer(Medium(*SKIN), np.inf, 1.3, 0.8)], 60_000)
    got, stderr = pooled(found, HARD)
    agree(got, np.hypot(stderr, photons.total_stderr), photons.total_reflectance[None], precise=0.05)


def test_a_shadow_edge_on_a_slab_is_the_integral_of_its_profile():
    """A slab of 3 mm, half of it in the hard shadow of another block: M across the edge from R(r) of photons."""
    slab = box([-60, -60, -3], [60, 60, 0])
    mesh = joined(slab, box([-60, -60, 5], [0, 60, 8]))
    at = np.array([-3.0, -1.0, -0.3, 0.3, 1.0, 3.0])
    face, place = on_top(slab, at, np.full(6, 7.0))
    found = light_leaving(rays_of(mesh), TransportMedium(*SKIN), [sun()], face, place, 2400, 1)
    photons = trace_layers([Layer(Medium(*SKIN), 3.0, 1.0)], 400_000)
    radius = np.geomspace(1e-3, 60, 4000)
    ring = photons.reflectance(radius) * (2 * np.pi * radius * np.gradient(radius))[:, None]
    ring *= photons.total_reflectance / ring.sum(axis=0)
    # Share of each ring about x that is lit, x' > 0
    lit = np.arccos(np.clip(-at[:, None] / radius, -1, 1)) / np.pi
    want = lit @ ring
    got, stderr = found.mean[HARD][:, 0], found.stderr[HARD][:, 0]
    agree(got, np.hypot(stderr, 0.006 * want), want, floor=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("eta", [1.0, 1.4])
def test_a_ball_of_20_mm_shines_as_photons_that_go_the_other_way_say(eta):
    """A sun on a ball: mean light that leaves each of six zones, from the lit pole to the dark side."""
    mesh = sphere(20.0, "cube", 96)
    edge = np.linspace(1, -1, 7)
    rng = np.random.default_rng(3)
    cosine = mesh.corner_position_mm.mean(axis=1)[:, 2] / np.linalg.norm(mesh.corner_position_mm.mean(axis=1), axis=1)
    area = mesh.face_area_mm2
    face, zone = [], []
    for k in range(6):
        inside = np.flatnonzero((cosine < edge[k]) & (cosine >= edge[k + 1]))
        face.append(rng.choice(inside, 16, p=area[inside] / area[inside].sum()))
        zone += [k] * 16
    face, zone = np.concatenate(face).astype(np.int32), np.array(zone)
    place = np.full((len(face), 2), 1 / 3)
    found = light_leaving(rays_of(mesh), TransportMedium(*SKIN, 0.0, eta), [sun()], face, place, 64, 2)
    for channel in range(3):
        sigma_a, sigma_s = SKIN[0][channel], SKIN[1][channel]
        counted = _ball(np.random.default_rng(channel), 200_000, 20.0, sigma_a, sigma_s, eta)
        # Flux of a unit sun is pi r^2; each zone has the area 4 pi r^2 / 6
        want = counted / 200_000 * (np.pi * 20**2) / (4 * np.pi * 20**2 / 6)
        for k in range(6):
            mine = found.mean[WHOLE][zone == k, 0, channel]
            stderr = np.hypot(mine.std(ddof=1) / math.sqrt(len(mine)), 0.01 * want[k])  # spread over the zone as well
            assert abs(mine.mean() - want[k]) < 3.5 * stderr + 6e-4, (channel, k, mine.mean(), want[k])


@njit
def _ball(rng, photons, radius, sigma_a, sigma_s, eta):
    """Weight that leaves each of six zones of a ball under parallel light along -z that all enters, by photons."""
    out = np.zeros(6)
    sigma_t = sigma_a + sigma_s
    for _ in range(photons):
        r, angle = math.sqrt(rng.random()), 2 * math.pi * rng.random()
        nx, ny = r * math.cos(angle), r * math.sin(angle)
        nz = math.sqrt(max(0.0, 1 - r * r))
        x, y, z = radius * nx, radius * ny, radius * nz
        cos_in = math.sqrt(1 - (1 - nz * nz) / eta**2)
        turn = nz / eta - cos_in
        ux, uy, uz = turn * nx, turn * ny, -1 / eta + turn * nz
        weight, scattered = 1.0, False
        while weight > 0:
            length = -math.log(1 - rng.random()) / sigma_t
            while True:
                b = x * ux + y * uy + z * uz
                c = x * x + y * y + z * z - radius * radius
                to_face = -b + math.sqrt(max(0.0, b * b - c))
                if to_face > length:
                    break
                length -= to_face
                x, y, z = x + to_face * ux, y + to_face * uy, z + to_face * uz
                nx, ny, nz = x / radius, y / radius, z / radius
                cos_in = nx * ux + ny * uy + nz * uz
                sin2 = eta * eta * (1 - cos_in * cos_in)
                back = 1.0
                if sin2 < 1:
                    cos_out = math.sqrt(1 - sin2)
                    s = (eta * cos_in - cos_out) / (eta * cos_in + cos_out)
                    p = (eta * cos_out - cos_in) / (eta * cos_out + cos_in)
                    back = 0.5 * (s * s + p * p)
                if rng.random() >= back:
                    if scattered:
                        out[min(5, int((1 - nz) * 3))] += weight
                    weight = 0.0
                    break
                ux, uy, uz = ux - 2 * cos_in * nx, uy - 2 * cos_in * ny, uz - 2 * cos_in * nz
            if weight == 0.0:
                break
            x, y, z = x + length * ux, y + length * uy, z + length * uz
            weight *= sigma_s / sigma_t
            scattered = True
            if weight < 1e-3:
                weight = weight * 10 if rng.random() < 0.1 else 0.0
            uz = 2 * rng.random() - 1
            angle = 2 * math.pi * rng.random()
            across = math.sqrt(1 - uz * uz)
            ux, uy = across * math.cos(angle), across * math.sin(angle)
    return out


@pytest.mark.parametrize("eta", [1.0, 1.4])
def test_nothing_shines_brighter_than_what_arrives(eta):
    """In a white furnace skin that hardly absorbs gives back what enters and no more; a pit between blocks as well."""
    mesh = joined(
        box([-30, -10, -20], [-4, 10, 20]), box([4, -10, -20], [30, 10, 20]), box([-30, -10, -40], [30, 10, -21])
    )
    medium = TransportMedium(np.full(3, 1e-7), np.array([0.5, 2.0, 8.0]), 0.0, eta)
    cosine = np.linspace(0, 1, 257)
    enters = 1 - fresnel_dielectric(cosine, eta) if eta > 1 else np.ones(257)
    face, place = on_top(box([-30, -10, -20], [-4, 10, 20]), np.linspace(-25, -5, 8), np.zeros(8))
    face = np.concatenate([face, np.full(8, 2, np.int32)])  # the side that faces the other block
    place = np.concatenate([place, np.full((8, 2), 0.3)])
    found = light_leaving(rays_of(mesh), medium, [sky()], face, place, 160, 4, share=enters)
    arrives = 2 * np.trapezoid(enters * cosine, cosine)
    got, stderr = found.mean[WHOLE][:, 0], found.stderr[WHOLE][:, 0]
    assert np.all(got < arrives + 3.5 * stderr)
    # What came straight through unscattered is not counted: next to nothing at 8 per mm. Between the blocks, light that
    # their faces throw to and fro as mirrors is not followed
    whole = got[:8, 2] if eta > 1 else got[:, 2]
    noise = np.sqrt((stderr[: len(whole), 2] ** 2).mean() / len(whole))
    assert abs(whole.mean() - arrives) < 3.5 * noise + 0.004


def test_estimates_are_in_order_and_skin_lights_skin():
    """Hard shadows give the least, all of transport the most; between two blocks the difference is large."""
    mesh = joined(box([-30, -30, -20], [-2, 30, 20]), box([2, -30, -20], [30, 30, 20]))
    face, place = np.full(4, 2, np.int32), np.full((4, 2), 0.3)
    found = light_leaving(rays_of(mesh), TransportMedium(*SKIN), [sky()], face, place, 320, 4)
    hard, through, whole = (found.mean[e].sum() for e in (HARD, THROUGH, WHOLE))
    assert hard <= through <= whole
    assert whole > 1.1 * hard


def test_the_same_numbers_on_any_threads_and_cut_anywhere():
    """Points keep their walks, bit for bit, whoever computes them and with whom."""
    mesh = sphere(20.0, "cube", 24)
    surface, medium = rays_of(mesh), TransportMedium(*SKIN, 0.3, 1.3)
    lights = [
        sun(0.6),
        sky(),
        PointLight(type="point", name="p", position_mm=(0.0, 0.0, 60.0), intensity=(9.0, 9.0, 9.0)),
        RectangleLight(
            type="rectangle", name="r", position_mm=(0.0, 0.0, 60.0), edge_u_mm=(20.0, 0.0, 0.0),
            edge_v_mm=(0.0, 20.0, 0.0), radiance=(1.0, 1.0, 1.0),
        ),
    ]  # fmt: skip
    face, place = np.arange(0, 60, 10, dtype=np.int32), np.full((6, 2), 0.3)
    whole = light_leaving(surface, medium, lights, face, place, 32, 9, threads=1)
    many = light_leaving(surface, medium, lights, face, place, 32, 9, threads=3)
    late = light_leaving(surface, medium, lights, face[4:], place[4:], 32, 9, first=4)
    assert np.array_equal(whole.mean, many.mean)
    assert np.array_equal(whole.stderr, many.stderr)
    assert np.array_equal(whole.mean[:, 4:], late.mean)
    other = light_leaving(surface, medium, lights, face, place, 32, 10)
    assert not np.array_equal(whole.mean, other.mean)


def test_lamps_give_what_suns_of_the_same_irradiance_give():
    """A far point, and a far rectangle, against a directional light."""
    mesh = box([-100, -100, -100], [100, 100, 0])
    face, place = on_top(mesh, np.zeros(8), np.full(8, 20.0))
    far = 1e5
    lights = [
        sun(),
        PointLight(type="point", name="p", position_mm=(0.0, 20.0, far), intensity=(far**2,) * 3),
        RectangleLight(
            type="rectangle", name="r", position_mm=(0.0, 20.0, far), edge_u_mm=(0.0, 100.0, 0.0),
            edge_v_mm=(100.0, 0.0, 0.0), radiance=(far**2 / 1e4,) * 3,
        ),
    ]  # fmt: skip
    found = light_leaving(rays_of(mesh), TransportMedium(*SKIN, 0.0, 1.4), lights, face, place, 64)
    np.testing.assert_allclose(found.mean[WHOLE][:, 1:], found.mean[WHOLE][:, :1].repeat(2, axis=1), rtol=2e-3)


def test_an_environment_map_is_looked_up_where_its_light_comes_from():
    """A map that is bright above only lights the top as a sky of that half would, whatever its rotation."""
    mesh = box([-100, -100, -100], [100, 100, 0])
    face, place = on_top(mesh, np.zeros(8), np.full(8, 20.0))
    # The top faces +z: u = 0.5; bright on the half of the sphere about it
    u = (np.arange(64) + 0.5) / 64
    image = np.zeros((32, 64, 3), np.float32)
    image[:, np.abs(u - 0.5) < 0.25] = 1 / math.pi
    lights = [sky(), EnvironmentLight(type="environment", name="map", path="x", rotate_deg=0.0)]
    found = light_leaving(rays_of(mesh), TransportMedium(*SKIN), lights, face, place, 160, environments={"map": image})
    np.testing.assert_allclose(found.mean[WHOLE][:, 1], found.mean[WHOLE][:, 0], rtol=1e-6)
    turned = [EnvironmentLight(type="environment", name="map", path="x", rotate_deg=180.0)]
    dark = light_leaving(rays_of(mesh), TransportMedium(*SKIN), turned, face, place, 160, environments={"map": image})
    assert dark.mean[WHOLE].max() == 0


def test_no_walks_are_refused():
    """A count below 1 is an error, not an empty mean."""
    mesh = sphere(20.0, "cube", 24)
    with pytest.raises(ValueError, match="walks"):
        light_leaving(rays_of(mesh), TransportMedium(*SKIN), [sun()], np.zeros(1, np.int32), np.full((1, 2), 0.3), 0)
