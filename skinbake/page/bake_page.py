"""One HTML page that draws a bake with the preview's own shaders, in any current browser, without a network."""

from __future__ import annotations

import base64
import html
import json
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from skinbake.io.bake_folder import BakeFolder, read_bake_folder
from skinbake.io.manifest import read_manifest
from skinbake.irradiance.oil_albedo import oil_table
from skinbake.page.coded_image import CodedImage, coded, halves
from skinbake.page.page_skies import page_skies
from skinbake.page.page_skins import page_skins
from skinbake.preview import tonemap
from skinbake.preview.camera import PORTRAIT_YFOV_DEG, VIEWS, Camera, camera_of, view
from skinbake.preview.geometry import VertexBuffers, vertex_buffers
from skinbake.preview.mode import NAMES, Mode
from skinbake.preview.normal_levels import normal_levels
from skinbake.preview.scene import PreviewScene
from skinbake.preview.shader_defines import SHADERS, SWITCHES, shader_defines
from skinbake.preview.shader_light import ShaderLight, shader_lights
from skinbake.preview.skin_table import table_bounds, table_images

_VIEWER = Path(__file__).parent / "viewer"
_LABELS = {
    "full": "everything",
    "diffuse": "light from inside the skin",
    "specular": "the oil's reflection",
    "none": "without scattering",
}


def bake_page(folder: Path) -> tuple[str, dict[str, float]]:
    """The page as text, and the rms error of the coding of each kind of texture, relative to its values.

    Parameters
    ----------
    folder : Path
        A bake folder.

    Raises
    ------
    InputError
        A file of the bake is missing or damaged.
    """
    bake, manifest = read_bake_folder(folder), read_manifest(folder)
    lights = shader_lights(bake.scene.lights)
    errors: dict[str, list[float]] = {}
    tiles = [
        _tile(bake.scene, number, buffers, lights, errors)
        for number, buffers in vertex_buffers(bake.scene.mesh, bake.scene.tiles).items()
    ]
    coding = {kind: float(np.max(found)) for kind, found in errors.items()}
    data = _page_data(bake, lights) | {"tiles": tiles}
    told = _add_skies(data, bake, lights, coding) if manifest["relight"] else []
    data["about"] = [*_about(bake, manifest, coding), *told]
    title = html.escape(str(data["title"]))
    # "<" would end the element; JSON has it as an escape too
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    page = (_VIEWER / "viewer.html").read_text(encoding="utf-8")
    parts = {
        "@TITLE@": title,
        "@STYLE@": (_VIEWER / "viewer.css").read_text(encoding="utf-8"),
        "@SCRIPT@": (_VIEWER / "viewer.js").read_text(encoding="utf-8"),
        "@DATA@": text,
    }
    for mark, content in parts.items():
        page = page.replace(mark, content)
    return page, coding


def _add_skies(
    data: dict[str, Any], bake: BakeFolder, lights: tuple[ShaderLight, ...], coding: dict[str, float]
) -> list[tuple[str, list[str]]]:
    """Add skies to a page's data and their error to `coding`, or say why not, for the last part of the page.

    Parameters
    ----------
    data : dict
    bake : BakeFolder
    lights : tuple of ShaderLight
    coding : dict of str to float
    """
    found = page_skies(bake, lights, len(json.dumps(data, separators=(",", ":"))))
    if found is None:
        return [("Skies", ["left out: with them this page would have more than 20 MB"])]
    coding["skies"] = found.rms
    data["skies"] = found.skies
    for sky in found.skies:
        data["modes"].append({"name": f"sky:{sky['name']}", "label": f"sky: {sky['name']}"})
    for tile in data["tiles"]:
        tile["sky"] = found.tiles[tile["number"]]["textures"]
        tile["defines"]["sky"] = found.tiles[tile["number"]]["defines"]
    return []


