"""Shadow rays: is anything of the mesh in the way?"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.shadow_origin import facets_of
from skinbake.irradiance.smooth_surface import smooth_surface
from skinbake.numerics import Float
from skinbake.scene.mesh import SkinMesh

MIN_BATCH = 65536  # rays; below this a second thread costs more than it brings

Vectors = NDArray[np.float32]


class Occluder:
    """The smooth surface of a mesh in embree, about `centre_mm` so that float32 spends its digits on the head.

    Attributes
    ----------
    facets : Facets
        What the rays meet.
    centre_mm : ndarray of shape (3,)
        All origins are given relative to it.
    spacing_mm : float
        Distance between neighbouring float32 coordinates at the outermost vertex.
    """

    def __init__(self, mesh: SkinMesh) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        surface = smooth_surface(mesh)
        low, high = surface.positions_mm.min(axis=0), surface.positions_mm.max(axis=0)
        self.centre_mm: Float = (low + high) / 2
        self.facets = facets_of(surface, self.centre_mm)
        positions = np.ascontiguousarray(surface.positions_mm - self.centre_mm, dtype=np.float32)
        self.spacing_mm = float(np.spacing(np.abs(positions).max()))
        self._scene = EmbreeScene(robust=True)
        self._triangles = TriangleMesh(self._scene, positions, surface.faces)
        nothing = np.zeros((1, 3), np.float32)
        self._scene.run(nothing, nothing + np.float32(1), query="OCCLUDED")  # commits, before threads come

    def occluded(self, origin: Vectors, direction: Vectors, reach: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Whether each ray meets the mesh nearer than `reach` (in lengths of `direction`).

        Each ray is a question of its own: batches and threads cannot change an answer.
        """
        answer = np.empty(len(origin), dtype=np.bool_)

        def ask(part: slice) -> None:
            hit = self._scene.run(origin[part], direction[part], reach[part], query="OCCLUDED")
            np.not_equal(hit, -1, out=answer[part])

        self._spread(ask, len(origin))
        return answer

    def first_hit(
        self, origin: Vectors, direction: Vectors
    ) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """Triangle of the smooth surface (-1: none), barycentrics 1 and 2 in it, and distance of the first hit."""
        triangle = np.empty(len(origin), dtype=np.int32)
        b1, b2, distance = (np.zeros(len(origin), dtype=np.float32) for _ in range(3))

        def ask(part: slice) -> None:
            hit = self._scene.run(origin[part], direction[part], output=1)
            triangle[part], b1[part], b2[part], distance[part] = hit["primID"], hit["u"], hit["v"], hit["tfar"]

        self._spread(ask, len(origin))
        triangle[distance > 1e30] = -1
        return triangle, b1, b2, distance

    def _spread(self, ask, count: int) -> None:  # type: ignore[no-untyped-def]
        """Embree runs without the interpreter's lock, so plain threads share the work."""
        threads = min(numba.get_num_threads(), max(1, count // MIN_BATCH))
        if threads == 1:
            if count:
                ask(slice(0, count))
            return
        bounds = np.linspace(0, count, 4 * threads + 1).astype(int)
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lambda i: ask(slice(bounds[i], bounds[i + 1])), range(4 * threads)))
