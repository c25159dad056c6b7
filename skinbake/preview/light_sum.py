"""Lobes with their lights already summed: a frame then reads six textures instead of eighteen.

They are summed again only when a gain changes, which costs a graphics card nothing and a software rasteriser some
tenths of a second for six lobes of 2048^2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from OpenGL import GL

from skinbake.numerics import Float
from skinbake.preview.shader_defines import grey_layers
from skinbake.preview.textures import TileTextures, blank

Program = Callable[[str, str, Mapping[str, str]], Any]


class SummedLobes:
    """Textures of summed lights, one a lobe and tile, RGBA32F (a texture that can be drawn into must have alpha)."""

    def __init__(self) -> None:
        self._textures: dict[tuple[int, str], int] = {}
        self._gains: bytes | None = None
        self._framebuffer = int(GL.glGenFramebuffers(1))
        self._vertices = int(GL.glGenVertexArrays(1))

    def samplers(self, tile: int) -> dict[str, int]:
        """Texture of each sampler by its name."""
        return {name: texture for (owner, name), texture in self._textures.items() if owner == tile}

    def update(self, tiles: Mapping[int, TileTextures], gains_rgb: Float, grey: int, program: Program) -> None:
        """Sum anew if the gains have changed; leaves the frame buffer and the viewport changed.

        Parameters
        ----------
        tiles : mapping of tile to TileTextures
        gains_rgb : ndarray of shape (L, 3)
        grey : int
            How many layers, the last ones, hold three of these lights.
        program : callable
            Gives a shader program for a vertex shader, a fragment shader and defines.
        """
        if self._gains == gains_rgb.tobytes():
            return
        read = "texelFetch(lobe, ivec3(gl_FragCoord.xy, layer), 0)"
        defines = {
            "N_LAYERS": str(len(gains_rgb) - 3 * grey),
            "N_GAINS": str(len(gains_rgb)),
            "ADD_GREY_LAYERS": grey_layers(len(gains_rgb) - 3 * grey, grey, read),
        }
        shader = program("screen.vert", "light_sum.frag", defines)
        shader._bind()
        location = GL.glGetUniformLocation(shader._program_id, "layer_gain")
        GL.glUniform3fv(location, len(gains_rgb), np.ascontiguousarray(gains_rgb, np.float32))
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._framebuffer)
        GL.glBindVertexArray(self._vertices)
        GL.glDisable(GL.GL_DEPTH_TEST)
        GL.glDisable(GL.GL_CULL_FACE)
        GL.glDisable(GL.GL_BLEND)
        GL.glActiveTexture(GL.GL_TEXTURE0)
        for tile, textures in tiles.items():
            for name, (width, height) in textures.lobe_sizes.items():
                if (tile, name) not in self._textures:
                    self._textures[tile, name] = blank(width, height)
                folded = self._textures[tile, name]
                GL.glFramebufferTextureLayer(GL.GL_FRAMEBUFFER, GL.GL_COLOR_ATTACHMENT0, folded, 0, 0)
                GL.glViewport(0, 0, width, height)
                GL.glBindTexture(GL.GL_TEXTURE_2D_ARRAY, textures.texture(name))
                GL.glDrawArrays(GL.GL_TRIANGLES, 0, 3)
        GL.glBindVertexArray(0)
        shader._unbind()
        self._gains = gains_rgb.tobytes()

    def delete(self) -> None:
        """Free the textures."""
        if self._textures:
            GL.glDeleteTextures(list(self._textures.values()))
        GL.glDeleteFramebuffers(1, [self._framebuffer])
        GL.glDeleteVertexArrays(1, [self._vertices])
