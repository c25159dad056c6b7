"""Nothing stale looks fresh: whatever key or file changes, a bake over the old folder and one from the cache give what
a fresh bake gives, byte by byte.

Every key of the schema is changed here, or stands in `NO_BYTES` with the reason why it changes none.
"""

from __future__ import annotations

import copy
import shutil
import typing
from contextlib import suppress
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import yaml
from pydantic import BaseModel

from skinbake.baking.bake_look import bake_look
from skinbake.baking.session import BakeSession
from skinbake.diffuse.terms.slab_weights import slab_weights
from skinbake.errors import ToleranceMissedError
from skinbake.io.config import load_look
from skinbake.io.exr import Part, rgb_channels, write_parts
from skinbake.io.png import write_png
from skinbake.preview.setup_gl import renderer_name
from skinbake.profile import fit_skin
from skinbake.relight.unseen_lights import unseen_lights
from skinbake.scene.spec import SceneSpec
from tests.cli.test_faults import contents
from tests.gltf_files import Gltf, vertices_of
from tests.shapes import quad, relief

NO_BYTES = {
    "mesh.path": "the file's content counts, not its place",
    "occluders.path": "as mesh.path",
    "occluders.opacity": "as mesh.path",
    "maps.albedo.path": "as mesh.path",
    "maps.normal.path": "as mesh.path",
    "maps.roughness.path": "as mesh.path",
    "maps.specular.path": "as mesh.path",
    "maps.height.path": "as mesh.path",
    "maps.detail.path": "as mesh.path",
    "maps.cavity.path": "as mesh.path",
    "maps.f0.path": "as mesh.path",
    "maps.scatter.path": "as mesh.path",
    "maps.radius.path": "as mesh.path",
    "maps.melanin.path": "as mesh.path",
    "maps.haemoglobin.path": "as mesh.path",
    "skin[table].path": "as mesh.path",
    "lights[environment].path": "as mesh.path",
    "output.dir": "where it is written",
    "output.export": "what is written of the bake: tests/export/test_after_bake.py changes it",
    "mesh.any_size": "whether a look is refused",
    "mesh.time": "only a USD stage has one: tests/io/mesh/test_usd.py changes it",
    "occluders.time": "as mesh.time",
    "frames": "a look of many frames is baked as many looks of one",
    "skin[gaussians].model": "the other models are bases of their own",
    "skin[multipole].model": "as skin[gaussians].model",
    "skin[dipole].model": "as skin[gaussians].model",
    "skin[burley].model": "as skin[gaussians].model",
    "skin[table].model": "as skin[gaussians].model",
    "skin[transport].model": "as skin[gaussians].model",
    "skin[physiology].model": "as skin[gaussians].model",
    "lights[directional].type": "the other kinds are lights of their own",
    "lights[point].type": "as lights[directional].type",
    "lights[spot].type": "as lights[directional].type",
    "lights[rectangle].type": "as lights[directional].type",
    "lights[environment].type": "as lights[directional].type",
}

KEY = {"name": "key", "type": "directional", "direction": [-0.6, 0.1, -0.8], "irradiance": [1, 2, 3]}
POINT = {"name": "lamp", "type": "point", "position_mm": [10, 20, 60], "intensity": [900, 800, 700]}
SPOT = POINT | {"type": "spot", "axis": [-0.1, -0.3, -1], "inner_deg": 10, "outer_deg": 25}
PANEL = {
    "name": "panel", "type": "rectangle", "position_mm": [0, 30, 50], "edge_u_mm": [30, 0, 0],
    "edge_v_mm": [0, -20, 20], "radiance": [1, 2, 1], "samples": 8,
}  # fmt: skip
SKY = {"name": "sky", "type": "environment", "path": "sky.exr", "samples": 16}
PLAIN = {
    "mesh": {"path": "head.obj", "unit": "mm", "any_size": True},
    "texture": {"size": [16, 14], "gutter": 2},
    "skin": {"model": "gaussians", "variance_mm2": [4.0, 60.0], "weight_rgb": [[0.5, 0.6, 0.7], [0.5, 0.4, 0.3]]},
    "lights": [KEY],
    "diffusion": {"method": "surface", "tolerance": 0.5, "probes": 20},
    "terms": {
        name: "off"
        for name in (
            "energy_conservation",
            "incidence",
            "beam",
            "curvature",
            "interreflection",
            "diffuse_profile",
            "transmission",
        )
    },
    "output": {"dir": "out"},
}
LAYER = {"sigma_a_per_mm": [0.1, 0.2, 0.3], "sigma_sp_per_mm": [2.0, 2.5, 3.0], "thickness_mm": 0.3, "g": 0.1}
DEEP = LAYER | {"thickness_mm": float("inf")}
MEDIUM = {"model": "dipole", "sigma_a_per_mm": [0.1, 0.2, 0.3], "sigma_sp_per_mm": [2, 3, 4], "eta": 1.0}


