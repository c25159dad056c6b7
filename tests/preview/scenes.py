"""Small scenes with everything in them."""

from dataclasses import replace

import numpy as np

from skinbake.preview.scene import PreviewLobe, PreviewScene
from skinbake.profile.weight_table import WeightTable, even_nodes
from skinbake.scene.lights import DirectionalLight, EnvironmentLight, PointLight, RectangleLight, SpotLight
from skinbake.scene.maps import SkinMaps
from skinbake.scene.spec import SpecularSpec, TexturingSpec
from tests.shapes import sphere

LIGHTS = (
    DirectionalLight(name="key", type="directional", direction=(-0.6, -0.5, -0.7), irradiance=(3.0, 2.8, 2.5)),
    PointLight(name="lamp", type="point", position_mm=(-200.0, 80.0, 150.0), intensity=(4e4, 5e4, 6e4)),
    SpotLight(
        name="spot",
        type="spot",
        position_mm=(0.0, 300.0, 200.0),
        intensity=(2e5,) * 3,
        axis=(0, -3, -2),
        inner_deg=5,
        outer_deg=14,
    ),
    RectangleLight(
        name="box",
        type="rectangle",
        position_mm=(250.0, 0.0, 100.0),
        edge_u_mm=(60, 0, -150),
        edge_v_mm=(0, 90, 0),
        radiance=(8, 9, 9),
    ),
    EnvironmentLight(name="sky", type="environment", radiance=(0.2, 0.3, 0.4)),
)


def smooth_noise(rng, shape, low=0.1, high=1.0):
    """Random but differentiable, so that a texture's filter cannot hide behind noise."""
    *front, h, w, k = shape
    y, x = np.meshgrid(np.linspace(0, 1, h), np.linspace(0, 1, w), indexing="ij")
    phase, turns = rng.uniform(0, 6.28, (*front, 1, 1, k)), rng.uniform(1, 9, (*front, 1, 1, k))
    wave = np.sin(turns * (3 * x + 2 * y)[..., None] + phase)
    return (low + (high - low) * (0.5 + 0.5 * wave)).astype(np.float32)


def scene(tiles=1, half=True, with_maps=True, **changes) -> PreviewScene:
    """A sphere of 90 mm with six lobes of different sizes, five kinds of light and, if wanted, every map."""
    rng = np.random.default_rng(3)
    dtype = np.float16 if half else np.float32
    numbers = [1001, 1002][:tiles]
    n = len(LIGHTS)
    lobes = []
    for i in range(6):
        size = (57 >> i // 2, 83 >> i // 2)
        weight = tuple(float(w) for w in rng.uniform(0.05, 0.3, 3))
        lobes.append(
            PreviewLobe({t: smooth_noise(rng, (n, *size, 3)).astype(dtype) for t in numbers}, weight, 0.01 * 3.0**i)
        )
    maps = SkinMaps(albedo_rgb=(0.8, 0.5, 0.4))
    if with_maps:
        normal = {t: smooth_noise(rng, (41, 37, 3), -0.3, 0.3) + np.array([0, 0, 0.9], np.float32) for t in numbers}
        maps = SkinMaps(
            albedo={t: smooth_noise(rng, (31, 45, 3)) for t in numbers},
            normal=normal,
            normal_strength=0.7,
            roughness={t: smooth_noise(rng, (20, 33, 1), 0.2, 0.6)[..., 0] for t in numbers},
            specular={t: smooth_noise(rng, (23, 21, 1), 0.3, 1.0)[..., 0] for t in numbers},
        )
    whole = PreviewScene(
        sphere(90.0, "latlong", 40, tiles=tiles),
        LIGHTS,
        tuple(lobes),
        {t: smooth_noise(rng, (n, 57, 83, 3)).astype(dtype) for t in numbers},
        {t: smooth_noise(rng, (n, 57, 83, 1), 0.0, 1.0)[..., 0].astype(dtype) for t in numbers},
        maps,
        TexturingSpec(mode="mix", mix=0.4),
        SpecularSpec(f0=0.03, roughness=0.35, strength=0.3),
        energy_conservation=True,
    )
    return replace(whole, **changes)


def varying_scene(names=("radius",), scatters=True, **changes) -> PreviewScene:
    """The same with light through thin parts, and weights that maps of radius, or of two quantities, vary."""
    rng = np.random.default_rng(4)
    whole = scene(**changes)
    lobes = (*whole.lobes[:-1], replace(whole.lobes[-1], variance_mm2=None))
    nodes = (even_nodes(0.5, 1.5, 9), even_nodes(0.002, 0.03, 4) if len(names) == 2 else np.zeros(1))
    weight = rng.uniform(0.02, 0.3, (len(nodes[0]), len(nodes[1]), len(lobes) - 1, 3))
    zero = np.zeros((*weight.shape[:2], 3))
    table = WeightTable(names, nodes, weight, zero, zero, dict.fromkeys((*names, "scatter"), 0.6), scatters)
    ranges = {names[0]: (0.4, 1.6), "scatter": (0.0, 1.0)} | ({names[1]: (0.002, 0.04)} if len(names) == 2 else {})
    shapes = {name: (17 + 3 * i, 23) for i, name in enumerate(ranges)}
    maps = {
        name: {t: smooth_noise(rng, (*shapes[name], 1), *ranges[name])[..., 0] for t in whole.tiles[:1]}
        for name in ranges
    }
    return replace(whole, lobes=lobes, table=table, maps=replace(whole.maps, **maps))
