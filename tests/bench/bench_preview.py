"""Frames a second of the preview beside pyrender's own shader: same mesh, camera, lights, samples a pixel, in one run.

`python -m tests.bench.bench_preview [head.obj]`. Frames alternate, so that whatever else the machine does slows both.
Targets: with six lobes, at least 0.8 times the speed of pyrender's shader, which has one texture and no scattering;
with a map of widths at least 0.9 times the speed without.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from skinbake.io.mesh import read_mesh
from skinbake.preview.camera import view
from skinbake.preview.draw import OffscreenRenderer
from skinbake.preview.geometry import vertex_buffers
from skinbake.preview.mode import Mode
from skinbake.preview.scene import PreviewLobe, PreviewScene
from skinbake.profile.weight_table import WeightTable, even_nodes
from skinbake.scene.lights import DirectionalLight
from skinbake.scene.maps import SkinMaps
from tests.shapes import sphere

TARGET = 0.8
TARGET_VARYING = 0.9
LOBE_SIZES = (2048, 2048, 1024, 1024, 512, 256)
FRAMES = 15
HEAD = Path(__file__).parents[2] / "data" / "head.obj"


def bench_scene(path: Path) -> PreviewScene:
    """The sample head (or a sphere of as many triangles) with textures of the sizes that a 2048^2 bake stores."""
    mesh = read_mesh(path, 1.0, any_size=True) if path.is_file() else sphere(110.0, "latlong", 144)
    rng = np.random.default_rng(0)

    def texture(size: int, channels: int) -> np.ndarray:
        return rng.random((3, size, size, channels), dtype=np.float32).astype(np.float16)

    lights = tuple(
        DirectionalLight(name=f"light{i}", type="directional", direction=(x, -0.5, z), irradiance=(2.0,) * 3)
        for i, (x, z) in enumerate(((-1, -1), (1, -1), (0.5, 1)))
    )
    lobes = tuple(PreviewLobe({1001: texture(s, 3)}, (0.2,) * 3, 3.0**i / 100) for i, s in enumerate(LOBE_SIZES))
    maps = SkinMaps(
        albedo={1001: np.ones((1024, 1024, 3), np.float16)},
        normal={1001: np.ascontiguousarray(np.broadcast_to(np.array([0, 0, 1], np.float16), (1024, 1024, 3)))},
        roughness={1001: np.full((1024, 1024), 0.3, np.float16)},
    )
    irradiance, visibility = {1001: texture(2048, 3)}, {1001: texture(2048, 1)[..., 0]}
    return PreviewScene(mesh, lights, lobes, irradiance, visibility, maps, energy_conservation=True)


def varying(scene: PreviewScene) -> PreviewScene:
    """The same with weights by a map of widths."""
    rng = np.random.default_rng(1)
    weight = rng.uniform(0.02, 0.3, (17, 1, len(LOBE_SIZES), 3))
    zero = np.zeros((17, 1, 3))
    table = WeightTable(
        ("radius",), (even_nodes(0.5, 1.5, 17), np.zeros(1)), weight, zero, zero, {"radius": 1.0}, False
    )
    y, x = np.mgrid[:1024, :1024] / 1024
    width = (1 + 0.4 * np.sin(7 * x + 3 * y)).astype(np.float32)
    return replace(scene, table=table, maps=replace(scene.maps, radius={1001: width}))


def stock_graph(scene: PreviewScene, camera):
    """The same mesh, camera and lights for pyrender's own renderer, with a texture of 2048^2."""
    import pyrender

    buffers = vertex_buffers(scene.mesh, (1001,))[1001]
    skin = np.random.default_rng(0).integers(90, 200, (2048, 2048, 3)).astype(np.uint8)
    material = pyrender.MetallicRoughnessMaterial(
        baseColorTexture=pyrender.Texture(source=skin, source_channels="RGB"), metallicFactor=0.0, roughnessFactor=0.5
    )
    primitive = pyrender.Primitive(
        buffers.position_mm, buffers.normal, texcoord_0=buffers.uv, indices=buffers.faces, material=material
    )
    graph = pyrender.Scene(bg_color=np.zeros(4))
    graph.add(pyrender.Mesh([primitive]))
    for turn in (-40, 40, 160):
        graph.add(pyrender.DirectionalLight(intensity=2.0), pose=camera.turned(turn).pose)
    lens = pyrender.PerspectiveCamera(yfov=np.radians(camera.yfov_deg), znear=50.0, zfar=5000.0)
    graph.main_camera_node = graph.add(lens, pose=camera.pose)
    return graph