def plain(**parts):
    return copy.deepcopy(PLAIN) | parts


CAMERA = {"preview.camera.target_mm": [0, 3, 0], "preview.camera.distance_mm": 80.0}
BASES = {
    "head": plain(
        skin=PLAIN["skin"] | {"fit": {"gaussians": 2}},  # for the map of radii all are fitted
        mesh=PLAIN["mesh"] | {"cast": ["Eye"], "ignore": ["Lash"]},
        maps={
            "albedo": {"path": "albedo.exr", "layer": "one"}, "normal": {"path": "normal.exr", "layer": "one"},
            "roughness": {"path": "rough.exr", "channel": "r", "layer": "one"},
            "specular": {"path": "rough.exr", "channel": "g", "layer": "one"},
            "height": {"path": "rough.exr", "channel": "b", "scale_mm": 1.0, "layer": "one"},
            "detail": {"path": "normal.exr", "repeat": 2, "layer": "one"},
            "cavity": {"path": "rough.exr", "channel": "b", "layer": "one"},
            "f0": {"path": "rough.exr", "channel": "r", "layer": "one", "scale": 0.1},
            "scatter": {"path": "rough.exr", "channel": "g", "layer": "one"},
            "radius": {"path": "rough.exr", "channel": "r", "layer": "one", "scale": 2.0},
        },
        terms=PLAIN["terms"] | {"energy_conservation": "on"},
        specular={"second": {"roughness": 0.2, "mix": 0.3}},
    ),
    "hat": plain(occluders=[{"path": "hat.obj", "unit": "mm", "opacity": "alpha.png"}]),
    "cards": plain(mesh=PLAIN["mesh"] | {"cast": ["Eye"], "opacity": "alpha.png"}),
    "hat.gltf": plain(occluders=[{"path": "two.gltf", "unit": "mm", "opacity": "alpha.png"}]),
    "gltf": plain(mesh={"path": "two.gltf", "unit": "mm", "any_size": True, "uv_set": 0}, maps={"source": "file"}),
    "unwrapped": plain(texture=PLAIN["texture"] | {"unwrap": "xatlas"}),
    "tiles": plain(mesh=PLAIN["mesh"] | {"path": "tiles.obj"}, texture=PLAIN["texture"] | {"udim": True},
                   maps={"albedo": "tile.<UDIM>.exr"}),
    "lights": plain(lights=[KEY, POINT, PANEL, SKY]),
    "spot": plain(lights=[SPOT]),
    "constant sky": plain(lights=[{"name": "sky", "type": "environment", "radiance": [1, 2, 3], "samples": 16}]),
    "auto": plain(diffusion={"method": "auto", "tolerance": 0.1, "probes": 20}, terms=PLAIN["terms"] | {
        "transmission": "on", "interreflection": "on", "incidence": "on", "beam": "on",
        "curvature": "on", "diffuse_profile": "on"}, maps={"albedo": "albedo.exr"},
        skin={"model": "multipole", "normalise": "none", "layers": [LAYER, DEEP],
              "fit": {"gaussians": 2}}),
    "dipole": plain(skin={"model": "dipole", "sigma_a_per_mm": [0.1, 0.2, 0.3], "sigma_sp_per_mm": [2, 3, 4],
                          "fit": {"gaussians": 2}}),
    "burley": plain(skin={"model": "burley", "d_mm": [1.0, 0.5, 0.3], "fit": {"gaussians": 2}}),
    "burley path": plain(skin={"model": "burley", "mean_free_path_mm": [1.0, 0.5, 0.3], "albedo_rgb": [0.8, 0.5, 0.4],
                               "fit": {"gaussians": 2}}),
    "table": plain(skin={"model": "table", "path": "table.csv", "fit": {"gaussians": 2}, "medium": MEDIUM},
                   terms=PLAIN["terms"] | {"incidence": "on"}),
    "medium": plain(skin=PLAIN["skin"] | {"medium": MEDIUM}, terms=PLAIN["terms"] | {"incidence": "on"}),
    "transport": plain(skin={"model": "transport", "layers": [DEEP], "photons": 1000,
                             "fit": {"gaussians": 2}}),
    "physiology": plain(skin={"model": "physiology", "melanin": 0.02, "fit": {"gaussians": 2}}),
    "pigments": plain(
        skin={"model": "physiology", "melanin": 0.02, "fit": {"gaussians": 2}},
        maps={"melanin": {"path": "rough.exr", "channel": "r", "layer": "one", "scale": 0.1},
              "haemoglobin": {"path": "rough.exr", "channel": "g", "layer": "one", "scale": 0.01}}),
    "reduced": plain(texture={"size": 32, "gutter": 2}, maps={"albedo": "albedo.exr"}, diffusion=PLAIN["diffusion"] | {
        "tolerance": 0.9}),
    "shown": plain(preview={"size": [24, 30]}, specular={"f0": 0.03}),
    "relit": plain(relight={"textures": 9, "basis": "fitted", "tolerance": 0.01}, maps={"albedo": "albedo.exr"}),
}  # fmt: skip

