"""What is fuzzed: valid files to start from, how they are damaged, what must hold of whatever is read from the damage.

A target's `read` may end in a SkinbakeError or in a value whose promises hold. Anything else is a finding: another
exception, a warning, a crash, a hang, memory beyond the limit.
"""

from __future__ import annotations

import io
import json
import shutil
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import numpy as np

from skinbake.errors import SkinbakeError
from tests.conftest import ROOT
from tests.fuzz.mutate import TOKENS, damaged_bytes, damaged_text, damaged_tree, damaged_yaml
from tests.gltf_files import Gltf
from tests.shapes import quad, sphere

Seeds = tuple[tuple[str, bytes], ...]  # file suffix, content


@dataclass(frozen=True)
class Target:
    """One reader under fuzzing."""

    seeds: Callable[[], Seeds]
    damage: Callable[[Seeds, Random], tuple[str, bytes]]
    read: Callable[[Path], None]


def survives(target: Target, suffix: str, content: bytes, folder: Path) -> str:
    """Read one input; "refused" or "read". Warnings count as failures: a person would see them on the terminal."""
    path = folder / f"input{suffix}"
    path.write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            target.read(path)
        except SkinbakeError as error:
            refusal = str(error)
        else:
            return "read"
    assert refusal.strip(), "an error without a message"
    return "refused"


# Configuration -------------------------------------------------------------------------------------------------------

WHOLE_LOOK = """\
mesh: {path: head.obj, mm_per_unit: 50.35, flip_v: false}
maps:
  albedo: {path: a.png, color_space: srgb}
  normal: {path: n.png, green: directx, strength: 0.5}
  roughness: r.png
  specular: null
texture: {size: [64, 32], gutter: 4, udim: true}
skin:
  model: multipole
  layers:
    - {sigma_a_per_mm: [2.1, 2.1, 5.0], sigma_sp_per_mm: 48, thickness_mm: 0.03, eta: 1.55}
    - {sigma_a_per_mm: [0.16, 0.19, 0.3], sigma_sp_per_mm: [32, 40, 46], thickness_mm: .inf, eta: 1.4}
  fit: {tolerance: 0.01}
  normalise: none
lights:
  - {name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}
  - {name: rim, type: point, position_mm: [0, 0, 100], intensity: [1, 1, 1]}
  - {name: spot, type: spot, position_mm: [0, 9, 100], intensity: [1, 1, 1], axis: [0, 0, -1], outer_deg: 21}
  - name: soft
    type: rectangle
    position_mm: [0, 0, 100]
    edge_u_mm: [9, 0, 0]
    edge_v_mm: [0, 9, 0]
    radiance: [1, 1, 1]
    samples: 16
  - {name: sky, type: environment, path: sky.exr, scale: 2, rotate_deg: 90}
shadows: off
diffusion: {method: surface, tolerance: 0.01, separate: true, normalise: false, probes: 100}
texturing: {mode: mix, mix: 0.5}
specular: {f0: 0.028, roughness: 0.3, strength: 0.318}
terms: {energy_conservation: on, transmission: off}
relight: {textures: 16, basis: fitted, tolerance: 0.02, fewer: off}
output: {dir: out, precision: half, compression: zip, lights: separate, seed: 7, tx: false}
preview: {size: [64, 64], view: front, exposure: 1.0, background_rgb: [0, 0, 0]}
"""


@cache
def look_seeds() -> Seeds:
    looks = [WHOLE_LOOK.encode()]
    for skin in sorted((ROOT / "configs" / "skins").glob("*.yaml")):
        looks.append(f"mesh: {{path: h.obj, unit: mm}}\nskin: {{preset: {skin.stem}}}\noutput: {{dir: o}}\n".encode())
        looks[-1] += b"lights: [{name: key, type: environment, radiance: [1, 1, 1]}]\n"
    looks += [
        (ROOT / "configs" / name).read_bytes() for name in ("head.yaml", "head_plain.yaml", "lee_perry_smith.yaml")
    ]
    return tuple((".yaml", look) for look in looks)


def damage_yaml(seeds: Seeds, rng: Random) -> tuple[str, bytes]:
    suffix, seed = seeds[0] if rng.random() < 0.6 else rng.choice(seeds)
    return suffix, damaged_yaml(seed.decode(), rng).encode("utf-8", "surrogateescape")


