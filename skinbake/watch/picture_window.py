"""Shows a watched look in the preview's window, in place: camera, mode and gains stay while pictures change."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from skinbake.baking.window_actions import window_actions
from skinbake.io.bake_folder import read_bake_folder
from skinbake.preview.scene import PreviewScene
from skinbake.preview.window import PreviewWindow
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.output import PreviewSpec
from skinbake.watch.draft import Draft

Shown = tuple[PreviewScene, PreviewSpec, str]


class PictureWindow:
    """A `Screen` that is a window, opened with the first draft.

    Parameters
    ----------
    folder : Path
        Where pictures go that are saved.
    config : path
        The look, into which gains and view are written.

    Attributes
    ----------
    window : PreviewWindow or None
    idle : callable
        Called between frames.
    """

    separate = True

    def __init__(self, folder: Path, config: Path | str) -> None:
        self._actions = replace(window_actions(folder, Path(config)), idle=lambda: self.idle())
        self._mesh: SkinMesh | None = None
        self.window: PreviewWindow | None = None
        self.idle: Callable[[], None] = lambda: None

    def ready_draft(self, draft: Draft) -> Shown:
        """Scene, view and name of a draft."""
        width, height = draft.spec.texture.size
        return self._on_mesh(draft.scene), draft.spec.preview, f"draft, {width} x {height}"

    def ready_bake(self, folder: Path) -> Shown:
        """Scene, view and name of a bake, read."""
        baked = read_bake_folder(folder)
        return self._on_mesh(baked.scene), baked.spec.preview, "as asked"

    def _on_mesh(self, scene: PreviewScene) -> PreviewScene:
        """The scene on the mesh that is shown, where it is the same: what the window has of it stays."""
        if self._mesh is not None and _same(self._mesh, scene.mesh):
            return replace(scene, mesh=self._mesh)
        self._mesh = scene.mesh
        return scene

    def show(self, ready: Shown) -> str:
        """Show it in the window."""
        scene, look, name = ready
        if self.window is None:
            self.window = PreviewWindow(scene, look, actions=self._actions)
        else:
            self.window.set_scene(scene, look)
        self.window.say(name)
        return "in the window"

    def fault(self, text: str) -> None:
        """The last good picture stays, with what is wrong below it."""
        if self.window is not None and text:
            self.window.say(text.splitlines()[0])


def _same(one: SkinMesh, other: SkinMesh) -> bool:
    """Whether two meshes look alike on a graphics card."""
    pairs = ((getattr(one, name), getattr(other, name)) for name in ("positions_mm", "faces", "corner_uv"))
    return one is other or all(np.array_equal(a, b) for a, b in pairs)
