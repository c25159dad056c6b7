"""Builds the baked head in Blender: mesh, textures, a node group with a slider a light, a camera.

In Blender, open it in the Scripting tab and run it, or start `blender --python skin_blender.py`. With bpy as a module,
`python skin_blender.py --render picture.exr` renders with Cycles, and `--save head.blend` saves. The files that it was
exported with must stay beside it.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
from mathutils import Matrix

METRES_PER_MM, PI = 0.001, 3.14159265358979
LINEAR, PLAIN = "Linear Rec.709", "Non-Color"


class _Nodes:
    """Makes nodes in columns, and links them: a number, a colour or a socket may be the input of each."""

    def __init__(self, tree: Any, folder: Path) -> None:
        self.tree, self.folder, self.count = tree, folder, 0

    def node(self, kind: str, x: float, **settings: Any) -> Any:
        """A node of a kind; `x` is its column."""
        made = self.tree.nodes.new(kind)
        self.count += 1
        made.location = (260 * x, -80 * self.count)
        for name, value in settings.items():
            setattr(made, name, value)
        return made

    def feed(self, socket: Any, value: Any) -> None:
        """Link an output to a socket, or set its value."""
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, socket)
        else:
            socket.default_value = value

    def math(self, operation: str, *inputs: Any, x: float = 3, clamp: bool = False) -> Any:
        """A sum, product ... of numbers."""
        made = self.node("ShaderNodeMath", x, operation=operation, use_clamp=clamp)
        for socket, value in zip(made.inputs, inputs, strict=False):
            self.feed(socket, value)
        return made.outputs[0]

    def vector(self, operation: str, *inputs: Any, x: float = 3) -> Any:
        """A sum, product ... of colours."""
        made = self.node("ShaderNodeVectorMath", x, operation=operation)
        for socket, value in zip(made.inputs, inputs, strict=False):
            self.feed(socket, value)
        return made.outputs["Value" if operation == "DOT_PRODUCT" else "Vector"]

    def image(self, name: str, tiles: list[int], space: str = PLAIN, at: Any = None) -> Any:
        """The colour of a texture, read bilinearly, at the mesh's UVs or at those given."""
        first = name.replace("<UDIM>", str(tiles[0]))
        image = bpy.data.images.load(str(self.folder / first), check_existing=True)
        if "<UDIM>" in name and image.source != "TILED":
            image.source = "TILED"
            image.filepath = str(self.folder / name)
            for tile in tiles[1:]:
                image.tiles.new(tile_number=tile)
        image.colorspace_settings.name = space
        image.alpha_mode = "NONE"
        made = self.node("ShaderNodeTexImage", 1, image=image, interpolation="Linear", extension="EXTEND", label=name)
        if at is not None:
            self.feed(made.inputs["Vector"], at)
        return made.outputs["Color"]


def skin_group(about: dict[str, Any], folder: Path) -> Any:
    """Node group: weights times lobes, each light with its own strength and colour, and what of it the oil lets out."""
    tree = bpy.data.node_groups.new("Skinbake", "ShaderNodeTree")
    nodes, tiles = _Nodes(tree, folder), about["tiles"]
    for light in about["lights"]:
        strength = tree.interface.new_socket(light, in_out="INPUT", socket_type="NodeSocketFloat")
        strength.default_value, strength.min_value, strength.max_value = 1.0, 0.0, 10.0
        colour = tree.interface.new_socket(f"{light} colour", in_out="INPUT", socket_type="NodeSocketColor")
        colour.default_value = (1, 1, 1, 1)
    tree.interface.new_socket("Radiance", in_out="OUTPUT", socket_type="NodeSocketColor")
    tree.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    asked = nodes.node("NodeGroupInput", 0).outputs
    gains = [nodes.vector("SCALE", asked[f"{light} colour"], x=1) for light in about["lights"]]
    for light, gain in zip(about["lights"], gains, strict=True):
        nodes.feed(gain.node.inputs["Scale"], asked[light])
    radiance: Any = (0.0, 0.0, 0.0)
    for lobe in about["lobes"]:
        light_of_all: Any = (0.0, 0.0, 0.0)
        for image, gain in zip(lobe["images"], gains, strict=True):
            light_of_all = nodes.vector("MULTIPLY_ADD", nodes.image(image, tiles, LINEAR), gain, light_of_all, x=2)
        # Radiance is exitance over pi
        weight: Any = tuple(w / PI for w in lobe["weight_rgb"])
        if lobe["weight_image"]:  # where maps vary the skin
            weight = nodes.vector("MULTIPLY", nodes.image(lobe["weight_image"], tiles), (1 / PI,) * 3)
        radiance = nodes.vector("MULTIPLY_ADD", light_of_all, weight, radiance)
    if about["albedo_after"]:
        radiance = nodes.vector("MULTIPLY", radiance, nodes.image(about["albedo_after"], tiles, LINEAR), x=4)
    if about["oil"]:
        radiance = nodes.vector("SCALE", radiance, x=5)
        nodes.feed(radiance.node.inputs["Scale"], _passed_by_oil(nodes, about["oil"], tiles))
    shine = nodes.node("ShaderNodeEmission", 6)
    nodes.feed(shine.inputs["Color"], radiance)
    out = nodes.node("NodeGroupOutput", 7).inputs
    nodes.feed(out["Radiance"], radiance)
    nodes.feed(out["Shader"], shine.outputs[0])
    return tree