every_unseen_light = cache(unseen_lights)
FIT = {"skin.fit.gaussians": 3, "skin.fit.signed": True, "skin.fit.energy": "free", "skin.normalise": "none"}
TOLERANT = [{"skin.fit.tolerance": 0.5, "skin.fit.gaussians": None}]
COLOUR = {"color_space": "srgb", "layer": "two"}
SCALAR = COLOUR | {"channel": "b", "invert": True}


def of(role, **keys):
    """Changes of a map's keys."""
    return {f"maps.{role}.{name}": value for name, value in keys.items()}


LAYERED = {"skin.layers.0.sigma_a_per_mm": [0.3, 0.2, 0.1], "skin.layers.0.sigma_sp_per_mm": [3.0, 2.5, 2.0],
           "skin.layers.0.eta": 1.3, "skin.layers.0.g": 0.5}  # fmt: skip
# By base: keys that are changed one at a time, then changes of a key that needs others with it, the key first
CHANGES = {
    "head": [
        of("albedo", channel="g", invert=True, **COLOUR)
        | of("normal", green="directx", encoding="unsigned", strength=0.5, **COLOUR)
        | of("roughness", kind="ggx", **SCALAR) | of("specular", **SCALAR)
        | of("height", scale_mm=2.0, **(SCALAR | {"channel": "r"}))
        | of("detail", green="directx", encoding="unsigned", strength=0.5, repeat=3, **COLOUR)
        | of("f0", scale=0.2, **SCALAR)
        | of("cavity", **(SCALAR | {"channel": "r"})) | of("scatter", **SCALAR) | of("radius", scale=1.5, **SCALAR)
        | {"specular.roughness": 0.5, "specular.strength": 0.2, "specular.second.roughness": 0.1,
           "specular.second.mix": 0.2, "mesh.skin": ["Skin", "Lash"],
           "mesh.cast": [], "mesh.ignore": [], "terms.energy_conservation": "off", "shadows": False},
        {"maps.normal.space": "object", "maps.height": None, "maps.detail": None},
        {"maps.albedo_rgb": [0.3, 0.2, 0.1], "maps.albedo": None},
    ],
    "hat": [{"occluders.0.unit": "cm", "occluders.0.up": "z", "occluders.0.front": "-z", "occluders.0.flip_v": True,
             "occluders.0.parts": ["Brim"]}, {"occluders.0.mm_per_unit": 1.5, "occluders.0.unit": None}],
    "cards": [{"mesh.opacity": {}}],
    "hat.gltf": [{"occluders.0.uv_set": 1}],
    "gltf": [{"maps.source": None, "maps.vertex_colors": True}, {"mesh.uv_set": 1, "maps.source": None}],
    "unwrapped": [{"mesh.unit": "cm", "texture.unwrap": "none", "texture.gutter": 3, "output.seed": 2},
                  {"mesh.mm_per_unit": 1.5, "mesh.unit": None}],
    "tiles": [{"texture.size": 12}],
    "lights": [
        {"lights.0.name": "sun", "lights.0.direction": [0.5, 0, -0.8], "lights.0.irradiance": [3, 2, 1],
         "lights.0.shadows": False, "lights.1.name": "bulb", "lights.1.position_mm": [10, 10, 60],
         "lights.1.intensity": [700, 800, 900], "lights.1.shadows": False, "lights.2.name": "window",
         "lights.2.position_mm": [0, 40, 50], "lights.2.edge_u_mm": [40, 0, 0], "lights.2.edge_v_mm": [0, -30, 20],
         "lights.2.radiance": [2, 1, 1], "lights.2.samples": 3, "lights.2.shadows": False, "lights.3.name": "dome",
         "lights.3.color_space": "srgb", "lights.3.layer": "two", "lights.3.clamp": 0.5, "lights.3.scale": 2.0,
         "lights.3.rotate_deg": 90.0, "lights.3.samples": 7, "lights.3.shadows": False, "output.lights": "total",
         "output.tx": True},
    ],
    "spot": [{"lights.0.name": "bulb", "lights.0.position_mm": [10, 10, 60], "lights.0.intensity": [700, 800, 900],
              "lights.0.axis": [0, -0.3, -1], "lights.0.inner_deg": 5, "lights.0.outer_deg": 15,
              "lights.0.shadows": False, "texture.udim": True}],
    "constant sky": [{"lights.0.radiance": [3, 2, 1]}],
    "auto": [
        {"mesh.unit": "cm", "mesh.up": "z", "mesh.front": "-z", "mesh.flip_v": True, "texture.size": [14, 16],
         "texture.gutter": 1, "diffusion.method": "surface", "diffusion.tolerance": 0.3, "diffusion.separate": False,
         "diffusion.probes": 30, "texturing.mode": "post-scatter", "terms.incidence": "off",
         "terms.beam": "off", "terms.curvature": "off", "terms.diffuse_profile": "off",
         "terms.interreflection": "off", "terms.transmission": "off", "terms.bounces": 2, "output.precision": "float",
         "output.layout": "single",
         "output.compression": "piz", "output.lights": "total", "output.seed": 1, "output.tx": True,
         "skin.boundary": "exact", "skin.thin_layers": "ballistic", "skin.layers.0.thickness_mm": 0.1,
         "skin.normalise": "white"} | LAYERED | {"skin.fit.gaussians": 3},
        {"mesh.mm_per_unit": 1.5, "mesh.unit": None},
        {"tolerance": 0.3, "diffusion.tolerance": 0.3},
        {"diffusion.normalise": False, "diffusion.method": "surface", "terms.interreflection": "off"},
        {"texturing.mix": 0.3, "texturing.mode": "mix"},
    ],
    "dipole": [FIT | {"skin.radius": 0.7, "skin.scatter": 0.8} | {
                      "skin.sigma_a_per_mm": [0.2, 0.2, 0.3], "skin.sigma_sp_per_mm": [3, 3, 4], "skin.eta": 1.2,
                      "skin.variant": "better", "skin.boundary": "exact"}, *TOLERANT],
    "burley": [{"skin.d_mm": [1.0, 0.4, 0.3]}],
    "burley path": [{"skin.mean_free_path_mm": [1.0, 0.4, 0.3], "skin.mean_free_path": "surface",
                     "skin.albedo_rgb": [0.7, 0.5, 0.4]}],
    "table": [{"skin.medium": MEDIUM | {"sigma_a_per_mm": [0.3, 0.2, 0.1]}}],
    "medium": [{"skin.medium": MEDIUM | {"sigma_a_per_mm": [0.3, 0.2, 0.1]}}],
    "transport": [LAYERED | {"skin.photons": 1500, "skin.seed": 1, "skin.incidence": "diffuse",
                             "skin.layers.0.thickness_mm": 2.0}],
    "physiology": [{"skin.melanin": 0.1, "skin.eumelanin": 0.5, "skin.haemoglobin": 0.01,
                          "skin.oxygenation": 0.5, "skin.epidermis_mm": 0.1, "skin.eta": 1.3,
                          "skin.boundary": "exact", "skin.albedo": "physiology"}],
    "pigments": [of("melanin", scale=0.2, **SCALAR) | of("haemoglobin", scale=0.02, **SCALAR),
                 ],
    "reduced": [{"texture.reduce": "off", "diffusion.tolerance": 0.1, "maps.albedo.invert": True, "mesh.unit": "cm"}],
    "shown": [{"preview.size": [30, 24], "preview.view": "front", "preview.exposure": 1.0,
               "preview.background_rgb": [0.5, 0.2, 0.1], "specular.f0": 0.05, "skin.variance_mm2": [4.0, 50.0],
               "skin.weight_rgb": [[0.4, 0.6, 0.7], [0.6, 0.4, 0.3]], "skin.normalise": "none"},
              {"skin.fit.gaussians": 1}, {"skin.fit.tolerance": 0.9},
              *({f"preview.camera.{key}": value} | CAMERA for key, value in
                (("target_mm", [0, 3, 0]), ("distance_mm", 80.0), ("azimuth_deg", 30.0), ("elevation_deg", 20.0)))],
    "relit": [{"relight.textures": 7, "relight.size": 16, "relight.tolerance": 0.2, "relight.basis": "harmonics",
               "relight.fewer": False, "texturing.mode": "post-scatter", "relight.reuse": True}],
}  # fmt: skip
FILES = {
    "head": ["head.obj", "albedo.exr", "normal.exr", "rough.exr"],
    "hat": ["hat.obj", "alpha.png"],
    "cards": ["alpha.png"],
    "gltf": ["two.gltf", "two.bin", "base.png"],
    "tiles": ["tiles.obj", "tile.1001.exr", "tile.1002.exr"],
    "lights": ["sky.exr"],
    "reduced": ["albedo.exr"],
    "pigments": ["rough.exr"],
    "table": ["table.csv"],
}


