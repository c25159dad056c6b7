"""Draws the picture of a bake while its files are written."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from skinbake.preview.camera import camera_of, view
from skinbake.preview.draw import OffscreenRenderer
from skinbake.preview.mode import Mode
from skinbake.preview.picture_part import refuse_picture_too_large
from skinbake.preview.platform import any_thread
from skinbake.preview.scene import PreviewScene
from skinbake.preview.views import tone_map
from skinbake.scene.output import PreviewSpec

T = TypeVar("T")


def draw_still(renderer: OffscreenRenderer, look: PreviewSpec) -> NDArray[np.uint8]:
    """The picture that a bake ends with, sRGB of shape (H, W, 3); `render` writes the same one by default."""
    refuse_picture_too_large(look.size)
    camera = camera_of(renderer.scene.mesh, look, look.size[0] / look.size[1])
    return tone_map(renderer.draw(camera, look.size, Mode("full")), look.background_rgb, look.exposure)


class PreviewWorker:
    """Draws the picture of a bake; a context manager.

    All on one thread, since an OpenGL context belongs to one. While textures are computed, it makes everything ready
    that needs none: libraries, context, mesh, shader, and maps if they are there.
    """

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1, "preview") if any_thread() else None
        self._renderer: Future[OffscreenRenderer] | None = None

    def _do(self, work: Callable[..., T], *arguments: Any) -> Future[T]:
        if self._thread:
            return self._thread.submit(work, *arguments)
        done: Future[T] = Future()
        try:
            done.set_result(work(*arguments))
        except Exception as fault:
            done.set_exception(fault)
        return done

    def prepare(self, make_stand_in: Callable[[], PreviewScene], look: PreviewSpec) -> None:
        """Begin, without waiting; faults are told by `draw`.

        Parameters
        ----------
        make_stand_in : callable
            What it has not as in the end costs a shader, and images that are not those of the end are sent anew.
        look : PreviewSpec
        """

        def ready() -> OffscreenRenderer:
            stand_in = make_stand_in()
            renderer = OffscreenRenderer(stand_in)
            try:
                renderer.draw(view(stand_in.mesh, look.view, 1.0), (1, 1))  # compiles, and sends the images
            except BaseException:
                renderer.close()
                raise
            return renderer

        self._renderer = self._do(ready)

    def stand_in(self) -> PreviewScene | None:
        """What was prepared, once it is; None where nothing was.

        Raises
        ------
        MachineError
            There is no OpenGL.
        """
        return self._renderer.result().scene if self._renderer else None

    def draw(
        self, scene: PreviewScene, look: PreviewSpec, sent: Callable[[], None] = lambda: None
    ) -> NDArray[np.uint8]:
        """The picture of a scene with the mesh that was prepared, if any was; sRGB of shape (H, W, 3).

        Parameters
        ----------
        scene : PreviewScene
        look : PreviewSpec
        sent : callable, optional
            Called after each texture that was sent.

        Raises
        ------
        MachineError
            There is no OpenGL.
        """
        prepared = self._renderer is not None
        if self._renderer is None:
            self._renderer = self._do(OffscreenRenderer, scene)
        renderer = self._renderer.result()

        def work() -> NDArray[np.uint8]:
            if prepared:
                renderer.set_scene(scene, sent)
            return draw_still(renderer, look)

        return self._do(work).result()

    def __enter__(self) -> PreviewWorker:
        return self

    def __exit__(self, *_: object) -> None:
        if self._renderer is not None and self._renderer.exception() is None:
            self._do(self._renderer.result().close).result()
        if self._thread:
            self._thread.shutdown()
