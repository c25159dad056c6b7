"""SkinMaps: the texture maps of a look as float32 arrays, decoded to linear."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]
OF_SKIN = ("radius", "melanin", "haemoglobin", "scatter")  # fields that vary the skin, named as keys of `skin`
IMAGES = ("albedo", "normal", "roughness", "specular", "f0", *OF_SKIN)  # fields that hold an image a tile


@dataclass(frozen=True)
class DetailNormals:
    """Normals of a small patch of skin that is repeated over the texture.

    Attributes
    ----------
    normal : ndarray of shape (h, w, 3)
        As `SkinMaps.normal`, tangent space.
    repeat : (float, float)
        How often it fits along u and along v.
    strength : float
        Scales its slopes.
    """

    normal: Image
    repeat: tuple[float, float]
    strength: float


@dataclass(frozen=True)
class SkinMaps:
    """Maps by UDIM tile (1001 for a single texture); a missing tile falls back to the constant.

    Row 0 is v = 1, texel centres lie at (i + 0.5) / size; sizes may differ from map to map.

    Attributes
    ----------
    albedo : dict of int to ndarray of shape (h, w, 3)
        Linear Rec.709.
    albedo_rgb : tuple of 3 floats
        Where there is no albedo map.
    normal : dict of int to ndarray of shape (h, w, 3)
        Unit-length is not assumed; x, y, z in -1 ... 1, green already in the OpenGL sense.
    normal_space : "tangent" or "object"
    normal_strength : float
        Scales the tangent-space slope.
    roughness, specular : dict of int to ndarray of shape (h, w)
        Beckmann m (absolute, 0 ... 1) and factor on rho_s, in which `cavity` is.
    f0 : dict of int to ndarray of shape (h, w)
        Reflectance of the oil at normal incidence.
    height_mm : dict of int to ndarray of shape (h, w)
        Outwards; `add_fine_normals` puts what it and `detail` tilt into `normal`.
    detail : DetailNormals, optional
    scatter, radius : dict of int to ndarray of shape (h, w)
        Share of the light that scatters, and factor on the width of the profile.
    melanin, haemoglobin : dict of int to ndarray of shape (h, w)
        Volume fractions, of a skin by what it is made of.
    """

    albedo: dict[int, Image] = field(default_factory=dict)
    albedo_rgb: tuple[float, float, float] = (1.0, 1.0, 1.0)
    normal: dict[int, Image] = field(default_factory=dict)
    normal_space: str = "tangent"
    normal_strength: float = 1.0
    roughness: dict[int, Image] = field(default_factory=dict)
    specular: dict[int, Image] = field(default_factory=dict)
    f0: dict[int, Image] = field(default_factory=dict)
    height_mm: dict[int, Image] = field(default_factory=dict)
    detail: DetailNormals | None = None
    scatter: dict[int, Image] = field(default_factory=dict)
    radius: dict[int, Image] = field(default_factory=dict)
    melanin: dict[int, Image] = field(default_factory=dict)
    haemoglobin: dict[int, Image] = field(default_factory=dict)