def read_look(path: Path) -> None:
    from skinbake.io.config import load_look
    from skinbake.io.manifest import portable_config, spec_of
    from skinbake.scene.spec import SceneSpec

    spec = load_look(path, files=False)
    assert isinstance(spec, SceneSpec)
    # What bake.json will hold must give the same look again
    again = spec_of({"config": json.loads(json.dumps(portable_config(spec, path.parent)))}, path.parent)
    assert again == spec, "a look does not survive its own manifest"


def read_skin(path: Path) -> None:
    from skinbake.io.config import load_skin

    path.with_name("x.csv").touch()
    load_skin(path)


@cache
def skin_seeds() -> Seeds:
    models = (
        "model: burley\nd_mm: [0.7, 0.3, 0.2]\n",
        "model: burley\nmean_free_path_mm: 1\nalbedo_rgb: 0.8\nmean_free_path: diffuse\n",
        "model: dipole\nsigma_a_per_mm: 0.1\nsigma_sp_per_mm: [1, 2, 3]\nvariant: better\nfit: {signed: true}\n",
        "model: transport\nlayers: [{sigma_a_per_mm: 1, sigma_sp_per_mm: 2, g: 0.8}]\nphotons: 100\n",
        "model: table\npath: x.csv\n",
        "model: physiology\nmelanin: 0.1\n",
        "variance_mm2: [0, 1]\nweight_rgb: [[1, 1, 1], [0, 0, 0]]\nnormalise: none\n",
    )
    return tuple((".yaml", text.encode()) for text in models)


RIGHT_OVERRIDES = (
    "texture.size=64", "lights.key.irradiance=[3, 2, 1]", "lights.1.intensity=[0, 0, 0]",
    "skin.layers[0].eta=1.3", "maps.albedo=x.png",
    "maps.albedo.path=y.png", "output.dir=elsewhere", "skin.fit={gaussians: 4}", "diffusion={}",
    "lights.sky.path=a.hdr", "shadows=on", "relight.fewer=false", "relight={textures: 25}",
)  # fmt: skip


def damage_overrides(seeds: Seeds, rng: Random) -> tuple[str, bytes]:
    """Lines of `dotted.key=value`, right and wrong."""
    keys = ["mesh", "path", "lights", "key", "0", "7", "-1", "skin", "layers", "1", "eta", "fit", "gaussians",
    "texture", "size", "maps",
            "albedo", "output", "dir", "", "[0]", "a b", "name", "irradiance", "preset", "<<", "é"]  # fmt: skip
    lines = []
    for _ in range(rng.randrange(1, 4)):
        if rng.random() < 0.6:
            lines.append(rng.choice(RIGHT_OVERRIDES))
            continue
        name = rng.choice([".", ".", "[", "]", ".."]).join(rng.choices(keys, k=rng.randrange(1, 5)))
        value = rng.choice(
            [rng.choice(TOKENS), damaged_text("[1, {a: 2}]", rng), str(rng.uniform(-3, 3)), "donner-three-layer"]
        )
        lines.append(name + rng.choice(["=", "=", "=", "", "=="]) + value)
    return ".txt", "\n".join(lines).encode("utf-8", "surrogateescape")


def read_overrides(path: Path) -> None:
    from skinbake.io.config import load_look

    look = path.with_name("look.yaml")
    look.write_text(WHOLE_LOOK)
    load_look(look, path.read_text("utf-8", "surrogateescape").split("\n"), files=False)


@cache
def batch_seeds() -> Seeds:
    text = """\
defaults: {base: look.yaml, output: {dir: out}, texture: {size: 64}}
jobs:
  - {name: one, skin: {preset: jensen-skin1}}
  - {name: two, lights.key.irradiance: [1, 2, 3]}
matrix:
  size: {small: {texture: {size: 16}}, 32: {texture.size: 32}}
  skin: {light: {skin: {preset: physiology-light}}, dark: {skin: {preset: physiology-dark}}}
"""
    return ((".yaml", text.encode()), (".yaml", (ROOT / "configs" / "looks.yaml").read_bytes()))


def read_batch(path: Path) -> None:
    from skinbake.io.batch_file import load_batch

    path.with_name("look.yaml").write_text(WHOLE_LOOK)
    jobs = load_batch(path).jobs
    assert len({job.name for job in jobs}) == len(jobs) > 0


