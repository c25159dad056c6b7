"""Light that came through flesh lights other skin: the inside of a nostril by its wing, the ear's bowl by its rim.

What `interreflection` sends is irradiance times what leaves of it, and a wall that only gets light through the flesh
has no irradiance. So M, once it is known, less that product is sent on, bounce after bounce as ever, and what leaves
of it is added to transmitted light, blurred by the same lobes at the few texels that it is found at (theory.md 9.7).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import AtlasRaster, coarser_size
from skinbake.atlas.raster import NO_FACE
from skinbake.atlas.sample import bilinear, texels_around
from skinbake.bilinear import add_magnified, magnify_bilinear
from skinbake.diffuse.diffuse_map import Lobe
from skinbake.diffuse.light_entering import albedo_of
from skinbake.diffuse.skin_weights import SkinWeights
from skinbake.diffuse.small_blur import SmallBlur
from skinbake.diffuse.terms.bounced_light import SkinLight, fitted, lights_at_once, middles
from skinbake.diffuse.terms.curvature import CurvedSkin
from skinbake.diffuse.terms.thin_parts import ThinParts
from skinbake.irradiance.scene_data import SceneData
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import on_threads, parallel_for
from skinbake.numerics import Float, safe_div
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
    atlas : tuple of AtlasRaster
        Whose texels these are.
    tiles : tuple of ndarray of shape (L, h, w, 3)
        Irradiance times albedo^x, in its order.
    """

    atlas: tuple[AtlasRaster, ...]
    tiles: tuple[Image, ...]

    @classmethod
    def of(cls, rgb: Mapping[int, Image], thin: ThinParts) -> SmallLight:
        """The same light at fewer texels: what stands at the middle of each; itself, where they are no fewer."""
        atlas = tuple(each.raster for each in thin.tiles)
        return cls(atlas, tuple(_at_middles(rgb[raster.tile], raster.shape) for raster in atlas))


class SentOn(NamedTuple):
    """Transmitted light with what other skin gets of it.

    Attributes
    ----------
    lobe : Lobe
    more, error : dict of str to float
        By light that has interreflection, rms of what skin got by that and of what is wrong of it, as shares of the
        light's.
    """

    lobe: Lobe
    more: dict[str, float]
    error: dict[str, float]


