"""PreviewScene: the arrays that the real-time pass loads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skinbake.profile.weight_table import WeightTable
from skinbake.relight.basis import LightBasis
from skinbake.scene.lights import LightSpec
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SpecularSpec, TexturingSpec

Texture = NDArray[np.floating]  # float16 or float32: the graphics card gets it as it is


@dataclass(frozen=True)
class PreviewLobe:
    """Blurred irradiance of one Gaussian, or light through thin parts, with a layer a light.

    Attributes
    ----------
    rgb : mapping of int to ndarray of shape (L, h, w, 3), float16 or float32
        By UDIM tile, row 0 at v = 1, read bilinearly at the same (u, v) whatever its size.
    weight_rgb : tuple of 3 floats
    variance_mm2 : float or None
        None for light that came through thin parts, which no Gaussian describes.
    """

    rgb: Mapping[int, Texture]
    weight_rgb: tuple[float, float, float]
    variance_mm2: float | None


@dataclass(frozen=True)
class PreviewScene:
    """Everything that a bake left, ready to draw.

    Attributes
    ----------
    mesh : SkinMesh
    lights : tuple of LightSpec
        As the bake saw them: layer l of every texture belongs to light l.
    lobes : tuple of PreviewLobe
    irradiance : mapping of int to ndarray of shape (L, H, W, 3)
        Unblurred, without albedo: what `none` shows, and where the specular of an environment comes from.
    visibility : mapping of int to ndarray of shape (L, H, W)
        Unshadowed share of each light.
    maps : SkinMaps
    texturing, specular : as in the look
    table : WeightTable, optional
        Weights of the lobes where maps vary the skin; those of the lobes themselves are then a mean.
    energy_conservation : bool
        Whether the irradiance lost what the oil reflects; the way out then loses it as well, theory.md 7.1.
    separate : bool
        False where the bake stored all lights summed: lobes then have one layer, and lights no gains of their own.
    open_sky : mapping of int to ndarray of shape (3, h, w, 3)
        By tile, of a scene for lights that come later: harmonics Y_0 to Y_8 of what is open to the sky.
    basis : LightBasis, optional
        Of such a scene: the layers of its lobe are the textures of the basis.
    most_texels : int
        Along a side of what is sent to the graphics card: larger images are halved until they have no more.
    """

    mesh: SkinMesh
    lights: tuple[LightSpec, ...]
    lobes: tuple[PreviewLobe, ...]
    irradiance: Mapping[int, Texture]
    visibility: Mapping[int, Texture]
    maps: SkinMaps = field(default_factory=SkinMaps)
    texturing: TexturingSpec = field(default_factory=TexturingSpec)
    specular: SpecularSpec = field(default_factory=SpecularSpec)
    energy_conservation: bool = False
    separate: bool = True
    table: WeightTable | None = None
    open_sky: Mapping[int, Texture] = field(default_factory=dict)
    basis: LightBasis | None = None
    most_texels: int = 1 << 30

    def __post_init__(self) -> None:
        textures = [(f"lobe {i}", lobe.rgb, 4) for i, lobe in enumerate(self.lobes)]
        textures += [("irradiance", self.irradiance, 4), ("visibility", self.visibility, 3)]
        for name, tiles, axes in textures:
            for tile, texture in tiles.items():
                layers = 1 if name.startswith("lobe") and not self.separate else len(self.lights)
                if texture.ndim != axes or len(texture) != layers or (axes == 4 and texture.shape[3] != 3):
                    form = f"({layers}, h, w, 3)" if axes == 4 else f"({layers}, h, w)"
                    raise ValueError(f"{name}, tile {tile}: expected shape {form}, got {texture.shape}")
        if not self.lobes or not self.lights:
            raise ValueError("PreviewScene: expected at least one lobe and one light")
        if self.table is not None and self.table.weight_rgb.shape[2] != self.gaussians:
            raise ValueError(f"PreviewScene: expected a table of {self.gaussians} weights")

    @property
    def gaussians(self) -> int:
        """How many of the lobes, the first ones, are a Gaussian's blur."""
        return sum(lobe.variance_mm2 is not None for lobe in self.lobes)

    @property
    def tiles(self) -> tuple[int, ...]:
        """UDIM tiles that hold textures."""
        return tuple(sorted(self.irradiance))

    @property
    def total_weight_rgb(self) -> NDArray[np.float64]:
        """Sum of the Gaussians' weights, shape (3,): what mode `none` reflects where the light arrives."""
        weights = [lobe.weight_rgb for lobe in self.lobes if lobe.variance_mm2 is not None]
        return np.sum(weights, axis=0) if weights else np.ones(3)
