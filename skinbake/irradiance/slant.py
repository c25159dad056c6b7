"""How much more of light counts where it enters at a slant: incidence, as a factor on each channel of irradiance.

A profile is that of a beam along the normal. Of light that enters at a slant more comes back, by R(mu) over the
reference that the profile's total stands for (theory.md 9.5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas.raster import NO_FACE, AtlasRaster
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.punctual_light import DIRECTIONAL, POINT, emitter, towards
from skinbake.irradiance.shadow_origin import SurfaceTexels, point_of
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, safe_div
from skinbake.profile.incidence import Incidence
from skinbake.scene.decision import Decision
from skinbake.scene.lights import LightSpec, RectangleLight

Image = NDArray[np.float32]


@dataclass(frozen=True)
class Slant:
    """Factors on irradiance.

    Attributes
    ----------
    factor_rgb : ndarray of shape (n, 3)
        At cosines of incidence 0, 1/(n-1), ... 1.
    diffuse_rgb : ndarray of shape (3,)
        For light from everywhere.
    """

    factor_rgb: Float
    diffuse_rgb: Float


def slant_of(incidence: Incidence, reference_rgb: Float) -> Slant:
    """Factors that make a profile of the total `reference_rgb` (3,) reflect what the incidence says."""
    return Slant(safe_div(incidence.reflectance_rgb, reference_rgb), safe_div(incidence.diffuse_rgb, reference_rgb))


def slant_rms(slant: Slant, light: LightSpec) -> float:
    """Error of leaving the factors out, relative rms: of a lamp over skin that is turned every way, of a sky its mean.

    Parameters
    ----------
    slant : Slant
    light : LightSpec
    """
    if light.everywhere:
        return float(np.sqrt(((slant.diffuse_rgb - 1) ** 2).mean()))
    cosine = np.linspace(0, 1, len(slant.factor_rgb))[:, None]
    # Irradiance is proportional to the cosine; a ball shows each cosine on an equal area
    error = np.sqrt((((slant.factor_rgb - 1) * cosine) ** 2).sum(axis=0) / (cosine**2).sum())
    return float(np.sqrt((error**2).mean()))


def decide_incidence(light: LightSpec, slant: Slant, switch: str, tolerance: float) -> Decision:
    """Whether the factors of the slant are worth it for a light.

    Parameters
    ----------
    light : LightSpec
    slant : Slant
    switch : "auto" or "on"
    tolerance : float
    """
    rms = slant_rms(slant, light)
    which = "from everywhere" if light.everywhere else "at a slant"
    why = f"{switch}: light {which} comes back otherwise by {rms:.2%} (rms), tolerance {tolerance:.2%}"
    return Decision(f"{light.name}.incidence", switch == "on" or rms > tolerance, why)


def apply_slant(
    raster: AtlasRaster, normal: Image, occluder: Occluder, light: LightSpec, slant: Slant, out: Image
) -> None:
    """Multiply one light's irradiance by the factors of the slants at which it enters.

    Exact for directional, point and spot lights; of a rectangle the direction of its middle counts, and a sky comes
    from everywhere.

    Parameters
    ----------
    raster : AtlasRaster
    normal : ndarray of shape (H, W, 3)
        As the light was computed with.
    occluder : Occluder
    light : LightSpec
    slant : Slant
    out : ndarray of shape (H, W, 3), float32, changed in place
    """
    if light.everywhere:
        out *= slant.diffuse_rgb.astype(np.float32)
        return
    if isinstance(light, RectangleLight):
        source = np.array([POINT, *(light.position_mm - occluder.centre_mm), 0, 0, 0, -2, -3, 0], np.float64)
    else:
        source = emitter(light, occluder.centre_mm)
    texels = SurfaceTexels(*raster.shown, normal, normal)
    factor_rgb = np.ascontiguousarray(slant.factor_rgb)
    parallel_for(_multiply, len(out), source, texels, occluder.subdivided, factor_rgb, out)


@kernel
def _multiply(first, stop, source, texels, subdivided, factor_rgb, out):  # type: ignore[no-untyped-def]
    """Multiply irradiance by the factor at each texel's cosine of incidence, linear between the table's nodes.

    Parameters
    ----------
    first, stop : int
        Rows.
    source : ndarray of shape (10,)
        As `emitter` makes it.
    texels : SurfaceTexels
        With the normals that light was computed with.
    subdivided : SubdividedMesh
    factor_rgb : ndarray of shape (n, 3)
    out : ndarray of shape (H, W, 3)
    """
    face_index, barycentric, normal = texels.face_index, texels.barycentric, texels.normal
    last = factor_rgb.shape[0] - 1
    for row in range(first, stop):
        for col in range(out.shape[1]):
            face = face_index[row, col]
            if face == NO_FACE or out[row, col, 0] + out[row, col, 1] + out[row, col, 2] == 0.0:
                continue
            px, py, pz = 0.0, 0.0, 0.0
            if source[0] != DIRECTIONAL:
                px, py, pz = point_of(
                    subdivided, face, np.float64(barycentric[row, col, 0]), np.float64(barycentric[row, col, 1])
                )
            lx, ly, lz, _, _ = towards(source, px, py, pz)
            cosine = normal[row, col, 0] * lx + normal[row, col, 1] * ly + normal[row, col, 2] * lz
            x = min(max(cosine, 0.0), 1.0) * last
            i = min(int(x), last - 1)
            for k in range(3):
                out[row, col, k] *= factor_rgb[i, k] + (x - i) * (factor_rgb[i + 1, k] - factor_rgb[i, k])
