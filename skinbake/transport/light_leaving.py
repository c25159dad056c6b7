"""Light that leaves at points of the skin, by random walks on every thread, with standard errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skinbake.irradiance.punctual_light import colour, emitter
from skinbake.irradiance.smooth_surface import descend
from skinbake.kernels.threads import thread_count
from skinbake.numerics import Float
from skinbake.scene.lights import EnvironmentLight, LightSpec, RectangleLight
from skinbake.transport.depth import depth_grid
from skinbake.transport.medium import SkinLayers, TransportMedium
from skinbake.transport.skin_grid import SkinGrid
from skinbake.transport.surface_rays import SurfaceRays
from skinbake.transport.walk import walk_from
from skinbake.transport.walk_light import PUNCTUAL, RECTANGLE, SKY
from skinbake.transport.walk_medium import DENSITY, WalkMedium, walk_medium
from skinbake.transport.walk_scene import HARD, THROUGH, WHOLE, SkinPoint, WalkLights

GROUPS = 16  # of walks, each over a lattice of its own: their spread is the standard error
ESTIMATES = {"hard": HARD, "through": THROUGH, "whole": WHOLE}


@dataclass(frozen=True)
class LightLeaving:
    """Radiant exitance at P points of L lights.

    Attributes
    ----------
    mean, stderr : ndarrays of shape (3, P, L, 3)
        By estimate (`ESTIMATES`), point, light and channel, in the units of the lights' irradiance; standard errors.
    """

    mean: Float
    stderr: Float


def light_leaving(
    skin: SurfaceRays,
    medium: TransportMedium | SkinLayers | WalkMedium,
    lights: Sequence[LightSpec],
    face: NDArray[np.int32],
    barycentric: Float,
    walks: int,
    seed: int = 0,
    shadows: bool = True,
    share: Float | None = None,
    environments: Mapping[str, NDArray[np.float32]] | None = None,
    first: int = 0,
    progress: Callable[[int], None] | None = None,
    threads: int | None = None,
) -> LightLeaving:
    """Walk from points of a closed surface; theory.md 9.2.

    Parameters
    ----------
    skin : SurfaceRays
        Of a closed surface; see `refuse_open`.
    medium : TransportMedium, SkinLayers or WalkMedium
        What fills it; the last is made once for many calls, or varies by maps.
    face : ndarray of shape (P,)
        Face of the mesh that the surface was made of.
    barycentric : ndarray of shape (P, 2)
        Barycentrics 1 and 2 of each point in its face.
    walks : int
        Walks a point and channel; rounded up to a multiple of `GROUPS`.
    seed : int
    shadows : bool
        For lights that do not say.
    share : ndarray of shape (n,), optional
        Share of arriving light that enters, at cosines 0, 1/(n-1), ... 1; all of it if not given.
    environments : mapping of light name to radiance map
    first : int
        Number of the first point: a point's walks depend on the seed and its number alone, so that a long run may be
        cut anywhere.
    progress : callable, optional
        Told the number of points that are done, from any thread.
    threads : int, optional
        Results do not depend on it.

    Raises
    ------
    ValueError
        If `walks` is below 1.

    References
    ----------
    [Wang1995], [Veach1995]
    """
    if walks < 1:
        raise ValueError(f"walks: expected at least 1, got {walks}")
    position, normal = points_of(skin, face, barycentric)
    kernel_medium = medium if isinstance(medium, WalkMedium) else medium_for_walks(skin, medium)
    kernel_lights, unit = _lights(lights, skin.rays.centre_mm, shadows, share, environments or {})
    each = -(-walks // GROUPS)
    found = np.zeros((len(face), GROUPS, 3, len(lights), 3))

    def work(p: int) -> None:
        point = SkinPoint(tuple(position[p].tolist()), tuple(normal[p].tolist()))
        for group in range(GROUPS):
            stream = np.random.SeedSequence([seed, first + p, group]).generate_state(1, np.uint64)[0]
            walk_from(skin.rays, kernel_medium, kernel_lights, stream, each, point, found[p, group])
        if progress:
            progress(1)

    with ThreadPoolExecutor(threads or thread_count()) as pool:
        list(pool.map(work, range(len(face))))
    found *= unit
    mean = found.mean(axis=1)
    stderr = found.std(axis=1, ddof=1) / np.sqrt(GROUPS)
    return LightLeaving(mean.swapaxes(0, 1), stderr.swapaxes(0, 1))


def medium_for_walks(
    skin: SurfaceRays,
    medium: TransportMedium | SkinLayers,
    grid: SkinGrid | None = None,
    quantities: tuple[str, ...] = (),
) -> WalkMedium:
    """Media as walks inside a surface meet them.

    Parameters
    ----------
    skin : SurfaceRays
    medium : TransportMedium or SkinLayers
    grid, quantities
        As of `walk_medium`.

    Raises
    ------
    ValueError
        If the grid lacks a pigment of the layers.
    """
    layers = SkinLayers.of_one(medium) if isinstance(medium, TransportMedium) else medium
    depth = None
    if len(layers.layers) > 1:
        thin = float(grid.least[quantities.index(DENSITY)]) if grid is not None and DENSITY in quantities else 1.0
        depth = depth_grid(skin, layers.outer_mm / thin)
    return walk_medium(layers, grid, quantities, depth)


def points_of(skin: SurfaceRays, face: NDArray[np.int32], barycentric: Float) -> tuple[Float, Float]:
    """Positions about the rays' centre and outward unit normals of places in the mesh's faces, both (P, 3).

    Parameters
    ----------
    skin : SurfaceRays
    face : ndarray of shape (P,)
    barycentric : ndarray of shape (P, 2)
        Barycentrics 1 and 2.
    """
    position, normal = np.empty((len(face), 3)), np.empty((len(face), 3))
    for p, (f, (b1, b2)) in enumerate(zip(face, barycentric, strict=True)):
        fine, c1, c2 = descend.py_func(int(f), float(b1), float(b2), skin.levels)
        corner = skin.rays.corner_mm[fine].astype(np.float64)
        position[p] = (1 - c1 - c2) * corner[0] + c1 * corner[1] + c2 * corner[2]
        normal[p] = skin.rays.normal[fine]
    return position, normal


def _lights(
    lights: Sequence[LightSpec],
    centre_mm: Float,
    shadows: bool,
    share: Float | None,
    environments: Mapping[str, NDArray[np.float32]],
) -> tuple[WalkLights, Float]:
    """Lights for the kernels, and the colour each one's unit is multiplied by, (L, 3)."""
    count = len(lights)
    kind, source, rotate = np.full(count, PUNCTUAL), np.zeros((count, 10)), np.zeros(count)
    unit = np.ones((count, 3))
    skies: dict[int, NDArray[np.float32]] = {}
    for i, light in enumerate(lights):
        if isinstance(light, EnvironmentLight):
            kind[i], rotate[i] = SKY, np.radians(light.rotate_deg)
            if light.radiance is not None:
                skies[i] = np.full((1, 1, 3), 1, np.float32) * np.asarray(light.radiance, np.float32)
            else:
                skies[i] = environments[light.name]
            unit[i] = light.scale
        elif isinstance(light, RectangleLight):
            kind[i] = RECTANGLE
            shape = np.array([light.position_mm - centre_mm, light.edge_u_mm, light.edge_v_mm], np.float64)
            source[i, :9] = shape.ravel()
            unit[i] = light.radiance
        else:
            source[i] = emitter(light, centre_mm)
            unit[i] = colour(light)
    size = tuple(max((sky.shape[axis] for sky in skies.values()), default=1) for axis in (0, 1))
    sky = np.zeros((count, *size, 3), np.float32)
    for i, image in skies.items():
        rows = np.arange(size[0]) * image.shape[0] // size[0]
        cols = np.arange(size[1]) * image.shape[1] // size[1]
        sky[i] = image[rows][:, cols, :3]
    casts = np.array([light.casts(shadows) for light in lights], np.bool_)
    entering = np.ones(2) if share is None else np.asarray(share, np.float64)
    return WalkLights(kind, source, casts, sky, rotate, entering), unit
