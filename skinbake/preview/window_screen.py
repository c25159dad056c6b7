"""What the window shows: a frame of floats on the screen's 8 bits, and the text over it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from OpenGL import GL

from skinbake.preview import tonemap
from skinbake.preview.text_overlay import overlay_text

if TYPE_CHECKING:
    from skinbake.preview.renderer import SkinRenderer
    from skinbake.preview.target import FloatTarget


class WindowScreen:
    """Draws to the window's own buffer; `display.frag` does what `tonemap` does, and adds the text."""

    def __init__(self) -> None:
        self._empty: int | None = None
        self._text: int | None = None
        self._lines: tuple[str, ...] | None = None

    def show(
        self,
        renderer: SkinRenderer,
        target: FloatTarget,
        size: tuple[int, int],
        lines: Sequence[str],
        background_rgb: tuple[float, float, float],
        exposure: float,
    ) -> None:
        """Draw a resolved frame, however small, over the whole window.

        Parameters
        ----------
        renderer : SkinRenderer
            Has the programs.
        target : FloatTarget
        size : (width, height)
            Of the window.
        lines : sequence of str
            Text over the picture.
        background_rgb : tuple of 3 floats
        exposure : float
            Stops.
        """
        constants = {"TONEMAP_KNEE": str(tonemap.KNEE), "TONEMAP_DESATURATION": str(tonemap.DESATURATION)}
        program = renderer.program("screen.vert", "display.frag", constants)
        text = self._text_texture(lines)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, 0)
        GL.glViewport(0, 0, *size)
        GL.glDisable(GL.GL_DEPTH_TEST)
        GL.glDisable(GL.GL_CULL_FACE)
        program._bind()
        for unit, (name, texture) in enumerate((("frame", target.texture), ("text", text))):
            GL.glActiveTexture(GL.GL_TEXTURE0 + unit)
            GL.glBindTexture(GL.GL_TEXTURE_2D, texture)
            program.set_uniform(name, unit)
        GL.glActiveTexture(GL.GL_TEXTURE0)
        kind = GL.GL_NEAREST if (target.width, target.height) == size else GL.GL_LINEAR
        for name in (GL.GL_TEXTURE_MIN_FILTER, GL.GL_TEXTURE_MAG_FILTER):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, name, kind)
        for name in (GL.GL_TEXTURE_WRAP_S, GL.GL_TEXTURE_WRAP_T):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, name, GL.GL_CLAMP_TO_EDGE)
        program.set_uniform("size", np.array(size, np.float32))
        program.set_uniform("background", np.array(background_rgb, np.float32))
        program.set_uniform("gain", float(2.0**exposure))
        if self._empty is None:
            self._empty = int(GL.glGenVertexArrays(1))
        GL.glBindVertexArray(self._empty)
        GL.glDrawArrays(GL.GL_TRIANGLES, 0, 3)
        GL.glBindVertexArray(0)
        program._unbind()

    def _text_texture(self, lines: Sequence[str]) -> int:
        """Texture with the text, written anew where it has changed."""
        if self._text is None:
            self._text = int(GL.glGenTextures(1))
        if self._lines != tuple(lines):
            self._lines = tuple(lines)
            ink = overlay_text(lines)
            height, width = ink.shape[:2]
            GL.glActiveTexture(GL.GL_TEXTURE1)
            GL.glBindTexture(GL.GL_TEXTURE_2D, self._text)
            GL.glPixelStorei(GL.GL_UNPACK_ALIGNMENT, 1)
            for name in (GL.GL_TEXTURE_MIN_FILTER, GL.GL_TEXTURE_MAG_FILTER):
                GL.glTexParameteri(GL.GL_TEXTURE_2D, name, GL.GL_NEAREST)
            form = (GL.GL_RG, GL.GL_UNSIGNED_BYTE)
            GL.glTexImage2D(GL.GL_TEXTURE_2D, 0, GL.GL_RG8, width, height, 0, *form, np.ascontiguousarray(ink))
        return self._text
