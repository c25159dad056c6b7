"""Beams reach further: light that enters at a slant first scatters about a free path further along.

What a lobe of some width blurs is then not light where it entered, but where it was first scattered. So each place of
the skin is given the light that entered one transport free path times the sine inside upstream, along the tangent
(theory.md 9.6). As light is read from there, and not sent from here, constant light stays what it is; what that finds
too much of in all is taken off everywhere. Narrow lobes stand for light that came out again near where it entered; they
keep the light as it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas, AtlasRaster, Tiles
from skinbake.diffuse.terms.beam_shift import BeamShift
from skinbake.diffuse.terms.curvature import CurvedSkin
from skinbake.diffuse.terms.skin_hits import TexturedSkin
from skinbake.irradiance.irradiance_map import IrradianceMap
from skinbake.irradiance.scene_data import SceneData
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, safe_div
from skinbake.profile import GaussianSum
from skinbake.profile.effective_medium import one_layer
from skinbake.profile.entered_skin import EnteredSkin
from skinbake.profile.skin_medium import SkinMedium
from skinbake.scene.budget import Budget
from skinbake.scene.decision import Decision
from skinbake.scene.lights import DirectionalLight, LightSpec, PointLight, SpotLight
from skinbake.scene.spec import SceneSpec

Image = NDArray[np.float32]
NARROWEST_PATHS = 0.4  # free paths: narrower lobes are left alone; of 0.1 to 0.8 nearest to walks in two media
LOOKED_AT = 24  # one row in so many says how much the shift is worth


class BeamLight(NamedTuple):
    """Light for the wider lobes.

    Attributes
    ----------
    rgb : dict of int to ndarray of shape (L, H, W, 3), float32
        By tile.
    narrowest_mm2 : float
        Least variance of the lobes that blur it.
    """

    rgb: Tiles
    narrowest_mm2: float


class ShiftedLights:
    """Light of lamps where it first scatters, until all tiles have it: then no lamp has more of it than arrived."""

    def __init__(self) -> None:
        self._found: list[tuple[int, int, str, Image]] = []
        self._sums: dict[str, Float] = {}

    def add(self, raster: AtlasRaster, place: int, name: str, arrived: Image, upstream: Image) -> None:
        """Take what was read upstream of a lamp's light on a tile.

        Parameters
        ----------
        raster : AtlasRaster
        place : int
            Where the lamp stands in what is stored.
        name : str
            Of the lamp.
        arrived, upstream : ndarrays of shape (H, W, 3), float32
            The latter is kept.
        """
        rows = np.zeros((len(arrived), 2, 3))
        parallel_for(_sum_rows, len(rows), raster.area_mm2, arrived, upstream, rows)
        self._sums[name] = self._sums.get(name, 0.0) + rows.sum(axis=0)
        self._found.append((raster.tile, place, name, upstream))

    def add_to(self, moved: Tiles) -> None:
        """Add it all, and let it go.

        Parameters
        ----------
        moved : dict of int to ndarray of shape (L, H, W, 3), changed in place
            By tile.
        """
        while self._found:
            tile, place, name, upstream = self._found.pop()
            arrived, shifted = self._sums[name]
            share = np.minimum(safe_div(arrived, shifted), 1).astype(np.float32)
            parallel_for(_add_share, len(upstream), upstream, share, moved[tile][place])


def narrowest_mm2(free_path_mm: Float) -> float:
    """Least variance of lobes that blur shifted light, from the free paths of the channels."""
    return float((NARROWEST_PATHS * free_path_mm.mean()) ** 2)


def has_beam(light: LightSpec) -> bool:
    """Whether all of a light comes to a place from one direction."""
    return isinstance(light, DirectionalLight | PointLight | SpotLight)


def free_path_of(medium: SkinMedium, gaussians: GaussianSum) -> tuple[Float, float] | str:
    """Transport free path by channel, mm, and index, of the medium or of one that stands for it; or why it has none."""
    layer = one_layer(medium, gaussians)
    return layer if isinstance(layer, str) else (layer.medium.free_path_mm, layer.eta)


def decide_beams(
    spec: SceneSpec,
    budget: Budget,
    scene: SceneData,
    atlas: Atlas,
    irradiance: tuple[IrradianceMap, ...],
    skin: EnteredSkin,
    albedo_rgb: Float,
    curved: CurvedSkin | None,
    before: Sequence[BeamShift] = (),
) -> tuple[list[BeamShift], set[str], list[Decision]]:
    """What shifts light, by tile, the lights that are shifted, and the plan's lines.

    Parameters
    ----------
    spec : SceneSpec
    budget : Budget
    scene : SceneData
    atlas : Atlas
    irradiance : tuple of IrradianceMap
    skin : EnteredSkin
    albedo_rgb : ndarray of shape (3,)
        Mean albedo: red light, which goes furthest, is most of what leaves.
    curved : CurvedSkin, optional
        Where curvature is counted.
    before : sequence of BeamShift
        What an earlier decision of the same light, with other curvature, gave.
    """
    switch = spec.terms.beam
    if switch == "off":
        return [], set(), [Decision("beam", False, "off")]
    gaussians = skin.gaussians
    free_path = free_path_of(skin.medium, gaussians)
    if isinstance(free_path, str):
        return [], set(), [Decision("beam", False, f"{switch}: {free_path}")]
    wide = gaussians.variance_mm2 >= narrowest_mm2(free_path[0])
    weight = gaussians.weight_rgb * albedo_rgb
    share = weight[wide].sum(axis=0)
    textured = TexturedSkin(scene.mesh, scene.occluder, spec.texture.size, spec.texture.udim)
    shifts = list(before) or [BeamShift(raster, textured, k, *free_path) for k, raster in enumerate(atlas)]
    if curved:
        shifts = [s.curved(curved.curvature_per_mm[r.tile]) for s, r in zip(shifts, atlas, strict=True)]
    lines, room = [], np.empty((*atlas[0].shape, 3), np.float32)
    for i, name in enumerate(irradiance[0].lights):
        light = spec.light(name)
        if not has_beam(light):
            lines.append(Decision(f"{name}.beam", False, f"{switch}: its light has no one direction"))
            continue
        of_tiles = zip(atlas, shifts, irradiance, strict=True)
        squares = [moved_share(raster, shift, light, tile.rgb[i], room) for raster, shift, tile in of_tiles]
        moved, there = np.sum(squares, axis=0)
        leaves = float((weight.sum(axis=0) ** 2 * there).sum())
        lost = float(np.sqrt((share**2 * moved).sum() / leaves)) if leaves > 0 else 0.0
        lines.append(_decide_beam(name, lost, switch, budget.terms_left(name)))
    return shifts, {line.term.removesuffix(".beam") for line in lines if line.enabled}, lines


def moved_share(
    raster: AtlasRaster, shift: BeamShift, light: LightSpec, image: Image, room: Image
) -> tuple[Float, Float]:
    """Squares of the change and of the light, summed over a sample of a tile's skin, by channel.

    Parameters
    ----------
    raster : AtlasRaster
    shift : BeamShift
        Of the tile.
    light : LightSpec
    image : ndarray of shape (H, W, 3)
        Its light, which may be halves.
    room : ndarray of shape (H, W, 3), float32
        As in `BeamShift.looked_at`.
    """
    rows = np.arange(LOOKED_AT // 2 % len(image), len(image), LOOKED_AT)
    area = raster.area_mm2[rows][..., None].astype(np.float64)
    here, upstream = shift.looked_at(light, image, rows, room)
    moved = upstream.astype(np.float64) - here
    return (area * moved**2).sum(axis=(0, 1)), (area * here.astype(np.float64) ** 2).sum(axis=(0, 1))


def _decide_beam(name: str, moved: float, switch: str, limit: float) -> Decision:
    """Whether a shift is worth it for a light.

    Parameters
    ----------
    name : str
        Of the light.
    moved : float
        Change of what lobes that are wide enough blur, relative rms, times their share of the profile.
    switch : "auto" or "on"
    limit : float
        What may be left out.
    """
    why = f"{switch}: light that enters at a slant scatters further along: {moved:.2%} of it (rms) is elsewhere"
    kept = switch == "on" or moved > limit
    return Decision(f"{name}.beam", kept, f"{why}, worth it from {limit:.2%}", 0.0 if kept else moved)


@kernel
def _sum_rows(first, stop, area_mm2, arrived, upstream, out):  # type: ignore[no-untyped-def]
    """Light times area, summed over each row.

    Parameters
    ----------
    first, stop : int
        Rows.
    area_mm2 : ndarray of shape (H, W)
    arrived, upstream : ndarrays of shape (H, W, 3)
    out : ndarray of shape (H, 2, 3), float64
        Added to.
    """
    for row in range(first, stop):
        for col in range(area_mm2.shape[1]):
            area = np.float64(area_mm2[row, col])
            if area > 0.0:
                for c in range(3):
                    out[row, 0, c] += area * arrived[row, col, c]
                    out[row, 1, c] += area * upstream[row, col, c]


@kernel
def _add_share(first, stop, upstream, share, out):  # type: ignore[no-untyped-def]
    """Add a share of light to other light.

    Parameters
    ----------
    first, stop : int
        Rows.
    upstream, out : ndarrays of shape (H, W, 3), float32
    share : ndarray of shape (3,), float32
    """
    for row in range(first, stop):
        for col in range(upstream.shape[1]):
            for c in range(3):
                out[row, col, c] += share[c] * upstream[row, col, c]
