"""Plan of a rectangle light, decided by measuring: how many rays its shadows need.

Every texel has rays of its own, so that their noise is that of texels which know nothing of each other: scattering
smooths it, the more the finer they are. What is left of it is counted.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import signed_uv_area
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.oil_albedo import OilLayer
from skinbake.irradiance.rectangle import CHUNK, Points, open_shares, panel_of
from skinbake.irradiance.surface import scattered_faces, scattered_origins
from skinbake.numerics import Float, norm_of_all, safe_div
from skinbake.profile import GaussianSum
from skinbake.profile.noise_left import noise_left
from skinbake.scene.decision import Decision
from skinbake.scene.lights import RectangleLight
from skinbake.scene.mesh import SkinMesh

POINTS = 2048  # of the skin: few of them may see a part of the light alone
DEFAULT_SAMPLES = 36  # at least
HAIR_SAMPLES = 144  # where light passes between strands: many edges lie in one penumbra
MOST = 64  # rays along an edge
FALLS = 1.5  # power of the rays along an edge by which the noise of a shadow's edge falls
ROOM = 0.95  # of the tolerance, that is aimed at: a second try is dearer than a few more rays


class RectanglePlan(NamedTuple):
    """Decisions on one rectangle.

    Attributes
    ----------
    grid : int
        Rays along each edge.
    lines : tuple of Decision
        Of its rays; empty where nothing casts a shadow.
    """

    grid: int
    lines: tuple[Decision, ...]


class RectanglePoints:
    """Points scattered over the skin, the same for all rectangles, and what scattering leaves of noise there.

    Parameters
    ----------
    mesh : SkinMesh
    occluder : Occluder
    size : (width, height)
        Of the texture.
    gaussians : GaussianSum, optional
        Of the skin; without it nothing is smoothed.
    """

    def __init__(
        self, mesh: SkinMesh, occluder: Occluder, size: tuple[int, int], gaussians: GaussianSum | None
    ) -> None:
        self.occluder = occluder
        self._mesh, self._size, self._gaussians = mesh, size, gaussians

    @cached_property
    def places(self) -> Points:
        """Where rays start, numbered."""
        origin, normal = scattered_origins(self._mesh, self.occluder, self._size, POINTS)
        return Points(np.arange(POINTS), origin, normal, normal)

    @cached_property
    def noise_left(self) -> Float:
        """Rms of noise of rms 1 a texel once it is scattered, (n, 3)."""
        if self._gaussians is None:
            return np.ones((POINTS, 3))
        face, mesh = scattered_faces(self._mesh, POINTS), self._mesh
        texels = np.abs(signed_uv_area(mesh))[face] * self._size[0] * self._size[1]
        return noise_left(self._gaussians, safe_div(texels, mesh.face_area_mm2[face]))

    @property
    def reflected(self) -> Float:
        """Light that leaves of light that is the same everywhere, (3,)."""
        return np.ones(3) if self._gaussians is None else self._gaussians.weight_rgb.sum(axis=0)


def plan_rectangle(
    light: RectangleLight, points: RectanglePoints, casts: bool, tolerance: float, seed: int
) -> RectanglePlan:
    """The fewest rays whose noise, once it is scattered, keeps a tolerance; those that are asked for are as many.

    The noise of n rays is found from the distance between two times n of them, over the root of 2.

    Parameters
    ----------
    light : RectangleLight
    points : RectanglePoints
    casts : bool
        Whether anything shadows it.
    tolerance : float
        Rms error of the light that may be made.
    seed : int
    """
    fewest = HAIR_SAMPLES if casts and points.occluder.has_cards else DEFAULT_SAMPLES
    grid = math.ceil(math.sqrt(light.samples or fewest))
    if not casts:
        return RectanglePlan(grid, ())
    noise = _Noise(light, points, seed, grid)
    error = noise.of(grid)
    if light.samples is not None:
        why = f"{grid**2} rays, asked for, are off by {error:.2%}"
    else:
        before, within = "", "within"
        while error > tolerance and grid < MOST:
            before = f" ({grid**2} by {error:.2%})"
            grid = min(max(math.ceil(grid * (error / (ROOM * tolerance)) ** (1 / FALLS)), grid + 1), MOST)
            error = noise.of(grid)
        if error > tolerance:
            within = "the most there are, above"
        why = f"{grid**2} rays are off by {error:.2%} of the light that leaves{before}, {within} {tolerance:.2%}"
    return RectanglePlan(grid, (Decision(f"{light.name}.shadows", True, why, error, f"{grid**2} rays"),))


class _Noise:
    """Noise of a rectangle's light at some points; where all of `grid` rays agree, they are asked no further."""

    def __init__(self, light: RectangleLight, points: RectanglePoints, seed: int, grid: int) -> None:
        self._light, self._points, self._seed = light, points, seed
        self._at: NDArray[np.int64] = np.arange(POINTS)
        first, again, arriving = self._shares(grid)
        rgb = np.asarray(light.radiance, np.float64)
        lit = (arriving * np.sqrt(first * again))[:, None] * rgb * points.reflected
        self._whole = norm_of_all(lit)
        partly = (arriving > 0) & (first + again > 0) & (first + again < 2)
        self._at = np.flatnonzero(partly)
        self._scale = (arriving[:, None] * rgb * points.noise_left)[self._at]
        self._found = {grid: (first - again)[self._at]}

    def of(self, grid: int) -> float:
        """Relative rms of rays along each edge."""
        if self._whole <= 0 or not len(self._at):
            return 0.0
        if grid not in self._found:
            first, again, _ = self._shares(grid)
            self._found[grid] = first - again
        return norm_of_all(self._found[grid][:, None] * self._scale) / (math.sqrt(2) * self._whole)

    def _shares(self, grid: int) -> tuple[Float, Float, Float]:
        """What two times all rays find open, and about the light without shadows, each (n,)."""
        shares, arriving = np.empty((2, len(self._at))), np.empty((2, len(self._at)))
        step = max(1, CHUNK // grid**2)
        places = self._points.places
        for start in range(0, len(self._at), step):
            part = slice(start, start + step)
            of = self._at[part]
            at = Points(places.texels[of], places.origin[of], places.normal[of], places.smooth[of])
            nothing = np.zeros(len(at.texels), np.float32)
            oil = OilLayer(nothing, nothing, np.zeros((0, 0, 2)), nothing.astype(np.float64))
            for k in range(2):
                panel = panel_of(self._light, self._points.occluder, self._seed + k, grid)
                found, arriving[k, part] = open_shares(panel, at, oil, self._points.occluder)
                shares[k, part] = found[:, 1]
        return shares[0], shares[1], arriving.mean(axis=0)