def write_files(folder, seed=0):
    """Every file of the bases; those of another seed hold something else."""
    rng = np.random.default_rng(seed)
    grow = 1 + 0.1 * seed

    def image(height, width, low=0.2, high=0.8):
        return rng.uniform(low, high, (height, width, 3)).astype(np.float32)

    face = relief(height_mm=18 * grow, segments=5)
    face = replace(face, corner_uv=0.7 * face.corner_uv)
    eye, lash = (quad(w, w, z_mm=z, uv_box=(0.75, z / 50, 0.95, z / 50 + 0.2)) for w, z in ((20, 25), (12, 35)))
    write_parts_obj(folder / "head.obj", {"Skin": face, "Eye": eye, "Lash": lash})
    write_parts_obj(folder / "hat.obj", {"Brim": quad(30 * grow, 25, z_mm=30), "Crown": quad(9, 9, z_mm=45)})
    write_parts_obj(folder / "tiles.obj", {"a": relief(30, 9 * grow, segments=4)}, tiles=2)
    for name in ("albedo.exr", "rough.exr", "sky.exr", "tile.1001.exr", "tile.1002.exr"):
        write_layers(folder / name, image(6, 12), image(6, 12))
    tilt = [np.dstack([image(5, 7, 0.4, 0.6)[..., :2], np.ones((5, 7))]).astype(np.float32) for _ in range(2)]
    write_layers(folder / "normal.exr", *tilt)
    write_png(folder / "alpha.png", np.repeat((image(5, 5)[..., :1] > 0.5) * np.uint8(255), 3, axis=2))
    write_png(folder / "base.png", (255 * image(4, 4)).astype(np.uint8))
    radius = np.linspace(0, 12, 40)
    rows = (f"{r:.6f},{np.exp(-r * grow)},{np.exp(-2 * r)},{np.exp(-3 * r)}" for r in radius)
    (folder / "table.csv").write_text("r_mm,R,G,B\n" + "\n".join(rows) + "\n")
    write_gltf(folder, face, grow, rng)


