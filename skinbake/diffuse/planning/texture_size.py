"""The size that light is traced and blurred at: as coarse as the tolerance allows.

What a coarser texture loses is detail of the maps and sharpness of shadows' edges. Both are made on patches of the
skin, at each size as a bake makes them, and blurred by the lobes; what two sizes differ by is the loss.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Tiled, local_uv, tile_of_face, uv_jacobian
from skinbake.atlas.sample import shrink
from skinbake.atlas.texel_coordinates import texel_xy
from skinbake.bilinear import magnify_bilinear, read_bilinear
from skinbake.diffuse.skin_weights import SkinWeights
from skinbake.numerics import Float, normalized, safe_div
from skinbake.profile import GaussianSum
from skinbake.scene.decision import Decision
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SceneSpec

TIGHT = 0.01  # whoever asks for this, which is the default, or less gets the size that he asks for
SMALLEST = 512  # texels of the shorter side that are never gone below
SHARES = (Fraction(1, 4), Fraction(1, 2), Fraction(3, 4))  # of the asked size, the coarsest first
SHARE = 0.9  # of the tolerance that the size may take; the rest is left to others, as a root of squares
EDGES_PER_MM = 0.0028  # mm of shadows' edges a mm^2 of skin, times the squares of their steps over that of all light
_PATCHES, _SIDE, _GRID = 96, 64, 4  # texels that patches begin at a multiple of: coarser texels hold whole ones
_LIGHT_DEG = 54.7  # from the normal: tan^2 is 2, its mean, by squares of light, over a sphere lit from one side
_WINDOW_RMS = 3 / 8

Image = NDArray[np.float32]


class TextureSize(NamedTuple):
    """The size to work at.

    Attributes
    ----------
    size : (int, int)
        (width, height).
    lost : float
        Estimated rms of the light leaving the skin that the asked size would show and this one does not, as a share.
    decision : Decision or None
        The line of the plan; None where nothing was to be decided.
    """

    size: tuple[int, int]
    lost: float = 0.0
    decision: Decision | None = None


def coarser_sizes(size: tuple[int, int]) -> dict[Fraction, tuple[int, int]]:
    """Sizes that a look may be worked at in place of the one it asks for, by their share of it, the smallest first."""
    width, height = size
    fits = [share for share in SHARES if not width % share.denominator and not height % share.denominator]
    found = {share: (int(width * share), int(height * share)) for share in fits}
    return {share: each for share, each in found.items() if min(each) >= SMALLEST}


def may_be_reduced(spec: SceneSpec) -> bool:
    """Whether a look leaves room for a coarser size: what `choose_size` needs is read for no other."""
    return spec.texture.reduce == "auto" and spec.diffusion.tolerance > TIGHT and bool(coarser_sizes(spec.texture.size))


def choose_size(spec: SceneSpec, mesh: SkinMesh, maps: SkinMaps, gaussians: GaussianSum) -> TextureSize:
    """The coarsest size whose loss is within its share of the tolerance.

    Parameters
    ----------
    spec : SceneSpec
    mesh : SkinMesh
    maps : SkinMaps
    gaussians : GaussianSum
        The lobes, which blur what is lost.
    """
    asked, tolerance = spec.texture.size, spec.diffusion.tolerance
    if not may_be_reduced(spec):
        return TextureSize(asked)
    patches, size, loss, told = LitPatches(spec, mesh, maps, gaussians), asked, 0.0, dict[Fraction, str]()
    left = list(coarser_sizes(asked).items())
    while left:  # from the middle on: a coarser size loses more, and a finer one less
        share, coarser = left[len(left) // 2]
        lost = patches.lost(share)
        told[share] = f"{coarser[0]} x {coarser[1]} loses {lost:.2%}"
        fits = lost <= SHARE * tolerance
        if fits:
            size, loss = coarser, lost
        left = [each for each in left if (each[0] < share if fits else each[0] > share)]
    sizes = ", ".join(told[share] for share in sorted(told, reverse=True))
    why = (
        f"auto: {size[0]} x {size[1]} of {asked[0]} x {asked[1]}: {sizes}, tolerance {tolerance:.2%}; "
        "`texture.reduce: off` keeps the size"
    )
    how = f"{size[0]} x {size[1]}" + (f" of {asked[0]} x {asked[1]}" if size != asked else "")
    return TextureSize(size, loss, Decision("texture_size", size == asked, why, loss, how))


def at_size(spec: SceneSpec, size: TextureSize) -> SceneSpec:
    """The look at another size."""
    if size.size == spec.texture.size:
        return spec
    return spec.model_copy(update={"texture": spec.texture.model_copy(update={"size": size.size, "reduce": "off"})})


class LitPatches:
    """Light that leaves patches of the skin, traced and blurred at any size: theory.md 5.13. Images are (S, S, K, 3).

    Patches of the texture are drawn by skin area. On each, at the asked size and at the coarser one, albedo and
    normals are averaged over texels, lit from a slant, blurred by the lobes as a lattice blurs and read bilinearly; so
    is a straight edge of a shadow on plain skin, of which EDGES_PER_MM says how much there is. Where maps vary the
    skin, each texel shows the lobes by its own weights: hair keeps more of its detail than the mean skin would.

    Parameters
    ----------
    spec : SceneSpec
    mesh : SkinMesh
    maps : SkinMaps
    gaussians : GaussianSum
    """

    def __init__(self, spec: SceneSpec, mesh: SkinMesh, maps: SkinMaps, gaussians: GaussianSum) -> None:
        rng = np.random.default_rng([spec.output.seed, 5])
        self._patches = patches = _draw_patches(rng, spec, mesh)
        self._turn = rng.uniform(0, 2 * np.pi, _PATCHES)
        self._edge = _straight_edges(rng)
        self._before = spec.texturing.exponent_before
        albedo = _read(maps.albedo, spec, patches, np.array(maps.albedo_rgb)) if maps.albedo else np.ones((1, 1, 1, 3))
        self._albedo = np.maximum(albedo, 0.0).astype(np.float32)
        self._normal = None
        if maps.normal:
            normal = _read(maps.normal, spec, patches, np.array([0.0, 0.0, 1.0]))
            if maps.normal_space == "tangent":
                normal[..., :2] *= maps.normal_strength
            self._normal = normal.astype(np.float32)
        self._variance_mm2 = gaussians.variance_mm2
        self._weights = _patch_weights(gaussians, maps, patches)

    def lost(self, share: Fraction) -> float:
        """Rms share of the light leaving that a size of `share` of the asked one does not show."""
        count = int(_SIDE * share)
        detail = _mean_square(self._maps_seen(count) - self._fine[0]) / _WINDOW_RMS**2
        edge = np.mean(np.square(self._edge_seen(count) - self._fine[1]), axis=(0, 1, 3), dtype=np.float64)
        # An edge through a patch's middle, where the window is 1, counts by its length: the same along all directions
        edges = EDGES_PER_MM * np.median(edge * _SIDE * self._patches.mm_per_texel) / _WINDOW_RMS
        return float(np.sqrt(detail / self._total + edges))

    @cached_property
    def _fine(self) -> tuple[Image, Image]:
        return self._maps_seen(_SIDE), self._edge_seen(_SIDE)

    @cached_property
    def _total(self) -> float:
        """Mean square of the light, as a texture of the asked size would have it if nothing were blurred."""
        return _mean_square(self._after * self._fine_light)

    @cached_property
    def _level(self) -> Image:
        """Mean light of each patch, which no size loses, and the window need not fade."""
        return self._fine_light.mean(axis=(0, 1))

    @cached_property
    def _fine_light(self) -> Image:
        return self._light(_SIDE)

    @cached_property
    def _after(self) -> Image:
        """What of the albedo is multiplied after the blur, where the texture has its full size: theory.md 5.1."""
        return self._albedo ** (1 - self._before)

    def _light(self, count: int) -> Image:
        """Light to blur at `count` texels a side: albedo and normals averaged over texels, lit from a slant."""
        light = _averaged(self._albedo, count) ** self._before
        if self._normal is None:
            return np.broadcast_to(light, (count, count, _PATCHES, 3))
        mean = normalized(self._normal.mean(axis=(0, 1)))
        along = normalized(np.cross(mean, np.where(np.abs(mean[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])))
        across, slant = np.cross(mean, along), np.radians(_LIGHT_DEG)
        turned = np.cos(self._turn)[:, None] * along + np.sin(self._turn)[:, None] * across
        side = (np.cos(slant) * mean + np.sin(slant) * turned).astype(np.float32)
        normal = _averaged(self._normal, count)
        length = np.sqrt(np.einsum("yxkc,yxkc->yxk", normal, normal))
        shade = safe_div(np.einsum("yxkc,kc->yxk", normal, side), length)
        return light * (np.maximum(shade, 0) / np.cos(slant)).astype(np.float32)[..., None]

    def _maps_seen(self, count: int) -> Image:
        """What the maps show of themselves at `count` texels a side, in the middle of the patches."""
        light = self._fine_light if count == _SIDE else self._light(count)
        return self._after * self._blurred(light - self._level, self._weights)

    def _edge_seen(self, count: int) -> Image:
        """What leaves white skin about the edge of a shadow on each patch, of light of 1."""
        middle = self._weights if self._weights.ndim == 2 else self._weights[:, _SIDE // 2, _SIDE // 2]
        return self._blurred(_averaged(self._edge, count), middle)

    def _blurred(self, light: Image, weights: NDArray[np.float32]) -> Image:
        """Light (c, c, K, 1 or 3) under the window, blurred on its own lattice and read at texels of the asked size.

        Parameters
        ----------
        light : ndarray
        weights : ndarray of shape (N, 3), (N, K, 3) or (N, S, S, K, 3)
        """
        count = len(light)
        spectrum = np.fft.rfft2(light * _window(count), axes=(0, 1))
        passed = [self._passed(variance, count)[..., None] for variance in self._variance_mm2]
        if weights.ndim < 5:
            each = weights[:, None] if weights.ndim == 2 else weights
            return _magnified(spectrum * sum(lobe * weight for lobe, weight in zip(passed, each, strict=True)), count)
        seen = np.zeros(weights.shape[1:], np.float32)
        for lobe, weight in zip(passed, weights, strict=True):
            seen += weight * _magnified(spectrum * lobe, count)
        return seen

    def _passed(self, variance_mm2: float, count: int) -> NDArray[np.float32]:
        """What a discrete Gaussian (theory.md 5.6) leaves of each frequency on a lattice, (c, c / 2 + 1, K)."""
        down, across = (2 * np.pi * each(count) for each in (np.fft.fftfreq, np.fft.rfftfreq))
        rows, columns, both = variance_mm2 * (count / _SIDE) ** 2 * self._patches.spread
        power = rows * (1 - np.cos(down[:, None, None])) + columns * (1 - np.cos(across[:, None]))
        power += both * np.sin(down[:, None, None]) * np.sin(across[:, None])
        return np.exp(-power).astype(np.float32)


class _Patches(NamedTuple):
    """Squares of the texture.

    Attributes
    ----------
    tile : ndarray of shape (K,)
    place : ndarray of shape (S, S, K, 2)
        (row, column) / size of each texel.
    mm_per_texel : ndarray of shape (K,)
        Root of its area on the skin.
    spread : ndarray of shape (3, K)
        Covariance, in texels, of a round Gaussian of 1 mm^2 on the skin: along rows, along columns, and mixed.
    """

    tile: NDArray[np.int64]
    place: Float
    mm_per_texel: Float
    spread: Float


def _draw_patches(rng: np.random.Generator, spec: SceneSpec, mesh: SkinMesh) -> _Patches:
    """Patches about points of the skin, drawn evenly by area; on texels that coarser sizes share."""
    width, height = spec.texture.size
    reached = np.cumsum(mesh.face_area_mm2)
    drawn = reached[-1] * (np.arange(_PATCHES) + rng.uniform(size=_PATCHES)) / _PATCHES
    face = np.minimum(np.searchsorted(reached, drawn), len(reached) - 1)
    uv = np.einsum("kc,kcd->kd", rng.dirichlet([1.0, 1.0, 1.0], _PATCHES), mesh.corner_uv[face])
    tile = tile_of_face(mesh, spec.texture.udim)[face]
    local = np.stack([local_uv(uv[k], int(tile[k])) for k in range(_PATCHES)])
    x, y = texel_xy(local[:, 0], local[:, 1], height, width)
    row, column = (
        (np.clip((at - _SIDE / 2) // _GRID * _GRID, 0, size - _SIDE) + np.arange(_SIDE)[:, None] + 0.5) / size
        for at, size in ((y, height), (x, width))
    )
    place = np.stack(np.broadcast_arrays(row[:, None], column), axis=-1)
    along = uv_jacobian(mesh)[face] / np.array([[width], [height]])  # mm that a column and a row are apart, (K, 2, 3)
    metric = np.einsum("kax,kbx->kab", along, along)
    area = np.sqrt(np.maximum(np.linalg.det(metric), 1e-36))
    # Theory.md 5.5, of texels; v runs against the rows
    spread = np.stack([metric[:, 0, 0], metric[:, 1, 1], metric[:, 0, 1]]) / area**2
    return _Patches(tile, place, np.sqrt(area), spread)


def _straight_edges(rng: np.random.Generator) -> Image:
    """Light of 1/2 and of -1/2 on both sides of a straight edge through about the middle of a patch, (S, S, K, 1)."""
    angle, off = rng.uniform(0, 2 * np.pi, _PATCHES), rng.uniform(-_GRID / 2, _GRID / 2, _PATCHES)
    step = np.arange(_SIDE)[:, None] + 0.5 - _SIDE / 2
    distance = step[:, None] * np.sin(angle) + step * np.cos(angle) + off
    wide = np.abs(np.sin(angle)) + np.abs(np.cos(angle))  # of a texel, across the edge
    return np.clip(distance / wide, -0.5, 0.5).astype(np.float32)[..., None]


def _read(images: Tiled[NDArray[np.float32]], spec: SceneSpec, patches: _Patches, constant: Float) -> Float:
    """A map's values on the patches, as a texture of the asked size has them, (S, S, K, C)."""
    width, height = spec.texture.size
    out = np.broadcast_to(constant, (*patches.place.shape[:3], len(constant))).copy()
    for tile, image in images.items():
        mine = np.flatnonzero(patches.tile == tile)
        if not len(mine):
            continue
        image, place = shrink(image, (height, width)), patches.place[:, :, mine]
        if image.shape[:2] == (height, width):  # each is read as it is
            row, column = np.moveaxis((place * (height, width)).astype(np.int64), -1, 0)
            flat = np.clip(row, 0, height - 1) * width + np.clip(column, 0, width - 1)
            out[:, :, mine] = image.reshape(-1, out.shape[-1]).take(flat, axis=0)
        else:
            read = read_bilinear(image[None], place.reshape(-1, 2))
            out[:, :, mine] = read.reshape(*place.shape[:3], -1)
    return out