@cache
def manifest_seeds() -> Seeds:
    from skinbake.io.config import load_look
    from skinbake.io.manifest import portable_config

    with TemporaryDirectory() as folder:
        look = Path(folder) / "look.yaml"
        look.write_text(WHOLE_LOOK)
        bare = [
            "maps={}",
            "mesh={path: head.obj, mm_per_unit: 2, any_size: true}",
            "lights.sky.path=null",
            "texture.udim=false",
        ]
        config = portable_config(load_look(look, [*bare, "lights.sky.radiance=[1, 1, 1]"], files=False), Path(folder))
        config["mesh"]["path"] = "head.obj"
    lobe = {"file": "lobe_0.exr", "variance_mm2": 0.1, "weight_rgb": [1, 1, 1], "size": [8, 4], "method": "texture"}
    manifest = {
        "version": "0.1.0", "config": config, "inputs": {"mesh": "0" * 64}, "irradiance": ["irradiance.exr"],
        "lobes": [lobe],
        "lights": ["key", "rim", "spot", "soft", "sky"], "texturing": {"mode": "mix", "mix": 0.5},
        "terms": {"energy_conservation": True},
        "timings": {"total": 1.0}, "peak_memory_mib": 200.0,
        "error": {"rms": 0.01, "p95": 0.02, "max": 0.1, "probes": 9, "method": 0.01, "storage": 0.0, "fit": [0.0] * 3},
        "plan": [{"term": "shadows", "kept": True, "why": "asked for"}],
    }  # fmt: skip
    return ((".json", json.dumps(manifest, indent=1).encode()),)


def damage_json(seeds: Seeds, rng: Random) -> tuple[str, bytes]:
    suffix, seed = rng.choice(seeds)
    if rng.random() < 0.7:
        tree = damaged_tree(json.loads(seed), rng)
        return suffix, json.dumps(tree, default=str, skipkeys=True).encode()
    return suffix, damaged_text(seed.decode(), rng).encode("utf-8", "surrogateescape")


def read_manifest_file(path: Path) -> None:
    """As every reader of a bake folder does; the files it names are there."""
    from skinbake.io.bake_folder import read_bake_folder

    for name, content in _baked_files().items():
        (path.parent / name).write_bytes(content)
    path.rename(path.with_name("bake.json"))
    read_bake_folder(path.parent)


@cache
def _baked_files() -> dict[str, bytes]:
    """What the manifest speaks of: a mesh, light of five lights on 8 x 4 texels, and one lobe of it."""
    from skinbake.io.exr import Part, rgb_channels, write_parts
    from skinbake.io.mesh import write_obj

    lights = ("key", "rim", "spot", "soft", "sky")
    image, one = np.ones((4, 8, 3), np.float32), np.ones((4, 8), np.float32)
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_obj(folder / "head.obj", quad())
        parts = [Part(f"light.{light}", rgb_channels(image) | {"visibility": one}) for light in lights]
        for file in ("irradiance.exr", "lobe_0.exr"):
            write_parts(folder / file, [Part("irradiance", rgb_channels(image)), *parts])
        return {path.name: path.read_bytes() for path in folder.iterdir()}


@cache
def _transfer_files() -> dict[str, bytes]:
    """relight.json of four harmonics, and the textures it speaks of."""
    from skinbake.io.relight import write_transfer
    from skinbake.relight.basis import harmonic_basis
    from skinbake.relight.light_error import KindError
    from skinbake.relight.transfer import Transfer
    from skinbake.scene.decision import Decision

    textures, seen = {1001: np.ones((4, 4, 8, 3), np.float16)}, {1001: np.ones((3, 2, 4, 3), np.float16)}
    error = KindError(1, 0.01, 0.02, 0.03, {"name": "sky-0"}, {"uv": [0.5, 0.5], "of_mean": 0.1}, 0.0)
    plan = (Decision("relight.harmonics", True, "asked for"),)
    made = Transfer(harmonic_basis(1), textures, seen, {"skies": error}, (8, 4), plan)
    with TemporaryDirectory() as name:
        write_transfer(Path(name), made, "0" * 64, {}, "half", "zip", False)
        return {path.name: path.read_bytes() for path in Path(name).iterdir()}


