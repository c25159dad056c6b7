"""Light that comes later, in the preview: a sky and suns, turned as one, from a bake's transfer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from skinbake.irradiance.environment_map import Image
from skinbake.numerics import Float, normalized
from skinbake.preview.mirrored_sky import mirrored_sky
from skinbake.preview.scene import PreviewLobe, PreviewScene, Texture
from skinbake.preview.shader_light import DIRECTIONAL, ShaderLight
from skinbake.relight.basis import LightBasis
from skinbake.relight.harmonics import harmonics_of_sky, turned
from skinbake.relight.relit import Sun, harmonics_of_suns
from skinbake.scene.lights import EnvironmentLight
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SpecularSpec, TexturingSpec

SAMPLES, SAMPLES_SOFTWARE = 256, 32  # directions of a sky that the oil mirrors, on a graphics card and without one
_UP = np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True)
class LaterLight:
    """A sky, or none, and suns.

    Attributes
    ----------
    sky : ndarray of shape (h, w, 3), optional
        Equirectangular radiance.
    suns : tuple of (direction, irradiance_rgb)
        `direction` is where the light travels.
    rotate_deg : float
        All of it is turned so far about +y, +z towards +x.
    raise_deg : float
        Suns stand so much higher.
    """

    sky: Image | None = None
    suns: tuple[Sun, ...] = ()
    rotate_deg: float = 0.0
    raise_deg: float = 0.0
    _known: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def turned(self, degrees: float, higher_deg: float = 0.0) -> LaterLight:
        """The same light turned further, its suns higher by some degrees."""
        return replace(self, rotate_deg=self.rotate_deg + degrees, raise_deg=self.raise_deg + higher_deg)

    @cached_property
    def placed_suns(self) -> tuple[Sun, ...]:
        """Suns where they are shown."""
        return tuple((_placed(direction, self.rotate_deg, self.raise_deg), rgb) for direction, rgb in self.suns)

    def coefficients(self, basis: LightBasis) -> Float:
        """How much of each light of a basis there is, by channel, (K, 3)."""
        light = harmonics_of_suns(self.placed_suns, basis.order)
        if self.sky is not None:
            key = f"harmonics {basis.order}"
            if key not in self._known:
                self._known[key] = harmonics_of_sky(self.sky, basis.order)
            light += turned(self._known[key], self.rotate_deg)
        return np.einsum("kj,jc->kc", basis.of_harmonics, light)

    def mirrored_sky(self, samples: int) -> Image:
        """Directions of the sky that the oil mirrors, as `skinbake.preview.mirrored_sky` gives them, (n, 2, 4).

        Parameters
        ----------
        samples : int
            Their number.
        """
        if self.sky is None:
            return np.zeros((1, 2, 4), np.float32)
        key = f"directions {samples}"
        if key not in self._known:
            self._known[key] = mirrored_sky(self.sky, samples)
        directions: Image = self._known[key].copy()
        directions[:, 0, :3] = directions[:, 0, :3] @ _about_y(self.rotate_deg).T
        return directions

    @property
    def mirrored_suns(self) -> tuple[ShaderLight, ...]:
        """Suns as the oil mirrors them."""
        return tuple(
            ShaderLight(DIRECTIONAL, 0, -normalized(direction), _UP, (0.0, 1.0), np.asarray(rgb, float))
            for direction, rgb in self.placed_suns
        )


def sky_samples(device: str) -> int:
    """Directions of a sky that the oil mirrors in a frame, by the name of the OpenGL renderer."""
    software = any(name in device.lower() for name in ("llvmpipe", "softpipe", "swiftshader"))
    return SAMPLES_SOFTWARE if software else SAMPLES


def relit_scene(
    basis: LightBasis,
    mesh: SkinMesh,
    textures: Mapping[int, Texture],
    visibility: Mapping[int, Texture],
    maps: SkinMaps,
    texturing: TexturingSpec,
    specular: SpecularSpec,
    energy_conservation: bool,
) -> PreviewScene:
    """A scene whose one lobe holds the textures of a basis, to be drawn with `LaterLight`.

    Parameters
    ----------
    basis : LightBasis
    mesh : SkinMesh
    textures : mapping of int to ndarray of shape (T, H, W, 3)
        By tile.
    visibility : mapping of int to ndarray of shape (3, h, w, 3)
        Harmonics of what is open to the sky.
    maps : SkinMaps
    texturing, specular : as in the look
    energy_conservation : bool
        Whether the oil's share was taken off.
    """
    count = len(next(iter(textures.values())))
    lights = tuple(
        EnvironmentLight(name=f"basis-{k}", type="environment", radiance=(1.0, 1.0, 1.0)) for k in range(count)
    )
    return PreviewScene(
        mesh,
        lights,
        (PreviewLobe(textures, (1.0, 1.0, 1.0), None),),
        {tile: np.zeros((count, 1, 1, 3), np.float16) for tile in textures},
        {tile: np.zeros((count, 1, 1), np.float16) for tile in textures},
        maps,
        texturing,
        specular,
        energy_conservation,
        open_sky=visibility,
        basis=basis,
    )


def _about_y(degrees: float) -> Float:
    """Matrix of a turn about +y, +z towards +x."""
    c, s = np.cos(np.radians(degrees % 360)), np.sin(np.radians(degrees % 360))
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _placed(direction: Sequence[float], rotate_deg: float, raise_deg: float) -> list[float]:
    """Direction of a sun's light once the sun stands higher and is turned."""
    x, y, z = -normalized(direction)
    if raise_deg:
        height = np.clip(np.degrees(np.arcsin(np.clip(y, -1, 1))) + raise_deg, -89.0, 89.0)
        azimuth = np.arctan2(x, z)
        c, y = np.cos(np.radians(height)), np.sin(np.radians(height))
        x, z = c * np.sin(azimuth), c * np.cos(azimuth)
    return [float(value) for value in -(_about_y(rotate_deg) @ (x, y, z))]