def _tile(
    scene: PreviewScene,
    number: int,
    buffers: VertexBuffers,
    lights: tuple[ShaderLight, ...],
    errors: dict[str, list[float]],
) -> dict[str, Any]:
    """Geometry, textures and shader symbols of one tile; what the coding changes is added to `errors` by kind.

    Parameters
    ----------
    scene : PreviewScene
    number : int
        Of the tile.
    buffers : VertexBuffers
    lights : tuple of ShaderLight
    errors : dict of str to list of float
    """
    maps, one = scene.maps, np.ones((1, 1), np.float32)
    textures: dict[str, list[dict[str, Any]]] = {}

    def add(name: str, kind: str, images: Any, coding: str, lossless: bool = False) -> list[CodedImage]:
        made = [coded(image, coding, lossless) for image in images]
        if kind:
            errors.setdefault(kind, []).extend(image.rms / max(image.norm, 1e-30) for image in made)
        textures[name] = [image.record for image in made]
        return made

    lobes: list[list[CodedImage]] = []
    for i, lobe in enumerate(scene.lobes):  # lobes too narrow to be blurred are one image
        same = next((k for k in range(i) if np.array_equal(scene.lobes[k].rgb[number], lobe.rgb[number])), None)
        if same is None:
            lobes.append(add(f"lobe_{i}", "", lobe.rgb[number], "sqrt"))
        else:
            lobes.append(lobes[same])
            textures[f"lobe_{i}"] = [{"same_as": f"lobe_{same}"}]
    weights = [float(np.mean(lobe.weight_rgb)) for lobe in scene.lobes]
    for layer in zip(*lobes, strict=True):  # of what they add up to: a faint lobe may be coarse
        wrong = np.sqrt(sum((weight * image.rms) ** 2 for weight, image in zip(weights, layer, strict=True)))
        whole = sum(weight * image.norm for weight, image in zip(weights, layer, strict=True))
        errors.setdefault("lobes together", []).append(float(wrong / max(whole, 1e-30)))
    add("irradiance", "irradiance", scene.irradiance[number], "sqrt")
    add("visibility", "visibility", scene.visibility[number], "linear")
    constant = np.asarray(maps.albedo_rgb, np.float32).reshape(1, 1, 3)
    add("albedo", "albedo", [maps.albedo.get(number, constant)], "sqrt")
    up = np.array([[[0.0, 0.0, 1.0]]], np.float32)
    add("normal_map", "normals", [maps.normal.get(number, up)], "linear", lossless=True)
    if number in maps.normal:
        coarser = normal_levels(maps.normal[number], maps.normal_strength, maps.normal_space)[1:]
        textures["normal_map"][0]["levels"] = [
            {
                "normal": coded(level[..., :3], "linear", lossless=True).record,
                "variance": coded(level[..., 3], "sqrt", lossless=True).record,
            }
            for level in coarser
        ]
    add("roughness_map", "roughness", [maps.roughness.get(number, scene.specular.roughness * one)], "linear", True)
    if number in maps.f0:
        add("f0_map", "roughness", [maps.f0[number]], "linear", True)
    add("specular_map", "roughness", [maps.specular.get(number, one)], "linear", True)
    if scene.table is not None:
        images = table_images(scene.table, maps, number)
        textures["weight_table"] = [halves(layer) for layer in images.pop("weight_table")]
        for name, image in images.items():
            add(name, "maps of the skin", [image[0, ..., 0]], "linear", lossless=True)
    layers = len(scene.lights) if scene.separate else 1
    defines = {
        str(mode): shader_defines(scene, number, mode, lights, len(scene.lights) if mode.name == "none" else layers)
        for mode in _modes(scene)
    }
    return {"number": number, "textures": textures, "defines": defines} | _geometry(buffers)


def _geometry(buffers: VertexBuffers) -> dict[str, Any]:
    """Vertices as 16-bit shares of their range, an axis after the other, and steps between the corners' numbers."""
    parts, ranges = [], {}
    for name, values in (
        ("position", buffers.position_mm),
        ("normal", buffers.normal),
        ("tangent", buffers.tangent),
        ("uv", buffers.uv),
    ):
        low, high = values.min(axis=0).astype(np.float64), values.max(axis=0).astype(np.float64)
        share = (values - low) / np.where(high > low, high - low, 1.0)
        parts.append(np.rint(65535 * share).astype("<u2").T.tobytes())
        ranges[name] = {"low": low.tolist(), "high": high.tolist()}
    steps = np.diff(buffers.faces.reshape(-1).astype(np.int64), prepend=0).astype("<i4")
    data = zlib.compress(b"".join([*parts, steps.tobytes()]), 9)
    return {
        "geometry": base64.b64encode(data).decode("ascii"),
        "ranges": ranges,
        "vertices": len(buffers.position_mm),
        "indices": int(buffers.faces.size),
    }


def _modes(scene: PreviewScene) -> list[Mode]:
    """What the page can show."""
    return [*(Mode(name) for name in NAMES), *(Mode("lobe", i) for i in range(len(scene.lobes)))]