def _passed_by_oil(nodes: _Nodes, oil: dict[str, Any], tiles: list[int]) -> Any:
    """1 - rho_s A(N.V, m): what the oil layer does not reflect of light that leaves towards the camera."""
    at = nodes.node("ShaderNodeNewGeometry", 0).outputs
    normal = at["Normal"]
    if oil["normal"]:
        bent = nodes.node("ShaderNodeNormalMap", 2, space=oil["normal_space"].upper())
        nodes.feed(bent.inputs["Color"], nodes.image(oil["normal"], tiles))
        normal = bent.outputs[0]
    cosine = nodes.vector("DOT_PRODUCT", normal, at["Incoming"])
    roughness: Any = oil["roughness"]
    if isinstance(roughness, str):
        roughness = nodes.math("MAXIMUM", nodes.image(roughness, tiles), oil["roughness_min"])
    # The table's columns are sqrt(m), its rows sqrt(N.V), from the first texel's centre to the last one's
    across = nodes.node("ShaderNodeCombineXYZ", 4)
    for socket, value, size in zip(across.inputs, (roughness, cosine), oil["table_size"], strict=False):
        root = nodes.math("POWER", nodes.math("ADD", value, 0.0, clamp=True), 0.5)
        nodes.feed(socket, nodes.math("MULTIPLY_ADD", root, (size - 1) / size, 0.5 / size))
    split = nodes.node("ShaderNodeSeparateColor", 4)
    nodes.feed(split.inputs[0], nodes.image(oil["table"], [1001], at=across.outputs[0]))
    albedo = nodes.math("MULTIPLY_ADD", split.outputs[0], oil["f0"], split.outputs[1], x=4)
    if oil["specular"]:
        albedo = nodes.math("MULTIPLY", albedo, nodes.image(oil["specular"], tiles), x=4)
    reflected = nodes.math("MULTIPLY", albedo, oil["strength"], x=4, clamp=True)
    return nodes.math("SUBTRACT", 1.0, reflected, x=4)


def build(about: dict[str, Any], folder: Path) -> Any:
    """The head with its material, and a camera at the look's view, in a scene of its own."""
    scene = bpy.data.scenes.new("Skinbake")
    context: dict[str, Any] = {"scene": scene, "view_layer": scene.view_layers[0]}
    if bpy.context.window:
        bpy.context.window.scene = scene
    before = set(bpy.data.objects)
    with bpy.context.temp_override(**context):
        bpy.ops.wm.obj_import(
            filepath=str(folder / about["mesh"]), global_scale=METRES_PER_MM, forward_axis="NEGATIVE_Z", up_axis="Y"
        )
    (head,) = set(bpy.data.objects) - before
    material = bpy.data.materials.new("Skin")
    if material.node_tree is None:  # before Blender 5
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    group = tree.nodes.new("ShaderNodeGroup")
    group.node_tree, group.width = skin_group(about, folder), 240
    out = tree.nodes.new("ShaderNodeOutputMaterial")
    out.location = (320, 0)
    tree.links.new(group.outputs["Shader"], out.inputs["Surface"])
    head.data.materials.clear()
    head.data.materials.append(material)
    look_at(scene, about["camera"])
    return scene


def look_at(scene: Any, camera: dict[str, Any]) -> None:
    """A camera like the preview's, and pictures of its size, before nothing."""
    lens = bpy.data.cameras.new("Skinbake")
    lens.sensor_fit, lens.angle, lens.clip_start = "VERTICAL", camera["yfov_rad"], 0.01
    eye = bpy.data.objects.new("Skinbake camera", lens)
    scene.collection.objects.link(eye)
    scene.camera = eye
    right, up, back = camera["pose"]
    rows = [[*row[:3], row[3] * METRES_PER_MM] for row in (right, [-value for value in back], up)]  # y up becomes z up
    eye.matrix_world = Matrix([*rows, [0, 0, 0, 1]])
    render = scene.render
    render.resolution_x, render.resolution_y = camera["size"]
    render.film_transparent = True
    scene.view_settings.view_transform = "Standard"
    scene.view_settings.exposure = camera["exposure"]
    render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.pixel_filter_type, scene.cycles.use_denoising = 64, "BOX", False


def render_to(scene: Any, picture: Path) -> None:
    """One linear float picture by Cycles."""
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(picture.absolute())
    bpy.ops.render.render(write_still=True, scene=scene.name)


def own_folder() -> Path:
    """Where this script lies, also where it runs as a text of Blender's."""
    texts = [text.filepath for text in bpy.data.texts if Path(text.filepath).name == "skin_blender.py"]
    here = Path(__file__)
    return here.parent if here.is_file() or not texts else Path(bpy.path.abspath(texts[0])).parent


def main(arguments: list[str]) -> None:
    """Build, and do what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--render", type=Path, help="Linear EXR to render to, with Cycles.")
    parser.add_argument("--save", type=Path, help="Blend file to save.")
    asked = parser.parse_args(arguments)
    folder = own_folder().absolute()
    scene = build(json.loads((folder / "skin_blender.json").read_text(encoding="utf-8")), folder)
    actions: list[tuple[Path | None, Callable[[Path], Any]]] = [
        (asked.save, lambda path: bpy.ops.wm.save_as_mainfile(filepath=str(path.absolute()))),
        (asked.render, lambda path: render_to(scene, path)),
    ]
    for path, action in actions:
        if path is not None:
            action(path)


if __name__ == "__main__":
    started_by_blender = Path(sys.argv[0]).name != Path(__file__).name
    after = sys.argv.index("--") + 1 if "--" in sys.argv else len(sys.argv)  # Blender's own arguments end at --
    main(sys.argv[after if started_by_blender else 1 :])