def write_parts_obj(path, parts, tiles=1):
    """An OBJ of named parts; over two tiles, a part's right half lies on the second."""
    lines, start = [], 1
    for name, mesh in parts.items():
        uv = mesh.corner_uv.reshape(-1, 2) * [tiles, 1]
        if tiles == 2:
            right = np.repeat(mesh.corner_uv[..., 0].mean(axis=1) > 0.5, 3)
            uv[:, 0] = np.where(right, np.maximum(uv[:, 0], 1.0), np.minimum(uv[:, 0], 1.0))
        lines.append(f"o {name}")
        lines += [f"v {x} {y} {z}" for x, y, z in mesh.corner_position_mm.reshape(-1, 3)]
        lines += [f"vt {u} {v}" for u, v in uv]
        lines += [f"f {i}/{i} {i + 1}/{i + 1} {i + 2}/{i + 2}" for i in range(start, start + 3 * len(mesh.faces), 3)]
        start += 3 * len(mesh.faces)
    path.write_text("\n".join(lines) + "\n")


def write_layers(path, one, two):
    """An EXR of two layers."""
    layers = {"one": one, "two": two}
    channels = {f"{layer}.{c}": image[..., i] for layer, image in layers.items() for i, c in enumerate("RGB")}
    write_parts(path, [Part("", channels | rgb_channels(one))])