def sent_on(
    through: Lobe,
    lobes: tuple[Lobe, ...],
    entered: SmallLight,
    names: Sequence[str],
    skin_light: SkinLight,
    blur: SmallBlur,
    spec: SceneSpec,
    scene: SceneData,
    gaussians: GaussianSum,
    rest: Callable[[], None] = lambda: None,
    left: Mapping[int, Image] | None = None,
    curved: CurvedSkin | None = None,
    otherwise: Sequence[bool] = (),
) -> SentOn:
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
    blur : SmallBlur
        By the same lobes, of the texels that receive light from skin.
    spec : SceneSpec
    scene : SceneData
    gaussians : GaussianSum
    rest : callable, optional
        Frees the memory of each lobe that was read.
    left : mapping of int to ndarray of shape (L, H, W, 3), optional
        By tile: the weighted sum of the lobes at the full size, where somebody has it.
    curved : CurvedSkin, optional
        Where it changes lobes.
    otherwise : sequence of L bool, optional
        As in `SmallBlur.lobes`.
    """
    atlas = entered.atlas
    albedo = [albedo_of(scene.maps, raster, scene.mesh) for raster in atlas]
    weights, before = SkinWeights.of(gaussians, scene.maps), np.float32(spec.texturing.exponent_before)
    sources = [_source_shape(raster, scene.mesh) for raster in atlas]
    total = [weights.total_image(raster.tile, raster.shape) for raster in atlas]
    tiles = {raster.tile: through.rgb.pop(raster.tile) for raster in atlas}
    if left is None:
        leaving = _leaving(lobes, weights, atlas, sources, rest)
    else:
        leaving = [_at_middles(left[raster.tile], shape) for raster, shape in zip(atlas, sources, strict=True)]
    known = [fitted(share, shape) for share, shape in zip(total, sources, strict=True)]
    # Skin is lit by what is shown, which is what is stored times the rest of the albedo
    shown = [fitted(colour, shape) ** (1 - before) for colour, shape in zip(albedo, sources, strict=True)]
    enters = [colour**before for colour in albedo]
    lit = [i for i, name in enumerate(names) if name in skin_light.gain]
    at_once, more, error = lights_at_once(skin_light.view, max(sources)), dict[str, float](), dict[str, float]()
    for some in (lit[k : k + at_once] for k in range(0, len(lit), at_once)):
        sent, square, area = [], np.zeros(len(some)), 0.0
        for place, (raster, shape, light) in enumerate(zip(atlas, sources, entered.tiles, strict=True)):
            of = fitted(raster.area_mm2[..., None], shape)
            sends = _Sends(light, tiles[raster.tile], leaving[place], known[place], shown[place], of)
            sent.append(np.empty((len(some), *shape, 3), np.float32))
            on_threads(partial(_send, sends, some, sent[-1], square), len(some))
            area += 3 * float(of.sum())
        left_out = LEFT_OUT * spec.diffusion.tolerance
        least = left_out * np.sqrt(square / max(area, 1e-30))
        arrives, rms, wrong = skin_light.lit_by([names[i] for i in some], sent)
        for i, got, of_it in zip(some, safe_div(rms, np.sqrt(square)), safe_div(wrong, np.sqrt(square)), strict=True):
            more[names[i]], error[names[i]] = float(got), float(np.hypot(of_it, min(left_out, got)))
        lit_again = _blurred(
            arrives, blur, curved, skin_light.view.atlas, weights, [otherwise[i] for i in some if otherwise]
        )
        for raster, small, colour, share in zip(atlas, lit_again, enters, total, strict=True):
            of_skin = raster.face_index, colour, share.astype(np.float32, copy=False)
            for k, i in enumerate(some):
                parallel_for(_add, raster.shape[0], small[k], np.float32(least[k]), of_skin, tiles[raster.tile][i])
    return SentOn(replace(through, rgb=tiles), more, error)


def sent_again(skin_light: SkinLight, names: Sequence[str], through: Lobe) -> Float:
    """Rms over the skin of what it sends on of transmitted light alone, (L,); 0 of lights without interreflection.

    Parameters
    ----------
    skin_light : SkinLight
    names : sequence of L str
        Of the lights.
    through : Lobe
        (L, h, w, 3) a tile.
    """
    rms, atlas = np.zeros(len(names)), skin_light.view.atlas
    lit = [i for i, name in enumerate(names) if name in skin_light.gain]
    images = [through.rgb[raster.tile] for raster in atlas]
    at_once = lights_at_once(skin_light.view, max(image.shape[1:3] for image in images))
    for some in (lit[k : k + at_once] for k in range(0, len(lit), at_once)):
        rms[some] = skin_light.lit_by([names[i] for i in some], [image[some] for image in images])[1]
    found: Float = rms / np.sqrt(sum(float(raster.area_mm2.sum()) for raster in atlas))
    return found


def _blurred(
    arrives: Sequence[Image],
    blur: SmallBlur,
    curved: CurvedSkin | None,
    atlas: Sequence[AtlasRaster],
    weights: SkinWeights,
    otherwise: Sequence[bool],
) -> list[Image]:
    """Light as lobes spread it, (L, h, w, 3) a tile: what leaves of it over what the skin's profile sends back.

    Here form counts whole, with the light from the other side that it has: rays into the flesh are not followed again.

    Parameters
    ----------
    arrives : sequence of ndarray of shape (L, h, w, 3)
        Irradiance by tile.
    blur, curved, weights, otherwise
        As in `sent_on`.
    atlas : sequence of AtlasRaster
        Its own.
    """
    lobes = blur.lobes({raster.tile: image for raster, image in zip(atlas, arrives, strict=True)}, otherwise)
    if curved:
        lobes = curved.applied(lobes)
    leaves = _leaving(lobes, weights, atlas, [raster.shape for raster in atlas], lambda: None)
    total = [weights.total_image(raster.tile, raster.shape) for raster in atlas]
    return [safe_div(image, each).astype(np.float32) for image, each in zip(leaves, total, strict=True)]


class _Sends(NamedTuple):
    """What light that skin sends on of transmitted light is made of, on a tile.

    Attributes
    ----------
    entered, through : ndarrays of shape (L, H, W, 3)
        Light that enters, and that came through, at the texels of transmitted light.
    leaving : ndarray of shape (L, h, w, 3)
        Of the lobes, at the texels that send.
    known, shown : ndarrays of shape (h, w, 3) or (1, 1, 3)
        What of the first has been sent already, and what of the rest is seen.
    area_mm2 : ndarray of shape (h, w, 1)
    """

    entered: Image
    through: Image
    leaving: Image
    known: Image
    shown: Image
    area_mm2: Image


def _send(sends: _Sends, some: Sequence[int], out: Image, square: NDArray[np.float64], k: int) -> None:
    """M of the k-th of some lights that has not been sent yet, and the sum of squares of what has, added.

    Parameters
    ----------
    sends : _Sends
    some : sequence of int
        Numbers of the lights.
    out : ndarray of shape (k or more, h, w, 3), float32
        Written.
    square : ndarray of shape (k or more,)
        Added to.
    k : int
    """
    one, shape = some[k : k + 1], out.shape[1:3]
    already = _some(sends.entered, one, shape)[0] * sends.known
    more = _some(sends.through, one, shape)[0] - already + sends.leaving[some[k]]
    np.multiply(more, sends.shown, out=out[k])
    square[k] += float((sends.area_mm2 * already**2).sum())


@kernel
def _add(start, stop, small, least, of_skin, out):  # type: ignore[no-untyped-def]
    """Add what leaves of light from skin, read bilinearly, less by the least there is: none of it begins with a step.

    Parameters
    ----------
    start, stop : int
        Rows.
    small : ndarray of shape (h, w, 3), float32
        What arrives.
    least : float32
        Where no channel gets more, none is added.
    of_skin : tuple of three ndarrays
        Faces of the texels, (H, W); albedo before scattering and what leaves, (H, W, 3) or (1, 1, 3).
    out : ndarray of shape (H, W, 3), float32
        Added to; not below 0, for next to a shadow lit skin sends less than it gets.
    """
    face_index, colour, share = of_skin
    height, width = face_index.shape
    for row in range(start, stop):
        for col in range(width):
            if face_index[row, col] == NO_FACE:
                continue
            around = texels_around((col + 0.5) / width, 1.0 - (row + 0.5) / height, small.shape[0], small.shape[1])
            r = np.float32(bilinear(small, 0, around))
            g = np.float32(bilinear(small, 1, around))
            b = np.float32(bilinear(small, 2, around))
            if not max(abs(r), abs(g), abs(b)) > least:
                continue
            for c in range(3):
                enters = colour[row % len(colour), col % colour.shape[1], c]
                more = (r if c == 0 else g if c == 1 else b) * enters
                more *= share[row % len(share), col % share.shape[1], c]
                more = np.sign(more) * max(abs(more) - least, np.float32(0))
                out[row, col, c] = max(out[row, col, c] + more, np.float32(0))


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
    lights = len(lobes[0].rgb[atlas[0].tile])
    out = [np.zeros((lights, *shape, 3), np.float32) for shape in sources]
    for k, lobe in enumerate(lobes):
        for image, raster, shape in zip(out, atlas, sources, strict=True):
            weight, rgb = weights.image(k, raster.tile, shape), lobe.rgb[raster.tile]

            def add(
                i: int, image: Image = image, rgb: Image = rgb, shape: tuple[int, int] = shape, weight: Image = weight
            ) -> None:
                if rgb.shape[1] < shape[0] or rgb.shape[2] < shape[1]:
                    add_magnified(rgb[i], weight, image[i])
                else:
                    image[i] += _at_middles(rgb[i : i + 1], shape)[0] * weight

            on_threads(add, lights)
        rest()
    return out


def _source_shape(raster: AtlasRaster, mesh: SkinMesh) -> tuple[int, int]:
    """Height and width of the texture that light is sent from."""
    size = raster.shape[::-1]
    width, height = coarser_size(mesh, size, SOURCE_MM)
    return height, width


def _some(images: Image, some: Sequence[int], shape: tuple[int, int]) -> Image:
    """Some of the images (L, H, W, 3) at the texels of another size."""
    return np.concatenate([_at_middles(images[i : i + 1], shape) for i in some])


def _at_middles(images: Image, shape: tuple[int, int]) -> Image:
    """Images (L, H, W, 3) at the texels of another size: bilinear at a larger one, else what is at their middles."""
    height, width = images.shape[1:3]
    if (height, width) == tuple(shape):
        return np.asarray(images, np.float32)
    if height < shape[0] or width < shape[1]:
        return np.stack([magnify_bilinear(np.asarray(image, np.float32), shape) for image in images])
    rows, cols = middles(shape[0], height), middles(shape[1], width)
    return np.asarray(images[:, rows[:, None], cols], np.float32)