def _page_data(bake: BakeFolder, lights: tuple[ShaderLight, ...]) -> dict[str, Any]:
    """Everything that is no tile's: lights, weights, shaders, views."""
    scene, look = bake.scene, bake.spec
    width, height = look.preview.size
    table = oil_table(scene.specular).astype("<f4")
    low, high = scene.mesh.positions_mm.min(0), scene.mesh.positions_mm.max(0)
    views = {name: _place(view(scene.mesh, name, width / height)) for name in VIEWS}
    shaders = {
        "skin_frag": "skin.frag",
        "skin_vert": "skin.vert",
        "display_frag": "display.frag",
        "screen_vert": "screen.vert",
    }
    return {
        "title": bake.path.resolve().name,
        "lights": [light.name for light in scene.lights],
        "separate": scene.separate,
        "lobes": [
            {"weight": [float(w) for w in lobe.weight_rgb], "variance_mm2": lobe.variance_mm2} for lobe in scene.lobes
        ],
        "total_weight": scene.total_weight_rgb.tolist(),
        "skins": page_skins(bake),
        "skies": [],
        "table": None if scene.table is None else table_bounds(scene.table).tolist(),
        "albedo_exponent_after": 1 - scene.texturing.exponent_before,
        "normal_strength": scene.maps.normal_strength,
        "f0": scene.specular.f0,
        "strength": scene.specular.strength,
        "shader_lights": {
            "kind": [light.kind for light in lights],
            "light": [light.light for light in lights],
            "at": [[float(x) for x in light.at] for light in lights],
            "axis": [[float(x) for x in light.axis] for light in lights],
            "cosines": [[float(x) for x in light.cosines] for light in lights],
            "color": [[float(x) for x in light.color_rgb] for light in lights],
        },
        "oil": {
            "width": table.shape[1],
            "height": table.shape[0],
            "data": base64.b64encode(table.tobytes()).decode("ascii"),
        },
        "modes": [{"name": str(mode), "label": _label(mode, scene)} for mode in _modes(scene)],
        "switches": list(SWITCHES),
        "shaders": {key: (SHADERS / name).read_text(encoding="utf-8") for key, name in shaders.items()},
        "tonemap": {"TONEMAP_KNEE": str(tonemap.KNEE), "TONEMAP_DESATURATION": str(tonemap.DESATURATION)},
        "views": views,
        "view": look.preview.view,
        "start": _place(camera_of(scene.mesh, look.preview, width / height)),
        "aspect": width / height,
        "yfov": PORTRAIT_YFOV_DEG,
        "centre": ((low + high) / 2).tolist(),
        "radius": float(np.linalg.norm(high - low)) / 2,
        "exposure": look.preview.exposure,
        "background": list(look.preview.background_rgb),
    }


def _place(camera: Camera) -> dict[str, Any]:
    """A camera as the page has it."""
    return {
        "target": [float(x) for x in camera.target_mm],
        "distance": float(camera.distance_mm),
        "azimuth": float(camera.azimuth_deg),
        "elevation": float(camera.elevation_deg),
    }


def _label(mode: Mode, scene: PreviewScene) -> str:
    """A mode in words."""
    if mode.name != "lobe":
        return _LABELS[mode.name]
    variance = scene.lobes[mode.lobe].variance_mm2
    return "light through thin parts" if variance is None else f"lobe of sigma {variance**0.5:.2f} mm"


def _about(bake: BakeFolder, manifest: dict[str, Any], coding: dict[str, float]) -> Iterator[tuple[str, list[str]]]:
    """Headings and lines of the page's last part: errors, plan, where it came from."""
    error = manifest["error"] or {}
    lines = []
    if error.get("rms") is not None:
        lines.append(f"blur: rms {error['rms']:.2%} of the surface integral, at {error['probes']} places of the skin")
    if error.get("texture_size"):
        lines.append(f"texture size: {error['texture_size']:.2%}, estimated")
    if error.get("model"):
        lines.append(f"model: rms {error['model']['rms']:.1%} of light transport")
    shown = ", ".join(f"{kind} {value:.2%}" for kind, value in coding.items())
    yield "Error", [*lines, f"8 bits in this page, rms: {shown}"]
    yield "Plan", [f"{line['term']}: {line['why']}" for line in manifest["plan"]]
    width, height = bake.spec.texture.size
    size = f"{width} x {height} texels, lights {', '.join(light.name for light in bake.scene.lights)}"
    inputs = [f"{role} sha256 {digest[:16]}" for role, digest in manifest["inputs"].items()]
    yield "Baked by", [f"skinbake {manifest['version']}", size, *inputs]
