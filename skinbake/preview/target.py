"""Frame buffer of floats; pyrender's own has 8 bits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from OpenGL import GL

from skinbake.errors import MachineError

STRIP = 32  # rows of a picture that are read at a time


class FloatTarget:
    """Color attachments of float RGBA with depth, resolved from `samples` a pixel where that is above 1.

    Parameters
    ----------
    width, height : int
    attachments : int
        1 for the picture; more for a geometry buffer, which must not be multisampled.
    samples : int
        Lowered to what the driver has.
    half : bool
        16-bit floats, for frames that only a screen sees.

    Raises
    ------
    MachineError
        If the picture is too large for this OpenGL, or it has no float frame buffer.
    """

    def __init__(self, width: int, height: int, attachments: int = 1, samples: int = 1, half: bool = False) -> None:
        self._form = GL.GL_RGBA16F if half else GL.GL_RGBA32F
        self.width, self.height, self.attachments = width, height, attachments
        self.samples = min(samples, int(GL.glGetIntegerv(GL.GL_MAX_SAMPLES)))
        largest = int(GL.glGetIntegerv(GL.GL_MAX_RENDERBUFFER_SIZE))
        if max(width, height) > largest:
            raise MachineError(
                f"a picture of {width} x {height} is larger than this OpenGL allows ({largest}); make it smaller"
            )
        self._renderbuffers: list[int] = []
        self.texture = self._color_texture()
        self._resolved = self._framebuffer(1, attachments if self.samples <= 1 else 1, textured=True)
        self.framebuffer = self._resolved if self.samples <= 1 else self._framebuffer(self.samples, attachments, False)

    def _color_texture(self) -> int:
        """Texture that the first attachment is resolved into."""
        texture = int(GL.glGenTextures(1))
        GL.glBindTexture(GL.GL_TEXTURE_2D, texture)
        for name in (GL.GL_TEXTURE_MIN_FILTER, GL.GL_TEXTURE_MAG_FILTER):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, name, GL.GL_NEAREST)
        GL.glTexImage2D(GL.GL_TEXTURE_2D, 0, self._form, self.width, self.height, 0, GL.GL_RGBA, GL.GL_FLOAT, None)
        return texture

    def _framebuffer(self, samples: int, attachments: int, textured: bool) -> int:
        """Frame buffer with `attachments` and depth, its first attachment the texture if `textured`."""
        framebuffer = int(GL.glGenFramebuffers(1))
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, framebuffer)
        for i in range(attachments):
            at = GL.GL_COLOR_ATTACHMENT0 + i
            if textured and i == 0:
                GL.glFramebufferTexture2D(GL.GL_FRAMEBUFFER, at, GL.GL_TEXTURE_2D, self.texture, 0)
            else:
                buffer = self._renderbuffer(self._form, samples)
                GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, at, GL.GL_RENDERBUFFER, buffer)
        depth = self._renderbuffer(GL.GL_DEPTH_COMPONENT24, samples)
        GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, GL.GL_DEPTH_ATTACHMENT, GL.GL_RENDERBUFFER, depth)
        GL.glDrawBuffers(attachments, [GL.GL_COLOR_ATTACHMENT0 + i for i in range(attachments)])
        if GL.glCheckFramebufferStatus(GL.GL_FRAMEBUFFER) != GL.GL_FRAMEBUFFER_COMPLETE:
            raise MachineError("this OpenGL has no frame buffer of 32-bit floats; install a newer driver, or use Mesa")
        return framebuffer

    def _renderbuffer(self, form: int, samples: int) -> int:
        """Render buffer of a format, with `samples` a pixel."""
        buffer = int(GL.glGenRenderbuffers(1))
        self._renderbuffers.append(buffer)
        GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
        if samples > 1:
            GL.glRenderbufferStorageMultisample(GL.GL_RENDERBUFFER, samples, form, self.width, self.height)
        else:
            GL.glRenderbufferStorage(GL.GL_RENDERBUFFER, form, self.width, self.height)
        return buffer

    def bind(self) -> None:
        """Make this the buffer that is drawn into."""
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self.framebuffer)

    def resolve(self) -> None:
        """Average the samples of each pixel; the picture is then in `texture`."""
        if self.framebuffer != self._resolved:
            box = (0, 0, self.width, self.height)
            GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self.framebuffer)
            GL.glBindFramebuffer(GL.GL_DRAW_FRAMEBUFFER, self._resolved)
            GL.glBlitFramebuffer(*box, *box, GL.GL_COLOR_BUFFER_BIT, GL.GL_NEAREST)

    def read(self, attachment: int = 0, box: int = 1) -> NDArray[np.float32]:
        """Means of box x box points of a color attachment, shape (height / box, width / box, 4), row 0 at the top.

        Some rows at a time, so that what is averaged is not in memory as a whole.
        """
        self.resolve()
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._resolved)
        GL.glReadBuffer(GL.GL_COLOR_ATTACHMENT0 + attachment)
        GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
        height, width = self.height // box, self.width // box
        image = np.empty((height, width, 4), np.float32)
        for row in range(0, height, STRIP):
            rows = min(STRIP, height - row)
            strip = np.empty((rows * box, self.width, 4), np.float32)
            GL.glReadPixels(0, row * box, self.width, rows * box, GL.GL_RGBA, GL.GL_FLOAT, strip)
            image[height - row - rows : height - row] = _mean(strip[::-1, : width * box], box)
        return image

    def delete(self) -> None:
        """Free the buffers and the texture."""
        GL.glDeleteFramebuffers(1, [self.framebuffer])
        if self.framebuffer != self._resolved:
            GL.glDeleteFramebuffers(1, [self._resolved])
        GL.glDeleteRenderbuffers(len(self._renderbuffers), self._renderbuffers)
        GL.glDeleteTextures([self.texture])


def _mean(points: NDArray[np.float32], box: int) -> NDArray[np.floating]:
    """Means of box x box points (h, w, 4), a row of points at a time so that the sum's order is fixed."""
    if box == 1:
        return points
    split = points.reshape(len(points) // box, box, -1, box, 4)
    total = np.zeros((split.shape[0], split.shape[2], 4))
    for i in range(box):
        for j in range(box):
            total += split[:, i, :, j]
    return total / box**2
