"""Pictures of a bake, read from its folder or still in memory."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from skinbake import pipeline
from skinbake.diffuse import DiffuseMap
from skinbake.io.bake_folder import half_maps
from skinbake.io.exr import Part, rgb_channels, write_parts
from skinbake.io.lobes import StoredLobe
from skinbake.io.png import write_png
from skinbake.irradiance import IrradianceMap
from skinbake.preview.camera import view
from skinbake.preview.draw import OffscreenRenderer
from skinbake.preview.mode import Mode, parse_mode
from skinbake.preview.platform import any_thread
from skinbake.preview.scene import PreviewLobe, PreviewScene, Texture
from skinbake.preview.views import View, plan_views, side_by_side, tone_map
from skinbake.scene.spec import PreviewSpec, SceneSpec
from skinbake.stored_precision import as_stored

T = TypeVar("T")


def render(
    renderer: OffscreenRenderer,
    look: PreviewSpec,
    out: Path,
    png: Path | str | None = None,
    exr: bool = False,
    views: Sequence[str] = (),
    turntable: int | None = None,
    size: tuple[int, int] | None = None,
    compare: bool = False,
    mode: str = "full",
    gains: dict[str, list[float]] | None = None,
    exposure: float | None = None,
    supersample: int = 2,
    say: Callable[[Path], None] | None = None,
) -> list[Path]:
    """Render pictures into the folder `out` and give the paths of the PNGs; the defaults render out/preview.png."""
    size = size or look.size
    shown = parse_mode(mode, len(renderer.scene.lobes))
    planned: list[View] = plan_views(renderer.scene.mesh, views or [look.view], turntable, size[0] / size[1])
    written = []
    for each in planned:
        modes = [Mode("none"), shown] if compare else [shown]
        frames = [renderer.draw(each.camera, size, m, gains, supersample) for m in modes]
        image = side_by_side(frames)
        name = "preview" if len(planned) == 1 else f"preview_{each.name}"
        path = Path(png) if png else out / f"{name}{'_compare' if compare else ''}.png"
        write_png(path, tone_map(image, look.background_rgb, look.exposure if exposure is None else exposure))
        if exr:
            channels = rgb_channels(image.rgba[..., :3]) | {"A": image.rgba[..., 3]}
            write_parts(path.with_suffix(".exr"), [Part("preview", channels)], precision="float")
        written.append(path)
        if say:
            say(path)
    return written


class PreviewWorker:
    """Draws the picture of a bake; a context manager.

    All on one thread, since an OpenGL context belongs to one. While textures are computed, it makes everything ready
    that needs none: libraries, context, mesh and shader.
    """

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1, "preview") if any_thread() else None
        self._studio: Future[OffscreenRenderer] | None = None

    def _do(self, work: Callable[..., T], *arguments: Any) -> Future[T]:
        if self._thread:
            return self._thread.submit(work, *arguments)
        done: Future[T] = Future()
        try:
            done.set_result(work(*arguments))
        except Exception as fault:
            done.set_exception(fault)
        return done

    def prepare(self, stand_in: PreviewScene, look: PreviewSpec) -> None:
        """Begin, without waiting; faults are told by `draw`. What `stand_in` has not as in the end costs a shader."""

        def ready() -> OffscreenRenderer:
            renderer = OffscreenRenderer(stand_in)
            try:
                renderer.draw(view(stand_in.mesh, look.view, 1.0), (1, 1))  # compiles
            except BaseException:
                renderer.close()
                raise
            return renderer

        self._studio = self._do(ready)

    def draw(self, scene: PreviewScene, look: PreviewSpec, out: Path) -> None:
        """out/preview.png of a scene with the mesh that was prepared."""
        assert self._studio is not None
        renderer = self._studio.result()

        def work() -> None:
            renderer.set_scene(scene)
            render(renderer, look, out)

        self._do(work).result()

    def __enter__(self) -> PreviewWorker:
        return self

    def __exit__(self, *_: object) -> None:
        if self._studio is not None and self._studio.exception() is None:
            self._do(self._studio.result().close).result()
        if self._thread:
            self._thread.shutdown()


def scene_of(
    spec: SceneSpec, scene: pipeline.SceneData, irradiance: Sequence[IrradianceMap], result: DiffuseMap
) -> PreviewScene:
    """What `read_bake_folder` would read, lights summed, without waiting for the files; of `StoredLobe`s."""
    precision = spec.output.precision
    lobes = tuple(
        PreviewLobe(
            {tile: total[None] for tile, total in lobe.total.items()},
            lobe.weight_rgb,
            None if lobe.transmitted else lobe.variance_mm2,
        )
        for lobe in result.lobes
        if isinstance(lobe, StoredLobe)
    )
    return _scene(
        spec,
        scene,
        lobes,
        {tile.tile: as_stored(tile.rgb, precision) for tile in irradiance},
        {tile.tile: as_stored(tile.visibility[..., None], precision)[..., 0] for tile in irradiance},
    )


def stand_in_of(spec: SceneSpec, scene: pipeline.SceneData, tiles: Sequence[int], lobes: int) -> PreviewScene:
    """A scene that the same shader draws as that of `scene_of`, with textures of one texel."""
    lights, maps = len(spec.lights), scene.maps
    names = ("albedo", "normal", "roughness", "specular")
    small: dict[str, Any] = {n: {tile: image[:1, :1] for tile, image in getattr(maps, n).items()} for n in names}
    lobe = PreviewLobe({tile: np.zeros((1, 1, 1, 3), np.float16) for tile in tiles}, (0, 0, 0), 1.0)
    return _scene(
        spec,
        replace(scene, maps=replace(maps, **small)),
        (lobe,) * lobes,
        {tile: np.zeros((lights, 1, 1, 3), np.float16) for tile in tiles},
        {tile: np.zeros((lights, 1, 1), np.float16) for tile in tiles},
    )


def _scene(
    spec: SceneSpec,
    scene: pipeline.SceneData,
    lobes: tuple[PreviewLobe, ...],
    irradiance: Mapping[int, Texture],
    visibility: Mapping[int, Texture],
) -> PreviewScene:
    return PreviewScene(
        scene.mesh,
        spec.lights,
        lobes,
        irradiance,
        visibility,
        half_maps(scene.maps),
        spec.texturing,
        spec.specular,
        pipeline.energy_conservation(spec).kept,
        separate=False,
    )