def read_transfer(path: Path) -> None:
    """As `open_bake(...).relight` does; the textures are there."""
    from skinbake.io.relight import transfer_of
    from skinbake.relight.relit import light_coefficients, relit

    content = path.read_bytes()
    for name, other in _transfer_files().items():
        (path.parent / name).write_bytes(other)
    (path.parent / "relight.json").write_bytes(content)
    transfer = transfer_of(path.parent)
    amount = light_coefficients(transfer.basis, np.ones((4, 8, 3), np.float32))
    for textures in transfer.textures.values():
        assert relit(textures, transfer.basis, amount).shape[2] == 3


# State of our own ----------------------------------------------------------------------------------------------------


@cache
def report_seeds() -> Seeds:
    job = {
        "name": "one",
        "folder": "one",
        "choices": {"size": "small"},
        "selected": True,
        "status": "done",
    }
    jobs = [
        job | {"note": "rms 1 %"},
        job | {"name": "two", "status": "failed", "error": "no such mesh"},
        job | {"status": "not run"},
    ]
    report = {"version": "0.1.0", "file": "looks.yaml", "seconds": 1.5, "workers": 2, "dask": None, "jobs": jobs}
    return ((".json", json.dumps(report | {"cache": {"hits": 1, "misses": 2}}).encode()),)


def read_report(path: Path) -> None:
    """As `info` tells it and as the next batch takes it up."""
    from skinbake.cli.info import _batch
    from skinbake.io.batch_report import read_batch_report

    path.rename(path.with_name("batch.json"))
    report = read_batch_report(path.parent)
    assert "\n".join(_batch(report))
    assert all(isinstance(job["name"], str) for job in report["jobs"])


@cache
def profile_seeds() -> Seeds:
    rgb = [0.1, 0.2, 0.3]
    record = {"variance_mm2": [0.1, 2.0], "weight_rgb": [rgb, rgb], "relative_error_rgb": rgb, "energy_rgb": rgb}
    record |= {"model": "table", "normalise": "white", "key": "a"}
    return tuple((".json", json.dumps(each).encode()) for each in (record, record | {"weights_table": _table(2)}))


def _table(gaussians: int) -> dict[str, object]:
    """Weights that a map of widths varies between two nodes."""
    rgb = [1 / gaussians] * 3
    return {
        "names": ["radius"],
        "nodes": [[0.5, 1.5], [0.0]],
        "weight_rgb": [[[rgb] * gaussians]] * 2,
        "error_rgb": [[rgb]] * 2,
        "between_rgb": [[rgb]],
        "constants": {"radius": 1.0, "scatter": 1.0},
        "scatters": True,
    }


def read_profile(path: Path) -> None:
    """A fit that is taken up has numbers; another is made anew."""
    from skinbake.io.profile import read_gaussians

    found = read_gaussians(path, "a")
    if found is None:
        return
    assert found.variance_mm2.dtype == found.weight_rgb.dtype == np.float64
    assert found.weight_rgb.shape == (len(found.variance_mm2), 3)
    assert np.isfinite(found.relative_error_rgb).all()
    assert isinstance(found.model + found.normalise, str)
    if found.table is not None:
        weight = found.table.at({name: np.linspace(0, 2, 5) for name in found.table.quantities})
        assert weight.shape == (len(found.variance_mm2), 5, 3)
        assert np.isfinite(weight).all()


@cache
def lobe_seeds() -> Seeds:
    """What the header of the first lobe says of all."""
    from skinbake.diffuse import MeasuredError
    from skinbake.diffuse.diffuse_map import DiffuseMap, Lobe
    from skinbake.io.exr import read_attributes
    from skinbake.io.lobes import as_stored_lobes, write_lobes
    from skinbake.scene.decision import Decision

    image = np.ones((1, 4, 8, 3), np.float32)
    error = MeasuredError(0.01, 0.02, 0.1, 9, 0.01, 0.0)
    lobes = tuple(
        Lobe(variance, (0.5, 0.5, 0.5), method, {1001: image}, error)
        for variance, method in ((0.1, "texture"), (2.0, "surface"))
    )
    made = DiffuseMap(("key",), lobes, error, (Decision("shadows", True, "asked for"),))
    with TemporaryDirectory() as name:
        write_lobes(Path(name), as_stored_lobes(made, "half"), "a", {}, "half", "zip", True, False)
        header = read_attributes(Path(name) / "lobe_0.exr")["irradiance"]
    return ((".json", str(header["skinbake:diffusion"]).encode()),)


