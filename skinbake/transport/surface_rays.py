"""Single rays of a random walk on the skin: it asks for one short ray after another, none of them in a batch.

A whole walk is one compiled loop: nothing is copied between its rays, and threads need not wait for each other.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.embree import NOTHING, Triangles, send_ray
from skinbake.irradiance.smooth_surface import SmoothSurface
from skinbake.kernels.compile import kernel
from skinbake.numerics import Float, normalized


class RayScene(NamedTuple):
    """What kernels need to trace rays; positions are relative to `centre_mm`.

    Attributes
    ----------
    scene, intersect : int
        Addresses of the scene and of the function that traces one ray.
    centre_mm : ndarray of shape (3,)
    corner_mm, corner_normal : ndarrays of shape (F, 3, 3), float32
        Triangles as rays meet them, and the unit normals of the smooth surface at their corners.
    normal : ndarray of shape (F, 3)
        Unit, of the flat triangles, outwards.
    step_mm : float
        Distance from a triangle at which rays begin, beyond the round-off of its coordinates.
    """

    scene: int
    intersect: int
    centre_mm: Float
    corner_mm: NDArray[np.float32]
    corner_normal: NDArray[np.float32]
    normal: Float
    step_mm: float


class SurfaceRays:
    """Owner of an Embree scene of one surface, counter-clockwise from outside.

    Attributes
    ----------
    rays : RayScene
        Valid as long as this object lives.
    levels : int
        Of the surface: its triangles lie in the faces of a mesh as `SmoothSurface` says.
    """

    def __init__(self, surface: SmoothSurface) -> None:
        self.levels = surface.levels
        low, high = surface.positions_mm.min(axis=0), surface.positions_mm.max(axis=0)
        centre = (low + high) / 2
        positions = np.ascontiguousarray(surface.positions_mm - centre, dtype=np.float32)
        self._triangles = Triangles((positions, surface.faces))
        corner = positions[surface.faces]
        wide = corner.astype(np.float64)
        normal = normalized(np.cross(wide[:, 1] - wide[:, 0], wide[:, 2] - wide[:, 0]))
        scene = self._triangles.rays
        spacing = float(np.spacing(np.abs(positions).max()))
        self.rays = RayScene(
            scene.scene, scene.intersect, centre, corner, surface.corner_normal.astype(np.float32), normal,
            16 * spacing,
        )  # fmt: skip


@kernel
def first_hit(rays, buffer, at, direction, reach):  # type: ignore[no-untyped-def]
    """Distance (`reach` where nothing is hit), triangle (-1: none) and barycentrics 1 and 2 of a ray's first hit.

    Parameters
    ----------
    rays : RayScene
    buffer
        Of `ray_buffer`.
    at, direction : tuples of three floats
        Origin, mm about the scene's centre, and unit direction.
    reach : float
        mm; may be infinite.

    References
    ----------
    [Wald2014]
    """
    ray, bits, _ = buffer
    send_ray(rays.intersect, rays.scene, buffer, at, direction, reach)
    if bits[18] == NOTHING:
        return reach, -1, 0.0, 0.0
    return np.float64(ray[8]), np.int64(bits[17]), np.float64(ray[15]), np.float64(ray[16])
