"""Shadow rays: they tell whether the mesh is in the way of the light."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.cards import Cards
from skinbake.irradiance.embree import Triangles
from skinbake.irradiance.shadow_origin import facets_of
from skinbake.irradiance.smooth_surface import smooth_surface
from skinbake.kernels.threads import for_slices
from skinbake.machine import require_memory
from skinbake.numerics import Float
from skinbake.scene.casters import OPAQUE, Casters
from skinbake.scene.mesh import SkinMesh

SKIN = 0  # embree's number of the geometry that was added first
BATCH = 65536  # rays; below this a second thread costs more than it brings

RAYS_BYTES, RAYS_BYTES_A_FACE = 256 * 2**20, 1000  # of embree with its threads, and of what it builds

Vectors = NDArray[np.float32]


class Occluder:
    """The smooth surface of a mesh in embree, about `centre_mm` so that float32 spends its digits on the head.

    Attributes
    ----------
    subdivided : SubdividedMesh
        Triangles that rays meet.
    centre_mm : ndarray of shape (3,)
        All origins are given relative to it.
    spacing_mm : float
        Distance between neighbouring float32 coordinates at the outermost vertex.

    Raises
    ------
    MachineError
        This process may not take as much memory as that needs.
    """

    def __init__(self, mesh: SkinMesh) -> None:
        require_memory(RAYS_BYTES + RAYS_BYTES_A_FACE * len(mesh.faces), "tracing of rays")
        surface = smooth_surface(mesh)
        low, high = surface.positions_mm.min(axis=0), surface.positions_mm.max(axis=0)
        self.centre_mm: Float = (low + high) / 2
        self.subdivided = facets_of(surface, self.centre_mm)
        positions = np.ascontiguousarray(surface.positions_mm - self.centre_mm, dtype=np.float32)
        self.spacing_mm = float(np.spacing(np.abs(positions).max()))
        parts = [(positions, surface.faces)]
        self._cards: Cards | None = None
        if mesh.casters is not None:
            parts += self._opaque(mesh.casters)
        self._triangles = Triangles(*parts)

    def _opaque(self, casters: Casters) -> list[tuple[Vectors, NDArray[np.int32]]]:
        """What rays meet that is neither skin nor lets light pass, which is put aside."""
        positions = np.ascontiguousarray(casters.positions_mm - self.centre_mm, dtype=np.float32)
        opaque = casters.image == OPAQUE
        if not opaque.all():
            self._cards = Cards(positions, casters)
        return [(positions, casters.faces[opaque])] if opaque.any() else []

    @property
    def has_cards(self) -> bool:
        """Whether anything lets a part of the light pass."""
        return self._cards is not None

    def occluded(self, origin: Vectors, direction: Vectors, reach: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Whether each ray meets the mesh or a caster, shape (n,).

        Each ray is a question of its own: batches and threads cannot change an answer.

        Parameters
        ----------
        origin : ndarray of shape (n, 3), float32
            Mm, about `centre_mm`.
        direction : ndarray of shape (n, 3) or (1, 3), float32
            One row serves all rays.
        reach : ndarray of shape (n,), float32
            Distance up to which hits count, in lengths of `direction`.
        """
        answer = np.empty(len(origin), dtype=np.bool_)

        def ask(part: slice) -> None:
            rays = direction[part] if len(direction) > 1 else direction
            answer[part] = self._triangles.occluded(origin[part], rays, reach[part])
            if self._cards is not None:
                clear = np.flatnonzero(~answer[part])
                rays = rays[clear] if len(rays) > 1 else np.repeat(rays, len(clear), axis=0)
                answer[part][clear] = self._cards.blocked(origin[part][clear], rays, reach[part][clear])

        for_slices(ask, len(origin), BATCH)
        return answer

    def unhindered(
        self, origin: Vectors, direction: Vectors, reach: NDArray[np.float32]
    ) -> NDArray[np.bool_] | NDArray[np.float32]:
        """Share of light that each ray keeps, shape (n,): as booleans where nothing is half transparent.

        Parameters
        ----------
        origin, direction, reach
            As of `occluded`.
        """
        if self._cards is None:
            return ~self.occluded(origin, direction, reach)
        answer = np.empty(len(origin), np.float32)

        def ask(part: slice) -> None:
            rays = direction[part] if len(direction) > 1 else direction
            answer[part] = ~self._triangles.occluded(origin[part], rays, reach[part])
            self._dim_by_cards(answer[part], origin[part], rays, reach[part])

        for_slices(ask, len(origin), BATCH)
        return answer

    def _dim_by_cards(
        self, answer: NDArray[np.float32], origin: Vectors, rays: Vectors, reach: NDArray[np.float32]
    ) -> None:
        """Multiply the answers (n,) of rays that meet nothing opaque by what the cards leave of them."""
        assert self._cards is not None
        clear = np.flatnonzero(answer)
        rays = rays[clear] if len(rays) > 1 else np.repeat(rays, len(clear), axis=0)
        answer[clear] = self._cards.transmitted(origin[clear], rays, reach[clear])

    def behind_cards(self, origin: Vectors, direction: Vectors, reach: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Whether each ray meets something that lets light pass in places, wherever it does so, shape (n,).

        Parameters
        ----------
        origin, direction, reach
            As of `occluded`.
        """
        answer = np.zeros(len(origin), np.bool_)
        if self._cards is None:
            return answer
        cards = self._cards

        def ask(part: slice) -> None:
            answer[part] = cards.met(origin[part], direction[part] if len(direction) > 1 else direction, reach[part])

        for_slices(ask, len(origin), BATCH)
        return answer

    def first_hit(
        self, origin: Vectors, direction: Vectors
    ) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """Triangle of the smooth surface that each ray meets first, barycentrics 1 and 2 in it, and distance; each
        (n,).

        The triangle is -1 where there is none, or where a caster without opacity is met first.
        """
        triangle = np.empty(len(origin), dtype=np.int32)
        b1, b2, distance = (np.zeros(len(origin), dtype=np.float32) for _ in range(3))

        def ask(part: slice) -> None:
            hit = self._triangles.first_hits(origin[part], direction[part])
            triangle[part], b1[part], b2[part], distance[part] = hit.triangle, hit.b1, hit.b2, hit.distance
            triangle[part][hit.geometry != SKIN] = -1

        for_slices(ask, len(origin), BATCH)
        return triangle, b1, b2, distance