def read_lobe_header(path: Path) -> None:
    """A summary that is taken up can be told; another is made anew."""
    from skinbake.io.exr import Part, rgb_channels, write_parts
    from skinbake.io.lobes import read_summary

    image = np.ones((4, 8, 3), np.float32)
    text = path.read_bytes().decode("latin-1").replace("\0", " ")
    for index in range(2):
        about = {"skinbake:key": "a"} | ({"skinbake:diffusion": text} if not index else {})
        write_parts(path.with_name(f"lobe_{index}.exr"), [Part("irradiance", rgb_channels(image))], about)
    found = read_summary(path.parent, "a", (1001,), False)
    if found is None:
        return
    assert all(isinstance(name, str) for name in found.lights)
    assert all(len(lobe.weight_rgb) == 3 and float(lobe.variance_mm2) >= 0 for lobe in found.lobes)
    for line in found.plan:
        assert f"{'+' if line.enabled else '-'} {line.term:<20} {line.why}"
    for error in filter(None, [found.error, *(lobe.error for lobe in found.lobes)]):
        assert (
            f"{error.rms:.3%} {error.p95:.3%} {error.max:.3%} {error.method:.3%} {error.storage:.3%} {error.probes:d}"
        )
    assert isinstance(found.tolerance_met, bool)
    assert isinstance(found.advice, str)


@cache
def relight_seeds() -> Seeds:
    from skinbake.io.relight import USE, write_transfer
    from skinbake.relight.basis import LightBasis
    from skinbake.relight.light_error import KindError
    from skinbake.relight.transfer import Transfer
    from skinbake.scene.decision import Decision

    image = np.ones((4, 4, 8, 3), np.float32)
    error = KindError(2, 0.1, 0.2, 0.3, {"name": "sun"}, {"tile": 1001}, 0.0)
    basis = LightBasis("harmonics", np.eye(4), np.zeros((4, 4)))
    plan = (Decision("relight", True, "asked for"),)
    with TemporaryDirectory() as folder:
        transfer = Transfer(basis, {1001: image}, {1001: image[:3]}, {"suns": error}, (8, 4), plan)
        write_transfer(Path(folder), transfer, "a", {}, "half", "zip", False)
        return ((".json", (Path(folder) / USE).read_bytes()),)


def read_relight(path: Path) -> None:
    """What says how to use a transfer: a right one has a basis of finite numbers and errors that can be told."""
    from skinbake.io.relight import USE, transfer_of

    shutil.copy(path, path.with_name(USE))
    found = transfer_of(path.parent, tiles=False)
    assert np.isfinite(found.basis.of_harmonics).all()
    assert len(found.basis) == len(found.basis.of_harmonics) > 0
    for kind, error in found.error.items():
        assert f"{kind} {error.lights:d} {error.rms:.2%} {error.p95:.2%} {error.worst:.2%} {error.clamped:.2%}"
    for line in found.plan:
        assert f"{'+' if line.enabled else '-'} {line.term:<20} {line.why}"


@cache
def export_seeds() -> Seeds:
    files = {"sum.exr": "of another bake", "head.html": "of another bake", "export.json": "of another bake"}
    made = {"head.html": {"bytes": 9, "key": "a", "figures": {"rms": 0.1}}}
    return ((".json", json.dumps({"version": "1", "bake": "x", "files": files, "made": made}).encode()),)


def read_export_list(path: Path) -> None:
    """Whatever the list says, nothing outside its folder goes, and no folder of it."""
    from skinbake.io.export_list import NAME, export_figures, keep_export_list, remove_exports

    bake, target = path.parent / "bake", path.parent / "exported"
    bake.mkdir(exist_ok=True)
    (target / "folder").mkdir(parents=True, exist_ok=True)
    (bake / "bake.json").write_bytes(manifest_seeds()[0][1])
    (path.parent / "outside").write_text("mine")
    shutil.copy(path, target / NAME)
    assert isinstance(export_figures(target), dict)
    keep_export_list(target, ["sum.exr"], bake)
    shutil.copy(path, target / NAME)
    remove_exports(target)
    assert (path.parent / "outside").exists()
    assert (target / "folder").is_dir()


CACHE_KEY = "ab" + "0" * 62