def write_gltf(folder, mesh, grow, rng):
    """A face with two sets of UVs, vertex colours and a material, in a .gltf, a .bin and a .png."""
    positions, uv, normals, faces = vertices_of(mesh)
    made = Gltf()
    colours = rng.uniform(0.2, 0.9, (len(positions), 3)).astype(np.float32)
    attributes = {
        "POSITION": made.accessor(positions), "NORMAL": made.accessor(normals), "TEXCOORD_0": made.accessor(uv),
        "TEXCOORD_1": made.accessor(uv[:, ::-1] * 0.9), "COLOR_0": made.accessor(colours),
    }  # fmt: skip
    made.material(name="m", pbrMetallicRoughness={"baseColorTexture": made.image(b"", uri="base.png")})
    made.mesh(attributes, made.accessor(faces.ravel(), "I"), material=0)
    made.tree["nodes"][0]["scale"] = [grow, grow, 1.0]
    (folder / "two.gltf").write_bytes(made.gltf("two.bin"))
    (folder / "two.bin").write_bytes(bytes(made.data))


def put(mapping, dotted, value):
    *path, last = dotted.split(".")
    for key in path:
        if isinstance(mapping, list):
            mapping = mapping[int(key)]
        else:
            if isinstance(mapping.get(key), str):
                mapping[key] = {"path": mapping[key]}
            mapping = mapping.setdefault(key, {})
    mapping[int(last) if last.isdigit() else last] = value


def each_change():
    """Base, the key that is changed, and all that is changed with it."""
    for base, groups in CHANGES.items():
        alone, *others = groups
        for key, value in alone.items():
            yield base, key, {key: value}
        for change in others:
            yield base, next(iter(change)), change


