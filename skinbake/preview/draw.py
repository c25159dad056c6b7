"""Pictures of a PreviewScene without a window."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from skinbake.errors import MachineError
from skinbake.preview.camera import Camera
from skinbake.preview.mode import Mode
from skinbake.preview.platform import headless_context, release_context
from skinbake.preview.relit import LaterLight, sky_samples
from skinbake.preview.scene import PreviewScene
from skinbake.preview.shader_light import Gains, gains_rgb

if TYPE_CHECKING:
    from skinbake.preview.target import FloatTarget

Plane = NDArray[np.float32]


@dataclass(frozen=True)
class GeometryBuffer:
    """Surface that each pixel shows, from the same raster pass as the picture; zero where it shows nothing.

    Attributes
    ----------
    position_mm, normal : ndarray of shape (H, W, 3)
        Interpolated, the normal before any normal map and not unit.
    tangent : ndarray of shape (H, W, 4)
        w is the bitangent's sign.
    uv : ndarray of shape (H, W, 2)
        Within the tile, v up.
    normal_level : ndarray of shape (H, W)
        Level of the normal map that is read: log2 of its texels across the pixel, at least 0; 0 without a map.
    tile : ndarray of shape (H, W), int32
        UDIM number, 0 where nothing is shown.
    """

    position_mm: Plane
    normal: Plane
    tangent: Plane
    uv: Plane
    normal_level: Plane
    tile: NDArray[np.int32]


@dataclass(frozen=True)
class PreviewImage:
    """One frame.

    Attributes
    ----------
    rgba : ndarray of shape (H, W, 4), float32
        Linear radiance, premultiplied by alpha, which is the share of the pixel that skin covers; row 0 at the top.
    geometry : GeometryBuffer or None
    """

    rgba: Plane
    geometry: GeometryBuffer | None = None

    def over(self, background_rgb: tuple[float, float, float]) -> Plane:
        """Picture before a background, (H, W, 3), linear."""
        return self.rgba[..., :3] + (1 - self.rgba[..., 3:]) * np.asarray(background_rgb, np.float32)


class OffscreenRenderer:
    """Renderer of one scene without a window, for any number of pictures; a context manager.

    Parameters
    ----------
    scene : PreviewScene

    Raises
    ------
    MachineError
        Without OpenGL, or without room on the graphics card.
    """

    def __init__(self, scene: PreviewScene) -> None:
        self.scene = scene
        self._platform = headless_context()
        from skinbake.preview.renderer import SkinRenderer  # PyOpenGL: only after the platform is chosen

        try:
            self._renderer = SkinRenderer(scene)
        except Exception:
            release_context(self._platform)
            raise

    def draw(
        self,
        camera: Camera,
        size: tuple[int, int],
        mode: Mode | None = None,
        light_gains: Gains | None = None,
        supersample: int = 2,
        geometry: bool = False,
        later: LaterLight | None = None,
    ) -> PreviewImage:
        """Draw one picture.

        Parameters
        ----------
        camera : Camera
        size : tuple of 2 ints
            (width, height).
        mode : Mode
        light_gains : mapping of light name to float or RGB
            Factor on that light's diffuse and specular part.
        supersample : int
            Each pixel is the mean of supersample^2 points on a grid: the same on every driver, unlike multisampling,
            and it smooths the specular of pores as well as edges.
        geometry : bool
            Also give the geometry buffer; needs supersample = 1.
        later : LaterLight, optional
            The light of a scene of `relit_scene`.

        Raises
        ------
        InputError
            A gain for a light that the scene does not have.
        MachineError
            No memory for the picture.
        ValueError
            If the geometry buffer is asked for with another `supersample`, or `later` where lights do not.
        """
        if geometry and supersample != 1:
            raise ValueError(f"geometry: expected supersample 1, got {supersample}")
        from OpenGL import GL

        from skinbake.preview.picture_part import parts_of
        from skinbake.preview.renderer import GBUFFER_ATTACHMENTS

        renderer = self._renderer
        self._platform.make_current()
        renderer.mode = mode or Mode()
        if later is not None:
            if self.scene.basis is None:
                raise ValueError("later: expected a scene of relit_scene, got one with lights of its own")
            sky = later.mirrored_sky(sky_samples(self.device))
            renderer.show_later(later.coefficients(self.scene.basis), sky, later.mirrored_suns)
        else:
            renderer.gains_rgb = gains_rgb(self.scene, light_gains)
        renderer.gbuffer = geometry
        attachments = GBUFFER_ATTACHMENTS if geometry else 1
        parts = tuple(parts_of(size, supersample, int(GL.glGetIntegerv(GL.GL_MAX_RENDERBUFFER_SIZE))))
        target = self._target(*parts[0].size, attachments)
        planes: list[Plane] = []
        for part in parts:
            renderer.draw(camera, part)
            read = [target.read(i, supersample) for i in range(attachments)]
            if len(parts) == 1:
                planes = read
                break
            planes = planes or [np.empty((size[1], size[0], 4), np.float32) for _ in read]
            left, low = part.at[0] // supersample, part.at[1] // supersample
            for plane, of_part in zip(planes, read, strict=True):  # the part's last row is its lowest
                width, height = min(of_part.shape[1], size[0] - left), min(len(of_part), size[1] - low)
                rows = slice(size[1] - low - height, size[1] - low)
                plane[rows, left : left + width] = of_part[len(of_part) - height :, :width]
        return PreviewImage(planes[0], _geometry(planes[1:]) if geometry else None)

    def _target(self, width: int, height: int, attachments: int) -> FloatTarget:
        """What is drawn into, the last one where it fits.

        Raises
        ------
        MachineError
            The graphics card has no room for it.
        """
        from OpenGL.error import GLError

        from skinbake.preview.target import FloatTarget

        target, renderer = self._renderer.target, self._renderer
        if target is not None and (target.width, target.height, target.attachments) == (width, height, attachments):
            return target
        if target is not None:
            target.delete()
            renderer.target = None
        try:
            renderer.target = FloatTarget(width, height, attachments)
        except GLError as error:
            raise MachineError(f"no memory for a picture of {width} x {height}: {error.description}") from error
        return renderer.target

    def set_scene(self, scene: PreviewScene, sent: Callable[[], None] = lambda: None) -> None:
        """Draw another scene of the same mesh from now on, so that the mesh can be made ready while textures are
        computed.

        Parameters
        ----------
        scene : PreviewScene
        sent : callable, optional
            Called after each texture that was sent: memory that it was read into may be freed.

        Raises
        ------
        ValueError
            If the mesh or the tiles differ.
        """
        self._platform.make_current()
        self._renderer.set_scene(scene, sent)
        self.scene = scene

    @property
    def device(self) -> str:
        """Name of the OpenGL renderer."""
        from OpenGL import GL

        return str(GL.glGetString(GL.GL_RENDERER).decode())

    def close(self) -> None:
        """Free what the graphics card holds."""
        self._platform.make_current()
        self._renderer.delete()
        release_context(self._platform)

    def __enter__(self) -> OffscreenRenderer:
        return self

    def __exit__(self, kind: type | None, value: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def draw(
    scene: PreviewScene,
    camera: Camera,
    size: tuple[int, int],
    mode: Mode | None = None,
    light_gains: Gains | None = None,
    supersample: int = 2,
    geometry: bool = False,
) -> PreviewImage:
    """Draw one picture of a scene. For several, keep one `OffscreenRenderer`: the textures are then sent once.

    Parameters
    ----------
    scene : PreviewScene
    camera, size, mode, light_gains, supersample, geometry
        As `OffscreenRenderer.draw`.

    Raises
    ------
    InputError, MachineError, ValueError
        As `OffscreenRenderer` and its `draw`.
    """
    with OffscreenRenderer(scene) as renderer:
        return renderer.draw(camera, size, mode, light_gains, supersample, geometry)


def _geometry(planes: list[Plane]) -> GeometryBuffer:
    """Geometry buffer from the attachments' planes, (H, W, 4) each."""
    position, normal, tangent, uv = planes
    return GeometryBuffer(
        position[..., :3],
        normal[..., :3],
        tangent,
        uv[..., :2],
        uv[..., 2],
        np.rint(position[..., 3]).astype(np.int32),
    )
