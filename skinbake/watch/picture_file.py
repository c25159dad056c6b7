"""Shows a watched look as one file, watch.png, that a viewer of pictures reads again when it changes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinbake.baking.verdict import as_typed
from skinbake.io.atomic import write_bytes
from skinbake.io.output_names import PICTURE, refuse_foreign
from skinbake.io.png import write_png
from skinbake.preview.camera import camera_of
from skinbake.preview.draw import OffscreenRenderer
from skinbake.preview.mode import Mode
from skinbake.preview.picture_part import refuse_picture_too_large
from skinbake.preview.views import tone_map
from skinbake.watch.draft import Draft

NAME = "watch.png"


class PictureFile:
    """A `Screen` that is a file. Drafts have one point a pixel; a bake's own picture is taken as it is.

    Parameters
    ----------
    folder : Path
        Of the file.

    Raises
    ------
    InputError
        Another program's file has its name.
    """

    separate = False

    def __init__(self, folder: Path) -> None:
        self.path = folder / NAME
        refuse_foreign([self.path])
        self._renderer: OffscreenRenderer | None = None

    def ready_draft(self, draft: Draft) -> bytes | NDArray[np.uint8]:
        """The draft drawn, sRGB of shape (H, W, 3)."""
        look, renderer = draft.spec.preview, self._renderer
        refuse_picture_too_large(look.size)
        if (
            renderer is not None
            and renderer.scene.mesh is draft.scene.mesh
            and renderer.scene.tiles == draft.scene.tiles
        ):
            renderer.set_scene(draft.scene)
        else:
            if renderer is not None:
                renderer.close()
            self._renderer = renderer = OffscreenRenderer(draft.scene)
        camera = camera_of(draft.scene.mesh, look, look.size[0] / look.size[1])
        return tone_map(
            renderer.draw(camera, look.size, Mode("full"), supersample=1), look.background_rgb, look.exposure
        )

    def ready_bake(self, folder: Path) -> bytes | NDArray[np.uint8]:
        """The picture of a bake, as it is in its file."""
        return (folder / PICTURE).read_bytes()

    def show(self, ready: bytes | NDArray[np.uint8]) -> str:
        """Write the file; its path."""
        if isinstance(ready, bytes):
            write_bytes(self.path, ready)
        else:
            write_png(self.path, ready)
        return as_typed(self.path)

    def fault(self, text: str) -> None:
        """The last good picture stays."""