@pytest.fixture(autouse=True)
def quick_writing(monkeypatch):
    """Each fit, and each medium's slabs, are made once, tables are coarse, and nothing waits for the disk."""
    fits, slabs = {}, {}

    def fit_once(skin, table, over):
        key = skin.model_dump_json(), repr(table), "fit" in skin.model_fields_set, repr(over)
        if key not in fits:
            fits[key] = fit_skin(skin, table, over=over)
        return fits[key]

    def slabs_once(gaussians, reflectance_rgb, medium):
        arrays = gaussians.variance_mm2, gaussians.weight_rgb, reflectance_rgb
        key = *(array.tobytes() for array in arrays), gaussians.normalise, repr(medium)
        if key not in slabs:
            slabs[key] = slab_weights(gaussians, reflectance_rgb, medium)
        return slabs[key]

    monkeypatch.setattr("skinbake.baking.inputs.fit_skin", fit_once)
    monkeypatch.setattr("skinbake.diffuse.terms.thin_parts.slab_weights", slabs_once)
    monkeypatch.setattr("skinbake.diffuse.planning.texture_size.SMALLEST", 16)
    monkeypatch.setattr("skinbake.profile.fit_table.NODES", {1: (5, 1), 2: (3, 2)})
    monkeypatch.setattr("os.fsync", lambda file: None)
    monkeypatch.setattr("skinbake.relight.transfer.unseen_lights", lambda seed: every_unseen_light(seed)[32:34])


class Bakes:
    """Bakes of one base in folders side by side, so that their paths look the same from each."""

    def __init__(self, folder, base):
        self.folder, self.mapping, self.preview = folder, BASES[base], base == "shown"

    def __call__(self, name, change=(), cache=None):
        """Bake into the folder `name`, as it is; every file's digest, and the manifest's entries."""
        mapping = copy.deepcopy(self.mapping)
        for key, value in dict(change).items():
            put(mapping, key, value)
        mapping["output"] = mapping["output"] | {"dir": name}
        (self.folder / "look.yaml").write_text(yaml.safe_dump(mapping))
        self.spec = load_look(self.folder / "look.yaml")
        session = BakeSession.of(str(self.folder / cache) if cache else None, 2**30)
        with suppress(ToleranceMissedError):
            bake_look(self.spec, preview=self.preview, verbosity=0, session=session)
        return contents(self.folder / name)


def changed_files(before, after):
    """Names of the results that differ; the manifest, which repeats the configuration, does not count."""
    names = {name for name in before.keys() | after.keys() if not name.startswith("bake.json")}
    return {name for name in names if before.get(name) != after.get(name)}


def check(bakes, before, change, what):
    """That a change is seen over the old folder, and with the cache that the old bake has filled."""
    fresh = bakes("fresh", change)
    shutil.copytree(bakes.folder / "old", bakes.folder / "over")
    over, cached = bakes("over", change), bakes("cached", change, "cache")
    assert over == fresh, f"{what}, over the old folder: {changed_files(over, fresh)}"
    assert cached == fresh, f"{what}, from the cache: {changed_files(cached, fresh)}"
    for name in ("fresh", "over", "cached"):
        shutil.rmtree(bakes.folder / name)
    return changed_files(before, fresh)


@pytest.mark.slow  # some hundreds of bakes of a few texels
@pytest.mark.parametrize("base", BASES)
def test_nothing_stale_looks_fresh(tmp_path, base):
    """Each key, then each file; and each makes a difference, or it would not be a test."""
    if base == "shown" and renderer_name() is None:
        pytest.skip("no headless OpenGL here (python -m skinbake.preview.setup_gl)")
    write_files(tmp_path)
    bakes = Bakes(tmp_path, base)
    before = bakes("old", cache="cache")
    for _, key, change in (found for found in each_change() if found[0] == base):
        assert check(bakes, before, change, f"{base}: {change}"), f"{base}: {key} changes nothing: choose another value"
    other = tmp_path / "other"
    other.mkdir()
    write_files(other, seed=1)
    for name in FILES.get(base, ()):
        kept = (tmp_path / name).read_bytes()
        shutil.copy(other / name, tmp_path / name)
        assert check(bakes, before, {}, f"{base}: {name}"), f"{base}: another {name} changes nothing"
        (tmp_path / name).write_bytes(kept)