@cache
def cache_seeds() -> Seeds:
    from skinbake.io.cache import Cache

    with TemporaryDirectory() as name:
        found = []
        for arrays in (
            {"a": np.arange(6.0).reshape(2, 3)},
            {"rgb": np.ones((4, 4, 3), np.float32), "plan": np.zeros(9, np.uint8)},
        ):
            cache = Cache(Path(name))
            cache.write(CACHE_KEY, arrays)
            found.append((".npz", cache.path_of(CACHE_KEY).read_bytes()))
    return tuple(found)


def read_cache_entry(path: Path) -> None:
    """An entry is what was written under its key, or it is missing and removed."""
    from skinbake.io.cache import Cache

    cache = Cache(path.parent / "cache")
    entry = cache.path_of(CACHE_KEY)
    entry.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(path, entry)
    found = cache.read(CACHE_KEY)
    if found is None:
        assert not entry.exists()
        return
    told = {name: (array.shape, array.dtype) for name, array in found.items()}
    assert told in ({"a": ((2, 3), np.float64)}, {"rgb": ((4, 4, 3), np.float32), "plan": ((9,), np.uint8)})


# Meshes --------------------------------------------------------------------------------------------------------------


@cache
def mesh_seeds(suffix: str) -> Seeds:
    from skinbake.io.mesh import write_obj

    found = []
    for mesh in (quad(3.0, 2.0), sphere(50.0, "cube", 8)) if suffix != ".gltf" else ():
        with TemporaryDirectory() as folder:
            path = Path(folder) / "seed.obj"
            write_obj(path, mesh)
            found.append((suffix, path.read_bytes() if suffix == ".obj" else _exported(path, suffix)))
    if suffix == ".obj":
        quads = "mtllib a.mtl\no part\ng a b\nusemtl skin\nv 0 0 0 1\nv 9 0 0\nv 9 9 0\nv 0 9 0\n"
        quads += "vt 0 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
        found += [(suffix, f"{quads}s off\nf 1/1 2/2 3/3 4/4\nf -4/-4 -3/-3 -2/-2\nl 1 2\np 1\n".encode())]
        notch = "v 5 5 5\nvn 0 0 1\n\tf 1/1/1 2/2/1 5/3/1 3/3/1 4/4/1 # concave\nf 1//1 2//1 \\\n 3//1\ng\nf 1 2 3 4\n"
        found += [(suffix, (quads + notch).encode())]
    if suffix == ".ply":
        found += [(suffix, data) for data in _plys()]
    if suffix in (".glb", ".gltf"):
        made = _character()
        found = [*found[:1], (suffix, made.glb())] if suffix == ".glb" else [(suffix, made.gltf())]
    return tuple(found)


def _plys() -> list[bytes]:
    """Mixed faces with texcoord lists, and strips, as text and in both byte orders."""
    head = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n"
    head += "property list uchar int vertex_indices\nproperty list uchar float texcoord\n"
    head += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    points = np.array([[0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0]])
    faces = [([0, 1, 2, 3], [0, 0, 1, 0, 1, 1, 0, 1]), ([0, 1, 2], [0, 0, 1, 0, 1, 1])]
    strip = [0, 1, 2, -1, 3, 2, 1]
    rows = [*points.tolist(), *([len(f), *f, len(uv), *uv] for f, uv in faces), [len(strip), *strip]]
    text = "\n".join(" ".join(map(str, row)) for row in rows)
    found = [f"ply\nformat ascii 1.0\ncomment TextureFile gone.png\n{head}{text}\n".encode()]
    for order, name in (("<", "little"), (">", "big")):
        data = points.astype(order + "f4").tobytes()
        for face, uv in faces:
            data += bytes([len(face)]) + np.array(face, order + "i4").tobytes()
            data += bytes([len(uv)]) + np.array(uv, order + "f4").tobytes()
        data += np.array([len(strip), *strip], order + "i4").tobytes()
        found.append(f"ply\nformat binary_{name}_endian 1.0\n{head}".encode() + data)
    return found


