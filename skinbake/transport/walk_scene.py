"""What walks are given and what they write, as the kernels pass it on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.numerics import Float
from skinbake.transport.surface_rays import RayScene
from skinbake.transport.walk_medium import Coefficients, WalkMedium

HARD, THROUGH, WHOLE = 0, 1, 2  # estimates; see `walk_from`


class WalkLights(NamedTuple):
    """Lights as the kernels take them, each of unit irradiance, intensity or radiance; skies hold their own.

    Attributes
    ----------
    kind : ndarray of shape (L,), int64
    source : ndarray of shape (L, 10)
        Of `emitter` for directional, point and spot lights, about the rays' centre; a rectangle's centre and edges.
    casts : ndarray of shape (L,), bool
    sky : ndarray of shape (L, h, w, 3), float32
        Radiance maps, all of one size; zero for lights that are no sky.
    rotate : ndarray of shape (L,)
        Radians by which each map is turned.
    share : ndarray of shape (n,)
        Share of arriving light that enters, at cosines 0, 1/(n-1), ... 1.
    """

    kind: NDArray[np.int64]
    source: Float
    casts: NDArray[np.bool_]
    sky: NDArray[np.float32]
    rotate: Float
    share: Float


class WalkScene(NamedTuple):
    """What is the same for all of a walk.

    Attributes
    ----------
    rays : RayScene
    buffer : tuple
        Of `ray_buffer`.
    medium : WalkMedium
    bands : Coefficients of shape (K, 3)
        Of the walk's three channels.
    lights : WalkLights
    """

    rays: RayScene
    buffer: tuple[NDArray[np.float32], NDArray[np.uint32], int]
    medium: WalkMedium
    bands: Coefficients
    lights: WalkLights


class SkinPoint(NamedTuple):
    """A point of the skin.

    Attributes
    ----------
    at, normal : tuples of three floats
        Position, mm about the rays' centre, and unit normal.
    """

    at: tuple[float, float, float]
    normal: tuple[float, float, float]


class Place(NamedTuple):
    """Where a walk is, and where it goes.

    Attributes
    ----------
    at, direction : tuples of three floats
        mm about the rays' centre, and unit.
    normal : tuple of three floats
        Where the walk was last at the surface.
    depth : int
        How many closed parts hold the place.
    """

    at: tuple[float, float, float]
    direction: tuple[float, float, float]
    normal: tuple[float, float, float]
    depth: int


class Tally(NamedTuple):
    """Where a walk writes.

    Attributes
    ----------
    out : ndarray of shape (3, L, 3)
        What it brings by estimate, light and channel.
    mix : ndarray of shape (3, 3)
        Share of each of its bands in R, G and B.
    tau : ndarray of shape (2, 3)
        Room for optical depths.
    """

    out: Float
    mix: Float
    tau: Float