@pytest.mark.slow  # as above
def test_where_files_lie_and_what_is_only_refused_changes_nothing(tmp_path):
    """The rest of the schema."""
    for folder in (tmp_path, tmp_path / "moved"):
        folder.mkdir(exist_ok=True)
        write_files(folder)
    bakes = Bakes(tmp_path, "head")
    before = bakes("old")
    roles = ("albedo", "normal", "roughness", "specular", "height", "detail", "cavity", "f0", "scatter", "radius")
    moved = {f"maps.{role}.path": f"moved/{BASES['head']['maps'][role]['path']}" for role in roles}
    assert not changed_files(before, bakes("new", moved | {"mesh.path": "moved/head.obj"}))
    for base, change in (
        ("hat", {"occluders.0.path": "moved/hat.obj", "occluders.0.opacity": "moved/alpha.png"}),
        ("table", {"skin.path": "moved/table.csv"}),
        ("lights", {"lights.3.path": "moved/sky.exr"}),
    ):
        bakes = Bakes(tmp_path, base)
        assert not changed_files(bakes("one"), bakes("two", change)), base
        shutil.rmtree(tmp_path / "one")
        shutil.rmtree(tmp_path / "two")


def test_every_key_of_the_schema_is_changed_or_changes_no_bytes(tmp_path):
    """A new key has to be given a value to change to in `CHANGES`, or a reason in `NO_BYTES`."""
    write_files(tmp_path)
    seen = set()
    for base, key, change in each_change():
        mapping = copy.deepcopy(BASES[base])
        for dotted, value in change.items():
            put(mapping, dotted, value)
        seen.add(label(key, mapping))
    known = set(leaves(SceneSpec))
    assert sorted(known - seen - NO_BYTES.keys()) == [], "keys that no bake is tried with"
    assert sorted((seen | NO_BYTES.keys()) - known) == [], "keys that the schema has no more"
    assert sorted(seen & NO_BYTES.keys()) == []


KINDS = {"model", "type"}  # keys that say which kind of skin or light it is


def leaves(model, prefix=""):
    """Dotted keys of a schema that hold values.

    One that only some kinds of skin or light have is told by its kind, `lights[spot].axis`.
    """
    for name, field in model.model_fields.items():
        inner = list(dict.fromkeys(_models(field.annotation)))
        if not inner or name == "medium":  # its keys are those of a skin, and are read as such
            yield f"{prefix}{name}"
            continue
        common = set.intersection(*(set(one.model_fields) for one in inner)) - KINDS if len(inner) > 1 else set()
        for one in inner:
            for key in leaves(one):
                kind = _kind(one) if len(inner) > 1 and key.split(".")[0] not in common else ""
                yield f"{prefix}{name}{kind}.{key}"


def _models(annotation):
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in typing.get_args(annotation):
        yield from _models(argument)


def _kind(model):
    """`[spot]` of the class of spot lights."""
    told = model.model_fields.get("type") or model.model_fields["model"]
    return f"[{typing.get_args(told.annotation)[0]}]"


def label(dotted, mapping):
    """The schema's name of a key in a look."""
    parts = [part for part in dotted.split(".") if not part.isdigit()]
    thing = mapping["lights"][int(dotted.split(".")[1])] if parts[0] == "lights" else mapping["skin"]
    kind = f"{parts[0]}[{thing.get('type') or thing['model']}]" if parts[0] in ("lights", "skin") else ""
    told = ".".join([kind, *parts[1:]])
    return told if told in set(leaves(SceneSpec)) else ".".join(parts)
