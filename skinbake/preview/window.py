"""The window: pyglet's, with our renderer in it; pyrender's own Viewer would draw through an 8-bit frame buffer."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import InputError, MachineError
from skinbake.preview.camera import VIEWS, Camera, view
from skinbake.preview.controls import Controls, overlay, press
from skinbake.preview.mode import parse_mode
from skinbake.preview.other_skin import OtherSkin, skin_line, with_skin
from skinbake.preview.relit import sky_samples
from skinbake.preview.relit_controls import RelitControls, press_relit
from skinbake.preview.scene import PreviewScene
from skinbake.preview.shader_light import Gains, gains_rgb
from skinbake.preview.text_overlay import overlay_text
from skinbake.scene.spec import PreviewSpec

if TYPE_CHECKING:
    from skinbake.preview.target import FloatTarget

SAMPLES = 4
ORBIT_DEG_PER_PIXEL = 0.4
_KEYS = {"TAB": "TAB", "UP": "UP", "DOWN": "DOWN", "BRACKETLEFT": "[", "BRACKETRIGHT": "]", "COMMA": ",", "PERIOD": "."}


def show(
    scene: PreviewScene,
    look: PreviewSpec,
    size: tuple[int, int] | None = None,
    mode: str = "full",
    light_gains: Gains | None = None,
    exposure: float | None = None,
    relit: RelitControls | None = None,
    skins: Sequence[OtherSkin] = (),
) -> None:
    """Open the window and stay until it is closed.

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

    Raises
    ------
    MachineError
        No window can be opened here.
    InputError
        An unknown mode, view or light.
    """
    PreviewWindow(scene, look, size, mode, light_gains, exposure, relit, skins).run()


class PreviewWindow:
    """Window on one scene; frames are drawn when something has changed. Parameters as `show`."""

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
    ) -> None:
        gains = tuple(gains_rgb(scene, light_gains))
        level = look.exposure if exposure is None else exposure
        self.start = Controls(scene.lights, gains, parse_mode(mode, len(scene.lobes)), level)
        self.controls = self.start
        self.relit = self.start_relit = relit
        self.baked, self.skins, self.shown_skin, self.skin_text = scene, tuple(skins), 0, ""
        self.light_moves = False
        self.scene, self.look = scene, look
        self.view_name: str = look.view
        width, height = size or look.size
        self.camera: Camera = view(scene.mesh, look.view, width / height)
        self.fps = 0.0
        self.changed = True
        self.window = self._open(width, height)
        from skinbake.preview.renderer import SkinRenderer  # PyOpenGL: only with the window's context

        self.renderer = SkinRenderer(scene)
        self.renderer.fold = True
        self._empty: int | None = None
        self._text: int | None = None

    def _open(self, width: int, height: int) -> Any:
        """pyglet's window with an OpenGL 3.3 context and our handlers."""
        if sys.platform.startswith("linux") and "OpenGL" not in sys.modules:
            os.environ["PYOPENGL_PLATFORM"] = "glx"  # the window's contexts are GLX's
        try:
            import pyglet

            pyglet.options["shadow_window"] = False
            config: Any = pyglet.gl.Config(  # type: ignore[abstract]
                double_buffer=True, depth_size=24, major_version=3, minor_version=3
            )
            window = pyglet.window.Window(
                width, height, caption="skinbake preview", resizable=True, config=config, vsync=False
            )
            window.switch_to()
        except Exception as error:  # pyglet has many kinds, none of them public
            raise MachineError(
                f"no window could be opened ({type(error).__name__} {error}); render pictures instead: --png FILE"
            ) from error
        window.push_handlers(
            on_key_press=self._on_key_press,
            on_mouse_drag=self._on_mouse_drag,
            on_mouse_scroll=self._on_mouse_scroll,
            on_resize=self._on_change,
            on_expose=self._on_change,
        )
        return window

    def run(self) -> None:
        """Draw and react until the window is closed."""
        import pyglet

        try:
            while not self.window.has_exit:
                pyglet.clock.tick()
                self.window.dispatch_events()
                if self.changed and not self.window.has_exit:
                    self.frame()
                else:
                    time.sleep(0.005)
        finally:
            self.close()

    def frame(self, flip: bool = True) -> None:
        """Draw one frame and show it; without `flip` it stays in the back buffer."""
        from OpenGL import GL

        from skinbake.preview.target import FloatTarget

        start = time.perf_counter()
        self.window.switch_to()
        width, height = self.window.get_framebuffer_size()
        renderer = self.renderer
        if renderer.target is None or (renderer.target.width, renderer.target.height) != (width, height):
            if renderer.target is not None:
                renderer.target.delete()
            renderer.target = FloatTarget(width, height, samples=SAMPLES, half=True)
        renderer.mode = self.controls.mode
        if self.relit is None:
            renderer.gains_rgb = self.controls.gains_rgb
            renderer.set_lights(self.controls.lights)
        else:
            light, device = self.relit.light, str(GL.glGetString(GL.GL_RENDERER).decode())
            assert self.scene.basis is not None
            renderer.show_later(light.coefficients(self.scene.basis), light.mirrored(sky_samples(device)))
            renderer.fold = not self.light_moves  # summing every texel pays where the next frame has the same light
        renderer.draw(self.camera)
        renderer.target.resolve()
        self._display(renderer.target)
        GL.glFinish()
        seconds = time.perf_counter() - start
        self.fps = 1 / seconds if self.fps == 0 else 0.8 * self.fps + 0.2 / seconds
        if flip:
            self.window.flip()
        self.changed = False

    def _display(self, target: FloatTarget) -> None:
        """Draw the float target to the screen; `display.frag` does what `tonemap` does, and adds the text."""
        from OpenGL import GL

        from skinbake.preview import tonemap

        constants = {"TONEMAP_KNEE": str(tonemap.KNEE), "TONEMAP_DESATURATION": str(tonemap.DESATURATION)}
        program = self.renderer.program("screen.vert", "display.frag", constants)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, 0)
        GL.glViewport(0, 0, target.width, target.height)
        GL.glDisable(GL.GL_DEPTH_TEST)
        GL.glDisable(GL.GL_CULL_FACE)
        program._bind()
        for unit, (name, texture) in enumerate((("frame", target.texture), ("text", self._text_texture(target)))):
            GL.glActiveTexture(GL.GL_TEXTURE0 + unit)
            GL.glBindTexture(GL.GL_TEXTURE_2D, texture)
            program.set_uniform(name, unit)
        program.set_uniform("background", np.array(self.look.background_rgb, np.float32))
        program.set_uniform("gain", float(2.0**self.controls.exposure))
        if self._empty is None:
            self._empty = int(GL.glGenVertexArrays(1))
        GL.glBindVertexArray(self._empty)
        GL.glDrawArrays(GL.GL_TRIANGLES, 0, 3)
        GL.glBindVertexArray(0)
        program._unbind()

    def _text_texture(self, target: FloatTarget) -> int:
        """Texture with the text over the picture."""
        from OpenGL import GL

        if self._text is None:
            self._text = int(GL.glGenTextures(1))
        ink = overlay_text(self.lines, (target.width, target.height))
        GL.glActiveTexture(GL.GL_TEXTURE0)
        GL.glBindTexture(GL.GL_TEXTURE_2D, self._text)
        GL.glPixelStorei(GL.GL_UNPACK_ALIGNMENT, 1)
        for name in (GL.GL_TEXTURE_MIN_FILTER, GL.GL_TEXTURE_MAG_FILTER):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, name, GL.GL_NEAREST)
        size = (target.width, target.height)
        GL.glTexImage2D(GL.GL_TEXTURE_2D, 0, GL.GL_RG8, *size, 0, GL.GL_RG, GL.GL_UNSIGNED_BYTE, ink[::-1].copy())
        return self._text

    @property
    def lines(self) -> list[str]:
        """Lines of text over the picture."""
        first, *others = overlay(self.controls, self.scene, self.fps, self.relit)
        return [first, *([self.skin_text] if self.skin_text else []), *others]

    def pixels(self) -> NDArray[np.uint8]:
        """Pixels that the window would show now, (H, W, 3), row 0 at the top."""
        from OpenGL import GL

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
        self.renderer.delete()
        self.window.close()

    def _on_change(self, *_: Any) -> None:
        self.changed = True

    def _on_key_press(self, symbol: int, modifiers: int) -> bool:
        from pyglet.window import key

        name = key.symbol_string(symbol).removeprefix("_").removeprefix("NUM_")
        name = _KEYS.get(name, name)
        if name in ("Q", "ESCAPE"):
            self.window.has_exit = True
        elif name == "K":
            self._next_skin()
        elif name == "V":
            self.view_name = VIEWS[(VIEWS.index(self.view_name) + 1) % len(VIEWS)]
            width, height = self.window.get_size()
            self.camera = view(self.scene.mesh, self.view_name, width / height)
        else:
            if name == "R":
                width, height = self.window.get_size()
                self.camera = view(self.scene.mesh, self.view_name, width / height)
            self.controls = press(self.controls, self.start, self.scene, name)
            if self.relit is not None and self.start_relit is not None:
                before, self.relit = self.relit, press_relit(self.relit, self.start_relit, name)
                self.light_moves = self.relit is not before
        self.changed = True
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
        self.changed = True

    def _on_mouse_scroll(self, x: int, y: int, scroll_x: float, scroll_y: float) -> None:
        self.camera = self.camera.zoomed(0.9**scroll_y)
        self.changed = True
