"""The window: pyglet's, with our renderer in it; pyrender's own Viewer would draw through an 8-bit frame buffer."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError, SkinbakeError
from skinbake.preview.camera import VIEWS, Camera, camera_of, same_place, view
from skinbake.preview.controls import Controls, overlay, press
from skinbake.preview.drag_quality import SETTLE_S, DragQuality
from skinbake.preview.draw import PreviewImage
from skinbake.preview.mode import Mode, parse_mode
from skinbake.preview.open_window import open_window
from skinbake.preview.other_skin import OtherSkin, skin_line, with_skin
from skinbake.preview.relit import sky_samples
from skinbake.preview.relit_controls import RelitControls, press_relit
from skinbake.preview.scene import PreviewScene
from skinbake.preview.shader_light import Gains, gains_rgb
from skinbake.preview.views import tone_map
from skinbake.preview.window_state import WindowState, state_of
from skinbake.scene.output import PreviewSpec

if TYPE_CHECKING:
    from skinbake.preview.target import FloatTarget

SAMPLES = 4
ORBIT_DEG_PER_PIXEL = 0.4
IDLE_S = 0.005
_KEYS = {"TAB": "TAB", "UP": "UP", "DOWN": "DOWN", "BRACKETLEFT": "[", "BRACKETRIGHT": "]", "COMMA": ",", "PERIOD": "."}
OTHER_CAMERA = "own camera"  # name of the view where the look has one


@dataclass(frozen=True)
class WindowActions:
    """What the window's keys do outside of it; each gives what to say of it.

    Attributes
    ----------
    save_picture : callable, optional
        Takes pixels (H, W, 3), uint8.
    write_look : callable, optional
        Takes a `WindowState`.
    idle : callable
        Called between frames, often.
    """

    save_picture: Callable[[NDArray[np.uint8]], str] | None = None
    write_look: Callable[[WindowState], str] | None = None
    idle: Callable[[], None] = lambda: None


class PreviewWindow:
    """Window on one scene; frames are drawn when something has changed, coarse ones while the mouse is moved.

    Parameters
    ----------
    scene : PreviewScene
    look : PreviewSpec
    size : (width, height), optional
        In place of the look's.
    mode : str
        As `parse_mode`.
    light_gains : mapping of light name to float or RGB
    exposure : float, optional
        Stops, in place of the look's.
    relit : RelitControls, optional
        The light of a scene of `relit_scene`.
    skins : sequence of OtherSkin
        What K shows one after another on the same lobes, after the skin of the bake.
    actions : WindowActions

    Raises
    ------
    MachineError
        No window can be opened here.
    InputError
        An unknown mode, view or light.
    """

    def __init__(
        self,
        scene: PreviewScene,
        look: PreviewSpec,
        size: tuple[int, int] | None = None,
        mode: str = "full",
        light_gains: Gains | None = None,
        exposure: float | None = None,
        relit: RelitControls | None = None,
        skins: Sequence[OtherSkin] = (),
        actions: WindowActions | None = None,
    ) -> None:
        gains = tuple(gains_rgb(scene, light_gains))
        level = look.exposure if exposure is None else exposure
        self.start = Controls(scene.lights, gains, parse_mode(mode, len(scene.lobes)), level)
        self.controls = self.start
        self.relit = self.start_relit = relit
        self.baked, self.skins, self.shown_skin, self.skin_text = scene, tuple(skins), 0, ""
        self.light_moves = False
        self.scene, self.look, self.actions = scene, look, actions or WindowActions()
        self.view_name: str = OTHER_CAMERA if look.camera else look.view
        width, height = size or look.size
        self.camera: Camera = camera_of(scene.mesh, look, width / height)
        self._from = self.camera  # where the view has it
        self._written = {light.name: np.ones(3) for light in scene.lights}  # gains that the look has by now
        self.fps, self.message = 0.0, ""
        self.changed = True
        self.quality, self.shown_scale, self._moved_at = DragQuality(), 1, -SETTLE_S
        self.window = open_window(
            width,
            height,
            on_key_press=self._on_key_press,
            on_mouse_drag=self._on_mouse_drag,
            on_mouse_scroll=self._on_mouse_scroll,
            on_resize=self._on_change,
            on_expose=self._on_change,
        )
        from skinbake.preview.renderer import SkinRenderer  # PyOpenGL: only with the window's context
        from skinbake.preview.window_screen import WindowScreen

        self._renderer_of = SkinRenderer
        self.renderer = SkinRenderer(scene)
        self.renderer.fold = True
        self._screen = WindowScreen()
        self._targets: dict[int, FloatTarget] = {}

    @property
    def device(self) -> str:
        """Name of the OpenGL renderer."""
        from OpenGL import GL

        return str(GL.glGetString(GL.GL_RENDERER).decode())

    def run(self) -> None:
        """Draw and react until the window is closed."""
        import pyglet

        try:
            while not self.window.has_exit:
                pyglet.clock.tick()
                self.window.dispatch_events()
                self.actions.idle()
                settled = time.monotonic() - self._moved_at > SETTLE_S
                if self.window.has_exit:
                    break
                if self.changed or (settled and self.shown_scale > 1):
                    self.frame()
                else:
                    time.sleep(IDLE_S)
        finally:
            self.close()

    def frame(self, flip: bool = True) -> None:
        """Draw one frame and show it; without `flip` it stays in the back buffer."""
        from OpenGL import GL

        start = time.perf_counter()
        self.window.switch_to()
        size = self.window.get_framebuffer_size()
        moving = time.monotonic() - self._moved_at <= SETTLE_S
        scale = self.quality.scale if moving else 1
        target = self._drawn(scale, size)
        # The rate on the screen changes a texture; while the mouse is moved it is that of the frames so far
        self._screen.show(self.renderer, target, size, self.lines, self.look.background_rgb, self.controls.exposure)
        GL.glFinish()
        seconds = time.perf_counter() - start
        self.fps = 1 / seconds if self.fps == 0 or scale != self.shown_scale else 0.8 * self.fps + 0.2 / seconds
        if moving or scale == 1:
            self.quality = DragQuality(scale).after(seconds) if moving else self._quality_after_fine(seconds)
        if flip:
            self.window.flip()
        self.changed, self.shown_scale = False, scale

    def _quality_after_fine(self, seconds: float) -> DragQuality:
        """What the next drag begins with: what the last one ended with, if a fine frame is too slow for it."""
        return max(self.quality, DragQuality().after(seconds), key=lambda quality: quality.scale)

    def _drawn(self, scale: int, size: tuple[int, int]) -> FloatTarget:
        """A frame of so many pixels of the screen a side of its own, resolved."""
        from skinbake.preview.target import FloatTarget

        renderer = self.renderer
        wanted = (max(size[0] // scale, 1), max(size[1] // scale, 1))
        target = self._targets.get(scale)
        if target is None or (target.width, target.height) != wanted:
            if target is not None:
                target.delete()
            target = FloatTarget(*wanted, samples=SAMPLES if scale == 1 else 1, half=True)
            self._targets[scale] = target
        renderer.target = target
        renderer.mode = self.controls.mode
        if self.relit is None:
            renderer.gains_rgb = self.controls.gains_rgb
            renderer.set_lights(self.controls.lights)
        else:
            light = self.relit.light
            assert self.scene.basis is not None
            sky = light.mirrored_sky(sky_samples(self.device))
            renderer.show_later(light.coefficients(self.scene.basis), sky, light.mirrored_suns)
            renderer.fold = not self.light_moves  # summing every texel pays where the next frame has the same light
        renderer.draw(self.camera)
        target.resolve()
        return target

    @property
    def lines(self) -> list[str]:
        """Lines of text over the picture."""
        moved = "" if same_place(self.camera, self._from) else ", moved"
        first, *others = overlay(self.controls, self.scene, self.fps, self.relit, self.view_name + moved)
        return [line for line in (first, self.skin_text, *others, self.message) if line]

    def state(self) -> WindowState:
        """What was set, since the look was last written."""
        own = self.view_name == OTHER_CAMERA
        camera = self.camera if own or not same_place(self.camera, self._from) else None
        return state_of(self.controls, self._written, self.look.view if own else self.view_name, camera)

    def set_scene(self, scene: PreviewScene, look: PreviewSpec) -> None:
        """Show another bake in place, from where the camera stands; lights that are as they were keep their gains.

        Parameters
        ----------
        scene : PreviewScene
        look : PreviewSpec
        """
        self.window.switch_to()
        if scene.mesh is self.scene.mesh and scene.tiles == self.scene.tiles:
            self.renderer.set_scene(scene)
        else:
            self.renderer.target = None
            self.renderer.delete()
            self.renderer = self._renderer_of(scene)
            self.renderer.fold = True
        before = {light.name: (light, gain) for light, gain in zip(self.start.lights, self.controls.gains, strict=True)}
        kept = {name: gain for name, (light, gain) in before.items() if light in scene.lights}
        ones = np.ones(3)
        gains = tuple(kept.get(light.name, ones) for light in scene.lights)
        written = {name: self._written[name] for name in kept}
        self._written = {light.name: written.get(light.name, ones) for light in scene.lights}
        exposure = self.controls.exposure if look.exposure == self.look.exposure else look.exposure
        width, height = self.window.get_size()
        if (look.view, look.camera) != (self.look.view, self.look.camera):
            self.view_name = OTHER_CAMERA if look.camera else look.view
            self.camera = self._from = camera_of(scene.mesh, look, width / height)
        self.start = Controls(scene.lights, tuple(np.ones(3) for _ in scene.lights), self.start.mode, look.exposure)
        mode = self.controls.mode
        mode = mode if mode.name != "lobe" or mode.lobe < len(scene.lobes) else Mode("full")
        selected = min(self.controls.selected, len(scene.lights) - 1)
        self.controls = replace(
            self.controls, lights=scene.lights, gains=gains, exposure=exposure, mode=mode, selected=selected,
            moved=frozenset(),
        )  # fmt: skip
        self.scene, self.look, self.changed = scene, look, True
        self.baked, self.shown_skin, self.skin_text = scene, 0, ""

    def say(self, message: str) -> None:
        """Show a message below the lights; empty takes it away."""
        self.message, self.changed = message, True

    def pixels(self) -> NDArray[np.uint8]:
        """Pixels that the window would show now, (H, W, 3), row 0 at the top."""
        from OpenGL import GL

        self._moved_at = -SETTLE_S
        self.frame(flip=False)  # the front buffer cannot be read everywhere
        width, height = self.window.get_framebuffer_size()
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, 0)
        GL.glReadBuffer(GL.GL_BACK)
        GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
        shown = np.empty((height, width, 3), np.uint8)
        GL.glReadPixels(0, 0, width, height, GL.GL_RGB, GL.GL_UNSIGNED_BYTE, shown)
        return shown[::-1]

    def _next_skin(self) -> None:
        """Show the next skin on the same lobes; one that does not go with them is told and shows that of the bake."""
        self.shown_skin = (self.shown_skin + 1) % (len(self.skins) + 1)
        scene, self.skin_text = self.baked, ""
        if self.shown_skin:
            skin = self.skins[self.shown_skin - 1]
            try:
                gaussians = skin.fit()
            except InputError as error:
                self.skin_text = f"skin {skin.name}: {error}"
            else:
                scene, self.skin_text = with_skin(self.baked, gaussians), skin_line(skin.name, gaussians)
        self.window.switch_to()
        self.scene = scene
        self.renderer.set_weights(scene)

    def close(self) -> None:
        """Free what the graphics card holds, and close the window."""
        self.window.switch_to()
        self.renderer.target = None
        for target in self._targets.values():
            target.delete()
        self.renderer.delete()
        self.window.close()

    def _on_change(self, *_: Any) -> None:
        self.changed = True

    def _on_key_press(self, symbol: int, modifiers: int) -> bool:
        from pyglet.window import key

        name = key.symbol_string(symbol).removeprefix("_").removeprefix("NUM_")
        name = _KEYS.get(name, name)
        self.message = ""
        width, height = self.window.get_size()
        if name in ("Q", "ESCAPE"):
            self.window.has_exit = True
        elif name == "K" and self.relit is None:
            self._next_skin()
        elif name == "P":
            self._act(self.actions.save_picture, self._picture)
        elif name == "W" and self.relit is None:
            self._write_look()
        elif name == "V":
            at = VIEWS.index(self.view_name) if self.view_name in VIEWS else -1
            self.view_name = VIEWS[(at + 1) % len(VIEWS)]
            self.camera = self._from = view(self.scene.mesh, self.view_name, width / height)
        else:
            if name == "R":
                self.camera = self._from
            self.controls = press(self.controls, self.start, self.scene, name)
            if self.relit is not None and self.start_relit is not None:
                before, self.relit = self.relit, press_relit(self.relit, self.start_relit, name)
                self.light_moves = self.relit is not before
        self.changed = True
        return True

    def _picture(self) -> NDArray[np.uint8]:
        """The frame without its text, as a bake's picture is encoded, (H, W, 3)."""
        target = self._drawn(1, self.window.get_framebuffer_size())
        return tone_map(PreviewImage(target.read()), self.look.background_rgb, self.controls.exposure)

    def _write_look(self) -> None:
        """Have gains and view written; from now on the look has them."""
        if self._act(self.actions.write_look, self.state):
            names = (light.name for light in self.controls.lights)
            self._written = {name: np.array(gain) for name, gain in zip(names, self.controls.gains, strict=True)}

    def _act(self, action: Callable[[Any], str] | None, given: Callable[[], Any]) -> bool:
        """Do what a key is for, and say what came of it; whether it was done."""
        if action is None:
            self.message = "not here: open the window with `skinbake preview LOOK.yaml`"
            return False
        try:
            self.message = action(given())
        except (SkinbakeError, OSError) as error:
            self.message = str(error)
            return False
        return True

    def _on_mouse_drag(self, x: int, y: int, dx: int, dy: int, buttons: int, modifiers: int) -> None:
        from pyglet.window import key, mouse

        height = self.window.get_size()[1]
        self.light_moves = self.relit is not None and bool(modifiers & key.MOD_CTRL)
        if self.light_moves:
            assert self.relit is not None
            self.relit = self.relit.dragged(dx * ORBIT_DEG_PER_PIXEL, dy * ORBIT_DEG_PER_PIXEL)
        elif buttons & mouse.RIGHT:
            self.camera = self.camera.zoomed(2.0 ** (-dy / 100))
        elif buttons & mouse.MIDDLE or modifiers & key.MOD_SHIFT:
            self.camera = self.camera.panned(-dx / height, -dy / height)
        else:
            self.camera = self.camera.turned(-dx * ORBIT_DEG_PER_PIXEL, -dy * ORBIT_DEG_PER_PIXEL)
        self.changed, self._moved_at = True, time.monotonic()

    def _on_mouse_scroll(self, x: int, y: int, scroll_x: float, scroll_y: float) -> None:
        self.camera = self.camera.zoomed(0.9**scroll_y)
        self.changed, self._moved_at = True, time.monotonic()
