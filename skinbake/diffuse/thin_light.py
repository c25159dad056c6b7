"""Light that came through flesh lights other skin: the inside of a nostril by its wing, the ear's bowl by its rim.

What `interreflection` sends is irradiance times what leaves of it, and a wall that only gets light through the flesh
has no irradiance. So M, once it is known, less that product is sent on, bounce after bounce as ever, and what leaves
of it is added to transmitted light, unblurred: it is smooth (theory.md 9.7).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster, coarser_size
from skinbake.bilinear import magnify_bilinear
from skinbake.diffuse.diffuse_map import Lobe
from skinbake.diffuse.light_entering import albedo_of
from skinbake.diffuse.skin_weights import SkinWeights
from skinbake.diffuse.terms.bounced_light import SkinLight, add_at_full_size, fitted, middles
from skinbake.diffuse.terms.thin_parts import ThinParts
from skinbake.irradiance.scene_data import SceneData
from skinbake.profile import GaussianSum
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SceneSpec

Image = NDArray[np.float32]
SOURCE_MM = 1.0  # texels that send
LEFT_OUT = 0.1  # of the tolerance: where less than this share of the light's rms arrives, none does


class SmallLight(NamedTuple):
    """Light that enters the skin, at the texels of transmitted light.

    Attributes
    ----------
    thin : ThinParts
        Whose texels these are.
    tiles : tuple of ndarray of shape (L, h, w, 3)
        Irradiance times albedo^x, in its order.
    """

    thin: ThinParts
    tiles: tuple[Image, ...]

    @classmethod
    def of(cls, rgb: Mapping[int, Image], thin: ThinParts) -> SmallLight:
        """The same light at fewer texels: what stands at the middle of each; itself, where they are no fewer."""
        return cls(thin, tuple(_at_middles(rgb[each.raster.tile], each.raster.shape) for each in thin.tiles))


def sent_on(
    through: Lobe,
    lobes: tuple[Lobe, ...],
    entered: SmallLight,
    names: Sequence[str],
    skin_light: SkinLight,
    spec: SceneSpec,
    scene: SceneData,
    gaussians: GaussianSum,
    rest: Callable[[], None] = lambda: None,
) -> Lobe:
    """Transmitted light with what other skin gets of it. Takes the pixels out of `through`.

    Parameters
    ----------
    through : Lobe
        (L, h, w, 3) a tile.
    lobes : tuple of Lobe
        Blurred light.
    entered : SmallLight
        What was blurred.
    names : sequence of L str
        Of the lights; those without interreflection are left as they are.
    skin_light : SkinLight
    spec : SceneSpec
    scene : SceneData
    gaussians : GaussianSum
    rest : callable, optional
        Frees the memory of each lobe that was read.
    """
    atlas = [each.raster for each in entered.thin.tiles]
    albedo = [albedo_of(scene.maps, raster, scene.mesh) for raster in atlas]
    weights, before = SkinWeights.of(gaussians, scene.maps), np.float32(spec.texturing.exponent_before)
    sources = [_source_shape(raster, scene.mesh) for raster in atlas]
    total = [weights.total_image(raster.tile, raster.shape) for raster in atlas]
    tiles = {raster.tile: through.rgb.pop(raster.tile) for raster in atlas}
    leaving = _leaving(lobes, weights, atlas, sources, rest)
    for i, name in enumerate(names):
        if name not in skin_light.gain:
            continue
        sent, square, area = [], 0.0, 0.0
        for raster, shape, colour, light, share, blurred in zip(
            atlas, sources, albedo, entered.tiles, total, leaving, strict=True
        ):
            known = _at_middles(light[i : i + 1], shape)[0] * fitted(share, shape)
            more = _at_middles(tiles[raster.tile][i : i + 1], shape)[0] - known + blurred[i]
            # Skin is lit by what is shown, which is what is stored times the rest of the albedo
            sent.append(more * fitted(colour, shape) ** (1 - before))
            of = fitted(raster.area_mm2[..., None], shape)
            square, area = square + float((of * known**2).sum()), area + 3 * float(of.sum())
        least = np.float32(LEFT_OUT * spec.diffusion.tolerance * np.sqrt(square / max(area, 1e-30)))
        for raster, small, colour, share in zip(atlas, skin_light.lit_by(name, sent), albedo, total, strict=True):
            arrived = np.zeros((*raster.shape, 3), np.float32)
            add_at_full_size(small, raster, arrived)
            at = np.nonzero(np.abs(arrived).max(axis=2) > least)
            more = arrived[at] * _at(colour, at) ** before * _at(share, at)
            # Less by the least there is, so that none of it begins with a step
            more = np.sign(more) * np.maximum(np.abs(more) - least, 0)
            image = tiles[raster.tile][i]
            image[at] = np.maximum(image[at] + more, 0)  # next to a shadow, lit skin sends less than it gets
    return replace(through, rgb=tiles)


def _leaving(
    lobes: tuple[Lobe, ...],
    weights: SkinWeights,
    atlas: Sequence[AtlasRaster],
    sources: Sequence[tuple[int, int]],
    rest: Callable[[], None],
) -> list[Image]:
    """Weighted sum of the lobes at the texels that send, (L, h, w, 3) a tile.

    Parameters
    ----------
    lobes : tuple of Lobe
    weights : SkinWeights
    atlas : sequence of AtlasRaster
        Of transmitted light.
    sources : sequence of (h, w)
        Shapes of the textures that send.
    rest : callable
        As in `sent_on`.
    """
    out = [np.zeros((1, 1, 1, 3), np.float32) for _ in atlas]
    for k, lobe in enumerate(lobes):
        for place, (raster, shape) in enumerate(zip(atlas, sources, strict=True)):
            out[place] = out[place] + _at_middles(lobe.rgb[raster.tile], shape) * weights.image(k, raster.tile, shape)
        rest()
    return out


def _source_shape(raster: AtlasRaster, mesh: SkinMesh) -> tuple[int, int]:
    """Height and width of the texture that light is sent from."""
    size = raster.shape[::-1]
    width, height = coarser_size(mesh, size, SOURCE_MM)
    return height, width


def _at(image: Image, at: tuple[NDArray[np.intp], ...]) -> Image:
    """Pixels of an image (H, W, 3), or of a constant."""
    return image[0, 0] if image.shape[:2] == (1, 1) else image[at]


def _at_middles(images: Image, shape: tuple[int, int]) -> Image:
    """Images (L, H, W, 3) at the texels of another size: bilinear at a larger one, else what is at their middles."""
    height, width = images.shape[1:3]
    if (height, width) == tuple(shape):
        return np.asarray(images, np.float32)
    if height < shape[0] or width < shape[1]:
        return np.stack([magnify_bilinear(np.asarray(image, np.float32), shape) for image in images])
    return np.asarray(images[:, middles(shape[0], height)][:, :, middles(shape[1], width)], np.float32)