def _character() -> Gltf:
    """A skinned, morphed, quantised strip with sparse normals and a texture transform."""
    made = Gltf()
    points = np.array([[0, 0, 0], [90, 0, 0], [0, 90, 0], [90, 90, 0]])
    normals = made.accessor(np.tile([0, 0, 127], (4, 1)), "b", normalized=True)
    where, what = made.view(b"\1\0"), made.view(b"\0\x7f\0\0")
    made.tree["accessors"][normals]["sparse"] = {
        "count": 1, "indices": {"bufferView": where, "componentType": 5123}, "values": {"bufferView": what},
    }  # fmt: skip
    attributes = {
        "POSITION": made.accessor(points, "h"),
        "NORMAL": normals,
        "TEXCOORD_1": made.accessor(points[:, :2] * 700, "H", normalized=True),
        "JOINTS_0": made.accessor(np.tile([0, 1, 0, 0], (4, 1)), "B"),
        "WEIGHTS_0": made.accessor(np.tile([127, 128, 0, 0], (4, 1)), "B", normalized=True),
    }
    made.mesh(attributes, made.accessor([0, 1, 2, 3], "B"), mode=5, targets=[{"POSITION": made.accessor(points)}])
    extension = {"KHR_texture_transform": {"offset": [0.1, 0], "rotation": 0.1, "scale": [0.5, 0.5], "texCoord": 1}}
    material = made.material(
        name="skin", pbrMetallicRoughness={"baseColorTexture": {"index": 0, "extensions": extension}}
    )
    made.tree["meshes"][0]["primitives"][0]["material"] = material
    made.tree["meshes"][0]["weights"] = [0.25]
    binds = made.accessor(np.stack([np.eye(4).ravel()] * 2))
    made.tree["skins"] = [{"joints": [1, 2], "inverseBindMatrices": binds}]
    made.tree["nodes"] = [
        {"mesh": 0, "skin": 0, "name": "head"},
        {"rotation": [0, 0, 0.6, 0.8], "children": [2]},
        {"matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1], "scale": [2, 2, 2]},
    ]
    made.tree["scenes"] = [{"nodes": [0, 1]}]
    return made


def _exported(obj: Path, suffix: str) -> bytes:
    import trimesh

    mesh = trimesh.load(obj, process=False, force="mesh")
    out = io.BytesIO()
    mesh.export(out, file_type=suffix[1:])
    return out.getvalue()


def damage_mesh(seeds: Seeds, rng: Random) -> tuple[str, bytes]:
    (suffix, seed), (_, other) = rng.choice(seeds), rng.choice(seeds)
    if suffix in (".obj", ".off") and rng.random() < 0.7:
        return suffix, damaged_text(seed.decode(), rng).encode("utf-8", "surrogateescape")
    return suffix, damaged_bytes(seed, other, rng)


def read_any_mesh(path: Path) -> None:
    from skinbake.io.mesh import mesh_files, read_mesh

    assert mesh_files(path)[0] == path
    mesh = read_mesh(path, 1.0, any_size=True, without_uvs=True)
    assert len(mesh.faces) > 0
    assert mesh.faces.min() >= 0
    assert mesh.faces.max() < len(mesh.positions_mm)
    for name in ("positions_mm", "corner_uv", "corner_normal"):
        assert np.isfinite(getattr(mesh, name)).all(), name
    assert np.abs(np.linalg.norm(mesh.corner_normal, axis=2)).max() < 1 + 1e-6


# Images --------------------------------------------------------------------------------------------------------------


def _small_image() -> np.ndarray:
    return np.random.default_rng(0).random((5, 7, 3), dtype=np.float32)


@cache
def exr_seeds() -> Seeds:
    from skinbake.io.exr import write_parts
    from skinbake.io.irradiance import write_irradiance
    from skinbake.irradiance import IrradianceMap

    image, found = _small_image(), []
    lights = IrradianceMap(
        1001, ("key", "rim"), np.stack([image, image]), np.ones((2, 5, 7), np.float32), np.ones((5, 7), np.float32)
    )
    with TemporaryDirectory() as folder:
        path = Path(folder) / "seed.exr"
        for compression in ("none", "rle", "zips", "zip", "piz", "htj2k"):
            for precision in ("half", "float"):
                write_irradiance(
                    path, lights, {"key": "a", "rim": "b"}, {"skinbake:version": "0"}, precision, compression
                )
                found.append((".exr", path.read_bytes()))
        from skinbake.io.exr import Part, rgb_channels

        write_parts(path, [Part("", rgb_channels(image))])
        found.append((".exr", path.read_bytes()))
    return tuple(found)


def damage_binary(seeds: Seeds, rng: Random) -> tuple[str, bytes]:
    (suffix, seed), (_, other) = rng.choice(seeds), rng.choice(seeds)
    return suffix, damaged_bytes(seed, other, rng)


def read_exr(path: Path) -> None:
    """Every way an EXR comes in: header, parts, irradiance, keys, a lobe."""
    from skinbake.io.exr import read_attributes, read_parts
    from skinbake.io.irradiance import part_keys, read_irradiance
    from skinbake.io.lobes import read_summary

    refusals = []
    for read in (read_attributes, read_parts, part_keys):
        try:
            read(path)
        except SkinbakeError as error:
            refusals.append(error)
    lobe = path.with_name("lobe_0.exr")
    path.rename(lobe)
    read_summary(lobe.parent, "a", (1001,), False)
    found = read_irradiance(lobe, 1001)
    assert np.isfinite(found.rgb).all()
    assert (found.rgb >= 0).all()
    if refusals:
        raise refusals[0]


@cache
def image_seeds() -> Seeds:
    import OpenImageIO as oiio

    found, image = [], _small_image()
    with TemporaryDirectory() as folder:
        for name in ("a.png", "b.png", "a.jpg", "a.tif", "b.tif", "a.hdr", "a.exr", "a.tga", "a.bmp", "a.dpx"):
            kind = oiio.UINT16 if name.startswith("b") else oiio.FLOAT if name[2:] in ("hdr", "exr") else oiio.UINT8
            path = Path(folder) / name
            out = oiio.ImageOutput.create(str(path))
            out.open(str(path), oiio.ImageSpec(7, 5, 3, kind))
            out.write_image(image)
            out.close()
            found.append((path.suffix, path.read_bytes()))
    return tuple(found)


def read_image(path: Path) -> None:
    from skinbake.io.read_maps import read_maps
    from skinbake.scene.map_files import MapsSpec

    one = {"path": str(path), "channel": "g"}  # colours that differ are refused where one number is wanted
    normal = {"path": str(path), "encoding": "unsigned"}  # float maps do not say
    maps = MapsSpec.model_validate({"albedo": str(path), "normal": normal, "roughness": one})
    found = read_maps(maps)
    for values in (found.albedo[1001], found.normal[1001], found.roughness[1001]):
        assert values.dtype == np.float32
        assert np.isfinite(values).all()
    assert found.albedo[1001].min() >= 0
    assert found.albedo[1001].max() <= 1


@cache
def table_seeds() -> Seeds:
    return ((".csv", b"\xef\xbb\xbfr_mm,R,G,B,x\n# note\n0,1,1,1,0\n0.5,0.25,0.2,0.1,0\n1e1,1e-9,0,0,0\n\n"),)


def damage_table(seeds: Seeds, rng: Random) -> tuple[str, bytes]:
    suffix, seed = seeds[0]
    return suffix, damaged_text(seed.decode(), rng).encode("utf-8", "surrogateescape")


def read_table(path: Path) -> None:
    from skinbake.io.table import read_profile_csv

    radius, rgb = read_profile_csv(path)
    assert np.isfinite(radius).all()
    assert np.isfinite(rgb).all()
    assert (np.diff(radius) > 0).all()


TARGETS = {
    "look": Target(look_seeds, damage_yaml, read_look),
    "skin": Target(skin_seeds, damage_yaml, read_skin),
    "overrides": Target(
        lambda: tuple((".txt", line.encode()) for line in RIGHT_OVERRIDES), damage_overrides, read_overrides
    ),
    "batch": Target(batch_seeds, damage_yaml, read_batch),
    "manifest": Target(manifest_seeds, damage_json, read_manifest_file),
    **{
        suffix[1:]: Target(lambda suffix=suffix: mesh_seeds(suffix), damage_mesh, read_any_mesh)
        for suffix in (".obj", ".glb", ".ply", ".stl", ".off")
    },
    "gltf": Target(lambda: mesh_seeds(".gltf"), damage_json, read_any_mesh),
    "exr": Target(exr_seeds, damage_binary, read_exr),
    "image": Target(image_seeds, damage_binary, read_image),
    "transfer": Target(lambda: ((".json", _transfer_files()["relight.json"]),), damage_json, read_transfer),
    "report": Target(report_seeds, damage_json, read_report),
    "profile": Target(profile_seeds, damage_json, read_profile),
    "lobe": Target(lobe_seeds, damage_json, read_lobe_header),
    "relight": Target(relight_seeds, damage_json, read_relight),
    "export": Target(export_seeds, damage_json, read_export_list),
    "cache": Target(cache_seeds, damage_binary, read_cache_entry),
    "table": Target(table_seeds, damage_table, read_table),
}