def _averaged(values: Image, count: int) -> Image:
    """Values (S, S, ...) averaged over the texels of `count` a side."""
    return shrink(values, (count, count))


def _magnified(spectrum: NDArray[np.complexfloating], count: int) -> Image:
    """The image of a spectrum, read at all texels of the patches, (S, S, K, C)."""
    image = np.fft.irfft2(spectrum, (count, count), axes=(0, 1))
    read = magnify_bilinear(np.ascontiguousarray(image.reshape(count, count, -1), np.float32), (_SIDE, _SIDE))
    return read.reshape(_SIDE, _SIDE, *image.shape[2:])


def _mean_square(values: NDArray[np.floating]) -> float:
    return float(np.mean(np.square(values), dtype=np.float64))


def _window(count: int) -> Image:
    """A square of sines in the middle of a patch, 0 at its border, (c, c, 1, 1)."""
    sines = np.sin(np.pi * (np.arange(count) + 0.5) / count).astype(np.float32) ** 2
    return (sines[:, None] * sines)[..., None, None]


def _patch_weights(gaussians: GaussianSum, maps: SkinMaps, patches: _Patches) -> NDArray[np.float32]:
    """Weights of the lobes as shares of what comes back, (N, 3), or (N, S, S, K, 3) where maps vary the skin."""
    place = patches.place[1::2, 1::2]  # they vary slower than the albedo does
    weights = SkinWeights.of(gaussians, maps).at(
        np.broadcast_to(patches.tile, place.shape[:3]).reshape(-1), place.reshape(-1, 2)
    )  # fmt: skip
    shares = (weights / gaussians.weight_rgb.sum(axis=0)).astype(np.float32)
    if shares.ndim == 2:
        return shares
    return shares.reshape(len(shares), *place.shape[:3], 3).repeat(2, axis=1).repeat(2, axis=2)
