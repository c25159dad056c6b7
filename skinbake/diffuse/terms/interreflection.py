"""Skin that lights skin: nostrils, eye sockets, lips, behind the ear.

What leaves a point of the skin falls on what faces it. Rays from every texel of a smaller texture, cosine distributed
over the hemisphere, say which other texels it sees: that is found once and serves every light. The irradiance of skin
is then the mean of what the texels that were hit send back, M; rays that meet no skin bring nothing (theory.md 9.7).
Bounced light is smooth, so that few and coarse texels are enough, read bilinearly at the full size.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas
from skinbake.diffuse.terms.ray_counts import NOISE_FALL
from skinbake.diffuse.terms.skin_hits import NOTHING, TexturedSkin
from skinbake.diffuse.terms.skin_view import RAYS, RECEIVER_MM, RayStarts, trace_cosine
from skinbake.irradiance.surface import places_of_texels
from skinbake.scene.decision import Decision

Image = NDArray[np.float32]
Index = NDArray[np.int64]
RECEIVERS_ACROSS = 190  # of them at least across what is smaller than a head: its forms are smaller, too
LEAST_RAYS, MOST_RAYS = 32, 512
COARSE_ERROR = 0.1  # of the bounced light: what such texels and rays leave wrong; 0.09 on a head, 0.2 about a hill
COARSENESS = 0.4, 3.0  # the finest and the coarsest there are, in units of these
ESTIMATED, ESTIMATE_RAYS = 4000, 16  # texels and rays by which `auto` decides
# Light is a mean with the neighbours where texels are as fine as this and would need more rays. It leaves .027 of what
# is bounced on two heads, of texels of 0.8 and 0.5 mm; with what those are too coarse by .03
FINEST, NEIGHBOURS_FROM, NEIGHBOURS_ERROR = 0.6, 64, 0.075
_OTHER_TURN = 7919
_ROWS = 32  # of the texture, whose area is summed at a time
_ALL = np.ones(3, np.float32)


class Bounced(NamedTuple):
    """What skin sends on of a light, found with few rays.

    Attributes
    ----------
    rms : float
        As a share of the light's rms.
    noise : float
        Standard error of it for `ESTIMATE_RAYS` / 2 rays a texel, a share of the same.
    """

    rms: float
    noise: float

    def rays_for(self, limit: float) -> float:
        """How many rays a texel leave an error of `limit`."""
        return ESTIMATE_RAYS / 2 * (self.noise / max(limit, 1e-12)) ** (1 / NOISE_FALL)

    def noise_of(self, rays: float) -> float:
        """Error that is left by that many rays."""
        return self.noise * (ESTIMATE_RAYS / 2 / rays) ** NOISE_FALL


class Receivers(NamedTuple):
    """How finely light from skin is taken.

    Attributes
    ----------
    coarser : float
        Texels are this times as wide as the usual ones.
    usual_mm : float
        Width of those.
    rays : float
        That each would send, if all sent as many (`look_around`).
    """

    coarser: float
    usual_mm: float = RECEIVER_MM
    rays: float = RAYS

    @property
    def width_mm(self) -> float:
        """Width of the texels that receive, mm."""
        return self.usual_mm * self.coarser

    @property
    def with_neighbours(self) -> bool:
        """Whether the light of each is the mean with its neighbours."""
        return self.rays > NEIGHBOURS_FROM and self.coarser <= FINEST

    def error(self, bounced: Bounced, noise: float | None = None) -> float:
        """Rms that is left wrong of a light, as a share of it.

        Parameters
        ----------
        bounced : Bounced
        noise : float, optional
            What the rays of neighbours left, as a share of it, where they were traced: else by what few rays showed.
        """
        if not self.with_neighbours:
            return max(COARSE_ERROR * self.coarser * bounced.rms, bounced.noise_of(self.rays))
        wrong = bounced.noise_of(self.rays) if noise is None else noise
        return float(np.hypot(NEIGHBOURS_ERROR * self.coarser * bounced.rms, wrong))


def receivers(bounced: Sequence[Bounced], limits: Sequence[float], atlas: Atlas) -> Receivers:
    """The coarsest texels that receive, whose error no light's limit forbids.

    Parameters
    ----------
    bounced : sequence of Bounced
        Light from skin, of each light that has the term.
    limits : sequence of float
        Rms that may be made, of each.
    atlas : Atlas
        Its area says how small the skin's forms are.
    """
    across_mm = float(np.sqrt(sum(raster.area_mm2.sum(dtype=np.float64) for raster in atlas)))
    pairs = list(zip(bounced, limits, strict=True))
    allowed = min(limit / max(COARSE_ERROR * each.rms, 1e-12) for each, limit in pairs)
    rays = min(max(each.rays_for(limit) for each, limit in pairs), MOST_RAYS)
    usual_mm = min(RECEIVER_MM, across_mm / RECEIVERS_ACROSS)
    rays = max(rays, LEAST_RAYS, RAYS / min(max(allowed, COARSENESS[0]), COARSENESS[1]))
    return Receivers(float(np.clip(allowed, *COARSENESS)), usual_mm, rays)


def decide_interreflection(
    skin: TexturedSkin,
    names: Sequence[str],
    light: Sequence[Image],
    reflected: Sequence[Image],
    atlas: Atlas,
    switch: str,
    limits: Sequence[float],
    gain: Image = _ALL,
) -> tuple[list[Decision], list[Bounced]]:
    """Whether skin lights skin by more than may be left out, a line a light, and how much that is.

    `auto` looks from a few texels with a few rays, the same for all lights.

    Parameters
    ----------
    skin : TexturedSkin
    names : sequence of L str
        Of the lights.
    light : sequence of ndarray of shape (L, H, W, 3)
        Irradiance, by tile.
    reflected : sequence of ndarray of shape (H, W, 3) or (1, 1, 3)
        What of it leaves.
    atlas : Atlas
        The skin's.
    switch : "auto", "on" or "off"
    limits : sequence of L float
        What may be left out of each light.
    gain : ndarray of shape (3,), float32
        What of that enters where it falls on skin.
    """
    if switch == "off":
        return [Decision("interreflection", False, "off")], []
    arrived, bounced, apart = np.zeros((3, len(names)))
    width, height = skin.size
    for number, (raster, image) in enumerate(zip(atlas, light, strict=True)):
        area_mm2, flat = texels_by_area(raster.area_mm2, ESTIMATED)
        if area_mm2 <= 0:
            continue
        rows, cols = np.divmod(flat, width)
        point, normal = places_of_texels(raster, flat, skin.mesh, skin.occluder)
        zero = np.zeros_like(flat)
        # Two halves that know nothing of each other: the second one's rays are turned otherwise
        halves = [
            trace_cosine(skin, RayStarts(point, normal, flat * turn, zero), ESTIMATE_RAYS // 2)
            for turn in (1, _OTHER_TURN)
        ]
        seen_tile, seen = (np.concatenate(each, axis=1) for each in zip(*halves, strict=True))
        got = np.zeros((len(names), len(flat), 2, 3))
        for k, (other, colour) in enumerate(zip(light, reflected, strict=True)):
            texel, ray = np.nonzero((seen != NOTHING) & (seen_tile == k))
            at = np.divmod(seen[texel, ray], width)
            sent = other[:, at[0], at[1]].astype(np.float64)
            sent *= np.broadcast_to(colour, (height, width, 3))[at] * gain
            for total, each in zip(got, sent, strict=True):
                np.add.at(total, (texel, ray // (ESTIMATE_RAYS // 2)), each * (2 / ESTIMATE_RAYS))
        # As it leaves again: what is red counts more where the skin is
        colour = (np.broadcast_to(reflected[number], (height, width, 3))[rows, cols] * gain).astype(np.float64)
        direct = image[:, rows, cols] * colour
        got *= colour[:, None]
        share = area_mm2 / len(flat)
        arrived += share * (direct**2).sum(axis=(1, 2))
        # The product of two halves is, on average, the square without the rays' own noise
        bounced += share * (got[:, :, 0] * got[:, :, 1]).sum(axis=(1, 2))
        apart += share * ((got[:, :, 0] - got[:, :, 1]) ** 2).sum(axis=(1, 2)) / 2
    found, shares = [], []
    for name, lit, got_light, square, limit in zip(names, arrived, bounced, apart, limits, strict=True):
        rms, noise = (float(np.sqrt(max(each, 0) / lit)) if lit > 0 else 0.0 for each in (got_light, square))
        why = f"{switch}: skin lights skin with {rms:.2%} of its light (rms), worth it from {limit:.2%}"
        kept = switch == "on" or rms > limit
        found.append(Decision(f"{name}.interreflection", kept, why, 0.0 if kept else rms))
        shares.append(Bounced(rms, noise))
    return found, shares


def texels_by_area(area_mm2: Image, count: int) -> tuple[float, Index]:
    """All of the area, mm^2, and texels, (count,), of which each stands for as much of it, row by row.

    By sums of rows, then within some rows at a time: sums up to every texel are memory that is touched once, which took
    more than all the rays.

    Parameters
    ----------
    area_mm2 : ndarray of shape (H, W)
    count : int
    """
    height, width = area_mm2.shape
    below = np.cumsum(area_mm2.sum(axis=1, dtype=np.float64))
    places = (np.arange(count) + 0.5) / count * below[-1]
    row = np.minimum(np.searchsorted(below, places), height - 1)
    flat = np.empty(count, np.int64)
    for first in range(0, height, _ROWS):
        mine = slice(*np.searchsorted(row, (first, first + _ROWS)))
        reached = np.cumsum(area_mm2[first : first + _ROWS].ravel(), dtype=np.float64)
        reached += below[first - 1] if first else 0.0
        flat[mine] = first * width + np.minimum(np.searchsorted(reached, places[mine]), len(reached) - 1)
    return float(below[-1]), flat
