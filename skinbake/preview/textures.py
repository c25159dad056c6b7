"""Textures on the graphics card, as 16- or 32-bit floats, bilinear, clamped at the edge.

pyrender's own textures turn floats into 8 bit, so these are made with PyOpenGL in pyrender's context.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from OpenGL import GL

from skinbake.errors import MachineError
from skinbake.irradiance.oil_albedo import oil_table
from skinbake.preview.normal_levels import normal_levels
from skinbake.preview.scene import PreviewScene
from skinbake.preview.skin_table import table_images
from skinbake.scene.spec import SpecularSpec

SMALLEST = 256  # texels a side: a driver that has no room for that is not merely small
_ROWS = 64  # that are halved at a time
_FORMAT = {1: GL.GL_RED, 2: GL.GL_RG, 3: GL.GL_RGB, 4: GL.GL_RGBA}
_INTERNAL = {
    (1, "float16"): GL.GL_R16F,
    (2, "float16"): GL.GL_RG16F,
    (3, "float16"): GL.GL_RGB16F,
    (1, "float32"): GL.GL_R32F,
    (2, "float32"): GL.GL_RG32F,
    (3, "float32"): GL.GL_RGB32F,
    (4, "float16"): GL.GL_RGBA16F,
    (4, "float32"): GL.GL_RGBA32F,
}


def upload(image: NDArray[np.floating], most: int = 1 << 30) -> int:
    """Send an image to the graphics card as an array texture; its OpenGL name.

    Single images have one layer, for a program may not mix kinds of samplers while unbound. What the driver does not
    take
    is halved until it does: a preview of a huge bake is better than none.

    Parameters
    ----------
    image : ndarray of shape (L, h, w, k), float16 or float32, k in 1 ... 4
        Row 0 is what the shader reads at t = 0.
    most : int
        Texels along a side: a larger image is halved first.

    Raises
    ------
    MachineError
        No memory even for a small one.
    """
    dtype = "float16" if image.dtype == np.float16 else "float32"
    image = np.ascontiguousarray(image, dtype=dtype)
    largest = min(int(GL.glGetIntegerv(GL.GL_MAX_TEXTURE_SIZE)), most)
    while max(image.shape[1:3]) > largest:
        image = _halved(image)
    while True:
        texture = _bilinear_texture()
        try:
            _send(image, dtype)
        except GL.GLError as error:
            GL.glDeleteTextures([texture])
            if max(image.shape[1:3]) <= SMALLEST:
                size = f"{image.nbytes / 2**20:.0f} MiB"
                raise MachineError(f"the graphics card took no texture of {size}: {error.description}") from error
            image = _halved(image)
        else:
            return texture


def upload_levels(levels: list[NDArray[np.floating]], most: int = 1 << 30) -> int:
    """Send an image with its coarser levels, which are read trilinearly; its OpenGL name.

    Parameters
    ----------
    levels : list of ndarray of shape (h, w, k)
        Each half as large as the one before; what the driver does not take is left out.
    most : int
        Texels along a side: larger levels are left out, too.

    Raises
    ------
    MachineError
        No memory even for a small one.
    """
    largest = min(int(GL.glGetIntegerv(GL.GL_MAX_TEXTURE_SIZE)), most)
    while len(levels) > 1 and max(levels[0].shape) > largest:
        levels = levels[1:]
    dtype = "float16" if levels[0].dtype == np.float16 else "float32"
    while True:
        texture = _bilinear_texture()
        GL.glTexParameteri(GL.GL_TEXTURE_2D_ARRAY, GL.GL_TEXTURE_MIN_FILTER, GL.GL_LINEAR_MIPMAP_LINEAR)
        GL.glTexParameteri(GL.GL_TEXTURE_2D_ARRAY, GL.GL_TEXTURE_MAX_LEVEL, len(levels) - 1)
        try:
            for number, image in enumerate(levels):
                _send(np.ascontiguousarray(image[None], dtype), dtype, number)
        except GL.GLError as error:
            GL.glDeleteTextures([texture])
            if len(levels) == 1 or max(levels[0].shape) <= SMALLEST:
                raise MachineError(f"the graphics card took no map of normals: {error.description}") from error
            levels = levels[1:]
        else:
            return texture


def _send(image: NDArray[np.floating], dtype: str, level: int = 0) -> None:
    """Fill a level of the bound texture with pixels (L, h, w, k)."""
    layers, height, width, channels = image.shape
    GL.glPixelStorei(GL.GL_UNPACK_ALIGNMENT, 1)
    kind = GL.GL_HALF_FLOAT if dtype == "float16" else GL.GL_FLOAT
    internal, form = _INTERNAL[channels, dtype], _FORMAT[channels]
    pixels = ctypes.c_void_p(image.ctypes.data)  # as a pointer: PyOpenGL knows no array of halves
    GL.glTexImage3D(GL.GL_TEXTURE_2D_ARRAY, level, internal, width, height, layers, 0, form, kind, pixels)


def _halved(image: NDArray[np.floating]) -> NDArray[np.floating]:
    """Means of 2 x 2 texels; the last of an odd row or column is dropped."""
    layers, height, width, channels = image.shape
    top, left = 2 * np.arange(max(height // 2, 1)), 2 * np.arange(max(width // 2, 1))
    below, right = np.minimum(top + 1, height - 1), np.minimum(left + 1, width - 1)
    out = np.empty((layers, len(top), len(left), channels), image.dtype)
    for layer in range(layers):
        for first in range(0, len(top), _ROWS):  # as floats it takes as much as it gives
            part = slice(first, first + _ROWS)
            rows = np.add(image[layer, top[part]], image[layer, below[part]], dtype=np.float32)
            out[layer, part] = 0.25 * (rows[:, left] + rows[:, right])
    return out


def blank(width: int, height: int) -> int:
    """An array texture of one RGBA32F layer to draw into."""
    texture = _bilinear_texture()
    GL.glTexImage3D(GL.GL_TEXTURE_2D_ARRAY, 0, GL.GL_RGBA32F, width, height, 1, 0, GL.GL_RGBA, GL.GL_FLOAT, None)
    return texture


def _bilinear_texture() -> int:
    """Bind a new array texture, read bilinearly and clamped at its edges."""
    texture = int(GL.glGenTextures(1))
    GL.glBindTexture(GL.GL_TEXTURE_2D_ARRAY, texture)
    for name, value in (
        (GL.GL_TEXTURE_MIN_FILTER, GL.GL_LINEAR),
        (GL.GL_TEXTURE_MAG_FILTER, GL.GL_LINEAR),
        (GL.GL_TEXTURE_WRAP_S, GL.GL_CLAMP_TO_EDGE),
        (GL.GL_TEXTURE_WRAP_T, GL.GL_CLAMP_TO_EDGE),
        (GL.GL_TEXTURE_MAX_LEVEL, 0),
    ):
        GL.glTexParameteri(GL.GL_TEXTURE_2D_ARRAY, name, value)
    return texture


class TileTextures:
    """Textures of one UDIM tile by the sampler's name in the shader, each sent when something first reads it.

    Attributes
    ----------
    names : tuple of str
        Samplers in the order of their units.
    lobe_sizes : dict of str to (width, height)
    """

    def __init__(
        self,
        scene: PreviewScene,
        tile: int,
        shared: Mapping[str, int],
        sent: Callable[[], None] = lambda: None,
        before: TileTextures | None = None,
    ) -> None:
        maps, self.tile, self._sent, self._most = scene.maps, tile, sent, scene.most_texels
        lobes = {f"lobe_{i}": lobe.rgb[tile] for i, lobe in enumerate(scene.lobes)}
        self.lobe_sizes = {name: (image.shape[2], image.shape[1]) for name, image in lobes.items()}
        self._images: dict[str, NDArray[np.floating]] = lobes | {
            "irradiance": scene.irradiance[tile],
            "visibility": scene.visibility[tile][..., None],
            # A missing map is one texel of its constant
            "albedo": maps.albedo.get(tile, _constant(maps.albedo_rgb))[None],
            "normal_map": maps.normal.get(tile, _constant((0.0, 0.0, 1.0)))[None],
            "roughness_map": maps.roughness.get(tile, np.full((1, 1), scene.specular.roughness))[None, ..., None],
            "specular_map": maps.specular.get(tile, np.ones((1, 1)))[None, ..., None],
        }
        if tile in maps.f0:
            self._images["f0_map"] = maps.f0[tile][None, ..., None]
        if scene.table is not None:
            self._images |= table_images(scene.table, maps, tile)
        if tile in scene.open_sky:
            self._images["open_sky"] = scene.open_sky[tile]
        self._normal_kind = maps.normal_strength, maps.normal_space
        self._first = _first_of_same(self._images)
        self._own = self._taken_from(before) if before else {}
        self._shared = shared  # of all tiles; whoever gave it may change it
        self.names = (*self._images, *self._shared)
        self.has_normal_map = tile in maps.normal

    def _taken_from(self, before: TileTextures) -> dict[str, int]:
        """Textures of the very same images that `before` has sent; it frees its others, and is of no use any more."""
        same = before._normal_kind == self._normal_kind and before._most == self._most
        kept = {
            name: before._own.pop(name)
            for name in list(before._own)
            if same and name in self._images and _place(self._images[name]) == _place(before._images[name])
        }
        before.delete()
        return kept

    def texture(self, name: str) -> int:
        """OpenGL name of a sampler's texture; sending it binds it to the active unit."""
        if name in self._shared:
            return self._shared[name]
        name = self._first.get(name, name)
        if name not in self._own:
            image = self._images[name]
            levels = name == "normal_map" and self.has_normal_map
            if levels:
                self._own[name] = upload_levels(normal_levels(image[0], *self._normal_kind), self._most)
            else:
                self._own[name] = upload(image, self._most)
            self._sent()
        return self._own[name]

    def set_weights(self, scene: PreviewScene) -> None:
        """Take the weights of a scene that differs in nothing else."""
        if scene.table is not None:
            self._images |= table_images(scene.table, scene.maps, self.tile)
            old = self._own.pop("weight_table", None)
            if old is not None:
                GL.glDeleteTextures([old])

    def delete(self) -> None:
        """Free the textures that only this tile uses."""
        GL.glDeleteTextures(list(self._own.values()))
        self._own = {}


def _first_of_same(images: Mapping[str, NDArray[np.floating]]) -> dict[str, str]:
    """For each lobe, the first one of the very same pixels: several may be the light itself, which is sent once."""
    first: dict[tuple[object, ...], str] = {}
    lobes = {name: image for name, image in images.items() if name.startswith("lobe_")}
    return {name: first.setdefault(_place(image), name) for name, image in lobes.items()}


def _place(image: NDArray[np.floating]) -> tuple[object, ...]:
    """The same for two images of the same memory."""
    return image.ctypes.data, image.shape, image.strides, image.dtype


def upload_oil_albedo(specular: SpecularSpec) -> int:
    """Send the table of the oil layer's albedo; row = cosine, column = roughness."""
    return upload(oil_table(specular)[None])


def _constant(rgb: Sequence[float]) -> NDArray[np.float32]:
    """A colour as an image of one texel, (1, 1, 3)."""
    return np.asarray(rgb, np.float32).reshape(1, 1, 3)
