"""How much more of light counts where it enters at a slant: incidence, as a factor on each channel of irradiance.

A profile is that of a beam along the normal. Of light that enters at a slant more comes back, by R(mu) over the
reference that the profile's total stands for (theory.md 9.5).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas.raster import NO_FACE, AtlasRaster
from skinbake.irradiance.environment_map import SkySamples, look_up, octahedral_normals
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.punctual_light import DIRECTIONAL, POINT, emitter, towards
from skinbake.irradiance.shadow_origin import point_of
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, normalized, safe_div
from skinbake.profile.incidence import Incidence
from skinbake.scene.decision import Decision
from skinbake.scene.lights import LightSpec, RectangleLight

Image = NDArray[np.float32]
CELLS, DIRECTIONS = 24, 2048  # of a sky's table of factors, and of the sky
PIECES = 4  # of a rectangle, along each edge


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


@dataclass(frozen=True)
class SkySlant:
    """Factors for a sky that is not the same everywhere.

    Attributes
    ----------
    factor_rgb : ndarray of shape (n + 1, n + 1, 3), float32
        By normal, an octahedral map.
    rms : float
        Error of leaving them out, relative to the sky's irradiance over all normals.
    """

    factor_rgb: Image
    rms: float


def slant_of_sky(slant: Slant, radiance: Image, rotate_deg: float) -> SkySlant:
    """Mean factor of the directions from which a radiance map lights each normal, unshadowed.

    Parameters
    ----------
    slant : Slant
    radiance : ndarray of shape (h, w, 3)
        Equirectangular map, row 0 at the top.
    rotate_deg : float
    """
    directions, flux = SkySamples(radiance, rotate_deg).draw(DIRECTIONS)
    normals = octahedral_normals(CELLS)
    sums = np.zeros((2, len(normals), 3))
    sampled = directions.astype(np.float64), flux.astype(np.float64)
    parallel_for(_sky_sums, len(normals), normals, *sampled, slant.factor_rgb, sums)
    lit, slanted = sums
    factor = np.where(lit > 0, safe_div(slanted, lit), slant.diffuse_rgb)
    whole = float((lit**2).sum())
    rms = float(np.sqrt(((lit * (factor - 1)) ** 2).sum() / whole)) if whole > 0 else 0.0
    return SkySlant(factor.reshape(CELLS + 1, CELLS + 1, 3).astype(np.float32), rms)


@kernel
def _sky_sums(first: int, stop: int, normals: Float, directions: Float, flux: Float, table: Float, sums: Float) -> None:
    """Add up the irradiance of a sky's directions by normal, without and with the factor of each slant.

    Parameters
    ----------
    first, stop : int
        Of the normals.
    normals : ndarray of shape (N, 3)
    directions, flux : ndarrays of shape (D, 3)
    table : ndarray of shape (n, 3)
        Factor at cosines 0, 1/(n-1), ... 1.
    sums : ndarray of shape (2, N, 3), changed in place
    """
    steps = len(table) - 1
    for i in range(first, stop):
        for k in range(len(directions)):
            cosine = 0.0
            for axis in range(3):
                cosine += normals[i, axis] * directions[k, axis]
            if cosine <= 0.0:
                continue
            place = min(cosine, 1.0) * steps
            low = min(int(place), steps - 1)
            part = place - low
            for c in range(3):
                weight = cosine * flux[k, c]
                sums[0, i, c] += weight
                sums[1, i, c] += weight * ((1.0 - part) * table[low, c] + part * table[low + 1, c])


def slant_rms(slant: Slant, light: LightSpec, sky: SkySlant | None = None) -> float:
    """Error of leaving the factors out, relative rms: of a lamp over skin that is turned every way, of a sky its mean.

    Parameters
    ----------
    slant : Slant
    light : LightSpec
    sky : SkySlant, optional
        Of a light that has a map.
    """
    if sky is not None:
        return sky.rms
    if light.everywhere:
        return float(np.sqrt(((slant.diffuse_rgb - 1) ** 2).mean()))
    cosine = np.linspace(0, 1, len(slant.factor_rgb))[:, None]
    # Irradiance is proportional to the cosine; a ball shows each cosine on an equal area
    error = np.sqrt((((slant.factor_rgb - 1) * cosine) ** 2).sum(axis=0) / (cosine**2).sum())
    return float(np.sqrt((error**2).mean()))


def slant_difference(one: Slant, other: Slant) -> float:
    """How far two skins' factors are apart, as `slant_rms` sees them: of the worse of a lamp and of light from
    everywhere.
    """
    cosine = np.linspace(0, 1, len(one.factor_rgb))[:, None]
    apart = (one.factor_rgb - other.factor_rgb) * cosine
    lamp = np.sqrt((apart**2).sum(axis=0) / ((other.factor_rgb * cosine) ** 2).sum(axis=0))
    sky = np.abs(one.diffuse_rgb / other.diffuse_rgb - 1)
    return float(max(lamp.max(), sky.max()))


def decide_incidence(light: LightSpec, slant: Slant, sky: SkySlant | None, switch: str, negligible: float) -> Decision:
    """Whether the factors of the slant are worth it for a light.

    Parameters
    ----------
    light : LightSpec
    slant : Slant
    sky : SkySlant, optional
        Of a light that has a map.
    switch : "auto" or "on"
    negligible : float
        It costs next to nothing, and is left out below this only.
    """
    rms = slant_rms(slant, light, sky)
    which = "from everywhere" if light.everywhere else "at a slant"
    why = f"{switch}: light {which} comes back otherwise by {rms:.2%} (rms); left out below {negligible:.2%}"
    kept = switch == "on" or rms > negligible
    return Decision(f"{light.name}.incidence", kept, why, 0.0 if kept else rms)


def apply_slant(
    raster: AtlasRaster,
    normal: Image,
    occluder: Occluder,
    light: LightSpec,
    slant: Slant,
    sky: SkySlant | None,
    out: Image,
) -> None:
    """Multiply one light's irradiance by the factors of the slants at which it enters.

    Exact for directional, point and spot lights; of a rectangle the middles of 4 x 4 pieces count, and of a sky the
    directions that light a normal, as if all of them were open.

    Parameters
    ----------
    raster : AtlasRaster
    normal : ndarray of shape (H, W, 3)
        As the light was computed with.
    occluder : Occluder
    light : LightSpec
    slant : Slant
    sky : SkySlant, optional
        Of a light that has a map; without it a sky's light comes from everywhere.
    out : ndarray of shape (H, W, 3), float32, changed in place
    """
    if sky is not None:
        factor = np.ones_like(out)
        parallel_for(look_up, len(out), sky.factor_rgb, normal, raster.addressed, factor)
        out *= factor
        return
    if light.everywhere:
        out *= slant.diffuse_rgb.astype(np.float32)
        return
    parallel_for(
        _multiply, len(out),
        _Slanted(sources_of(light, occluder.centre_mm), normal, np.ascontiguousarray(slant.factor_rgb)),
        raster.face_index, raster.barycentric, occluder.subdivided, out,
    )  # fmt: skip


def sources_of(light: LightSpec, centre_mm: Float) -> Float:
    """A lamp as `emitter` makes it, (1, 10); a rectangle as the middles of its pieces, (n, 10), of one brightness. Its
    axis is the side that shines.
    """
    if not isinstance(light, RectangleLight):
        return emitter(light, centre_mm)[None]
    u, v = (np.asarray(edge, np.float64) for edge in (light.edge_u_mm, light.edge_v_mm))
    middle, axis = light.position_mm - centre_mm, normalized(np.cross(u, v))
    places = (np.arange(PIECES) + 0.5) / PIECES - 0.5
    return np.array([[POINT, *(middle + i * u + j * v), *axis, -2, -3, 0] for i in places for j in places], np.float64)


class _Slanted(NamedTuple):
    """What `_multiply` reads of a light.

    Attributes
    ----------
    sources : ndarray of shape (n, 10)
        Each as `emitter` makes it.
    normal : ndarray of shape (H, W, 3)
    factor_rgb : ndarray of shape (n, 3)
        At cosines 0, 1/(n-1), ... 1.
    """

    sources: Float
    normal: Image
    factor_rgb: Float


@kernel
def _multiply(first, stop, of, face_index, barycentric, subdivided, out):  # type: ignore[no-untyped-def]
    """Multiply irradiance by the mean factor of a light's sources, linear between the table's nodes.

    Parameters
    ----------
    first, stop : int
        Rows.
    of : _Slanted
    face_index, barycentric : ndarrays of shape (H, W), (H, W, 2)
    subdivided : SubdividedMesh
    out : ndarray of shape (H, W, 3)
    """
    table, normal = of.factor_rgb, of.normal
    last = table.shape[0] - 1
    for row in range(first, stop):
        for col in range(out.shape[1]):
            face = face_index[row, col]
            if face == NO_FACE or out[row, col, 0] + out[row, col, 1] + out[row, col, 2] == 0.0:
                continue
            px, py, pz = 0.0, 0.0, 0.0
            if of.sources[0, 0] != DIRECTIONAL:
                px, py, pz = point_of(
                    subdivided, face, np.float64(barycentric[row, col, 0]), np.float64(barycentric[row, col, 1])
                )
            red, green, blue, total = 0.0, 0.0, 0.0, 0.0
            for source in of.sources:
                lx, ly, lz, _, reach = towards(source, px, py, pz)
                cosine = normal[row, col, 0] * lx + normal[row, col, 1] * ly + normal[row, col, 2] * lz
                x = min(max(cosine, 0.0), 1.0) * last
                i = min(int(x), last - 1)
                # Grazing light counts as well where there is no other
                weight = max(cosine, 1e-6) * max(reach, 1e-30)
                if len(of.sources) > 1:
                    weight *= max(-(lx * source[4] + ly * source[5] + lz * source[6]), 1e-6)
                total += weight
                red += weight * (table[i, 0] + (x - i) * (table[i + 1, 0] - table[i, 0]))
                green += weight * (table[i, 1] + (x - i) * (table[i + 1, 1] - table[i, 1]))
                blue += weight * (table[i, 2] + (x - i) * (table[i + 1, 2] - table[i, 2]))
            out[row, col, 0] *= red / total
            out[row, col, 1] *= green / total
            out[row, col, 2] *= blue / total