def measure(path: Path, sizes: tuple[int, ...]) -> list[dict]:
    """A row a picture size."""
    rows = []
    scene = bench_scene(path)
    camera = view(scene.mesh, "three-quarter", 1.0)
    with OffscreenRenderer(scene) as renderer:
        from OpenGL import GL
        from pyrender.constants import RenderFlags
        from pyrender.renderer import Renderer

        from skinbake.preview.target import FloatTarget

        class Stock(Renderer):
            """pyrender's renderer as it is, but for reading the frame back, which neither side does here."""

            def _read_main_framebuffer(self, scene, flags):
                return None

        graph, ours = stock_graph(scene, camera), renderer._renderer
        ours.fold = True
        about = f"{renderer.device}: {len(scene.mesh.faces)} triangles, lobes {LOBE_SIZES}, {len(scene.lights)} lights"
        for size in sizes:
            stock = Stock(size, size)
            if ours.target is not None:
                ours.target.delete()
            ours.target = FloatTarget(size, size, samples=4, half=True)

            def draw_ours():
                ours.draw(camera)
                ours.target.resolve()
                GL.glFinish()

            def draw_stock(stock=stock):
                stock.render(graph, RenderFlags.OFFSCREEN)
                GL.glFinish()

            seconds = {"full": [], "none": [], "stock": []}
            for frame in range(FRAMES + 2):
                for name in seconds:
                    start = time.perf_counter()
                    if name == "stock":
                        draw_stock()
                    else:
                        ours.mode = Mode(name)
                        draw_ours()
                    if frame >= 2:  # the first frames compile and upload
                        seconds[name].append(time.perf_counter() - start)
            stock.delete()
            median = {name: float(np.median(values)) for name, values in seconds.items()}
            fps = {f"fps_{name}": 1 / value for name, value in median.items()}
            rows.append(
                {"name": f"{size}^2", "stock_over_ours": median["stock"] / median["full"]} | fps | {"note": about}
            )
    return rows


def measure_varying(path: Path, size: int) -> dict:
    """Frames of skin that a map of widths varies beside frames of the same without, by processor seconds of both."""
    scene = bench_scene(path)
    camera = view(scene.mesh, "three-quarter", 1.0)
    with OffscreenRenderer(scene) as plain, OffscreenRenderer(varying(scene)) as other:
        from OpenGL import GL

        from skinbake.preview.target import FloatTarget

        seconds: dict[str, list[float]] = {"plain": [], "varying": []}
        for frame in range(FRAMES + 3):  # the first ones compile, upload and fold
            for name, opened in (("plain", plain), ("varying", other)):
                opened._platform.make_current()
                ours = opened._renderer
                ours.fold = True
                if ours.target is None:
                    ours.target = FloatTarget(size, size, samples=4, half=True)
                GL.glFinish()
                start = time.process_time()
                ours.draw(camera)
                ours.target.resolve()
                GL.glFinish()
                if frame >= 3:
                    seconds[name].append(time.process_time() - start)
        ratio = float(np.median(seconds["plain"]) / np.median(seconds["varying"]))
        return {"name": f"skin that varies, {size}^2", "plain_over_varying": ratio, "note": plain.device}


def run(quick: bool) -> list[dict]:
    """The sample head, for the runner."""
    return [*measure(HEAD, (256,) if quick else (512, 1024)), measure_varying(HEAD, 256 if quick else 512)]


def main(path: Path = HEAD) -> int:
    """Measure, print, and give 1 where the target is missed."""
    rows = measure(path, (512, 1024))
    print(rows[0]["note"])
    for row in rows:
        print(
            f"{row['name']:>7}  six lobes + specular {row['fps_full']:7.1f} fps   "
            f"without scattering {row['fps_none']:7.1f} fps   pyrender's shader {row['fps_stock']:7.1f} fps   "
            f"ratio {row['stock_over_ours']:.2f}"
        )
    other = measure_varying(path, 512)
    print(f"{other['name']}: {other['plain_over_varying']:.2f} of the frames without, by processor seconds")
    return int(any(row["stock_over_ours"] < TARGET for row in rows) or other["plain_over_varying"] < TARGET_VARYING)


if __name__ == "__main__":
    sys.exit(main(*(Path(argument) for argument in sys.argv[1:])))
