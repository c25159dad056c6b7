"""The size that light is traced and blurred at: as coarse as the tolerance allows.

What a coarser texture loses is detail of the maps, estimated on patches of them, and sharpness of edges of light, which
grows with the texel. Both are blurred by the lobes before they are seen.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft2, rfft2

from skinbake.atlas import Tiled, local_uv, signed_uv_area, tile_of_face
from skinbake.atlas.texel_coordinates import texel_xy
from skinbake.bilinear import magnify_bilinear, read_bilinear
from skinbake.diffuse.skin_weights import SkinWeights
from skinbake.kernels.threads import thread_count
from skinbake.numerics import Float, normalized
from skinbake.profile import GaussianSum
from skinbake.scene.decision import Decision
from skinbake.scene.maps import SkinMaps
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import SceneSpec

TIGHT = 0.01  # whoever asks for this, which is the default, or less gets the size that he asks for
SMALLEST = 512  # texels of the shorter side that are never gone below
MOST_HALVINGS = 2
SHARE = 0.9  # of the tolerance that the size may take; the rest is left to others, as a root of squares
EDGES_PER_MM = 0.012  # rms that edges of light lose a millimetre of texel; two suns on two heads: 0.009 and 0.012
_PATCHES, _SIDE = 96, 64
_LIGHT_DEG = 50.0  # from the normal: the mean of what lights a curved skin, weighed by what it brings


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


def may_be_reduced(spec: SceneSpec) -> bool:
    """Whether a look leaves room for a coarser size: what `choose_size` needs is read for no other."""
    return (
        spec.texture.reduce == "auto"
        and spec.diffusion.tolerance > TIGHT
        and min(spec.texture.size) >= 2 * SMALLEST
        and not any(side % 2 for side in spec.texture.size)
    )


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
    detail, lost, chosen = _Detail(spec, mesh, maps, gaussians), dict[int, float](), 0
    for halvings in reversed(detail.halvings):  # the coarsest that fits is taken: finer ones need no estimate
        lost[halvings] = detail.lost(halvings)
        if lost[halvings] <= SHARE * tolerance:
            chosen = halvings
            break
    size = (asked[0] >> chosen, asked[1] >> chosen)
    told = ", ".join(
        f"{asked[0] >> halvings} x {asked[1] >> halvings} loses {each:.2%}" for halvings, each in sorted(lost.items())
    )
    why = (
        f"auto: {size[0]} x {size[1]} of {asked[0]} x {asked[1]}: {told}, tolerance {tolerance:.2%}; "
        "`texture.reduce: off` keeps the size"
    )
    how = f"{size[0]} x {size[1]}" + (f" of {asked[0]} x {asked[1]}" if chosen else "")
    loss = lost.get(chosen, 0.0)
    return TextureSize(size, loss, Decision("texture_size", chosen == 0, why, loss, how))


def at_size(spec: SceneSpec, size: TextureSize) -> SceneSpec:
    """The look at another size."""
    if size.size == spec.texture.size:
        return spec
    return spec.model_copy(update={"texture": spec.texture.model_copy(update={"size": size.size, "reduce": "off"})})


def detail_lost(spec: SceneSpec, mesh: SkinMesh, maps: SkinMaps, gaussians: GaussianSum) -> list[float]:
    """Estimated share, rms, of the light leaving the skin that is lost at half the size, at a quarter, ...

    Patches of the texture are drawn by skin area. On each, albedo times the cosine of the mapped normal with slanting
    light is averaged over the larger texels, read back bilinearly, and the difference blurred by the lobes: in the
    frequency domain, where each multiplies it by a Gaussian. Where maps vary the skin, each texel shows the lobes by
    its own weights: hair keeps more of its detail than the mean skin would. Edges of light add EDGES_PER_MM times the
    texel's size.

    Parameters
    ----------
    spec : SceneSpec
    mesh : SkinMesh
    maps : SkinMaps
    gaussians : GaussianSum
    """
    detail = _Detail(spec, mesh, maps, gaussians)
    return [detail.lost(n) for n in detail.halvings]


class _Detail:
    """Light on patches of the skin, and what coarser sizes lose of it (`detail_lost`)."""

    def __init__(self, spec: SceneSpec, mesh: SkinMesh, maps: SkinMaps, gaussians: GaussianSum) -> None:
        patches = _draw_patches(spec, mesh)
        albedo, shades = _patch_light(spec, maps, patches)
        self._light = [(albedo * shade[..., None]).astype(np.float32) for shade in shades]
        self._lobes = [_transfer(variance, patches.mm_per_texel) for variance in gaussians.variance_mm2]
        self._weights = _patch_weights(gaussians, maps, patches)
        window = np.hanning(_SIDE)[:, None] * np.hanning(_SIDE)
        self._window = (window / np.sqrt(np.mean(window**2))).astype(np.float32)[..., None]  # the mean square stays
        self._texel_mm = float(np.median(patches.mm_per_texel))
        halvings = [n for n in range(1, MOST_HALVINGS + 1) if min(spec.texture.size) >> n >= SMALLEST]
        self.halvings = [n for n in halvings if all(side % (1 << n) == 0 for side in spec.texture.size)]

    def lost(self, halvings: int) -> float:
        """Rms share of the light leaving that a size halved so often does not show."""
        lost = total = 0.0
        for light in self._light:
            spectrum = rfft2((light - _coarse(light, 1 << halvings)) * self._window, axes=(1, 2))
            lost += self._seen(spectrum)
            total += float(np.mean(light**2, dtype=np.float64))
        edges = EDGES_PER_MM * self._texel_mm * (1 << halvings)
        return float(np.hypot(np.sqrt(lost / max(total, 1e-300)), edges))

    def _seen(self, spectrum: NDArray[np.complexfloating]) -> float:
        """Mean square of a difference (K, S, S / 2 + 1, 3) once the lobes have blurred it."""
        pairs = zip(self._weights, self._lobes, strict=True)
        if self._weights.ndim == 2:
            passed = sum(lobe[..., None] * weight for weight, lobe in pairs) ** 2 / _SIDE**4
            passed[:, :, 1:-1] *= 2  # the other half of the spectrum of real numbers is the same
            power = spectrum.real**2 + spectrum.imag**2
            return float(np.einsum("kyxc,kyxc->", power, passed, dtype=np.float64)) / (3 * _PATCHES)
        shape = (_SIDE, _SIDE)
        seen = sum(
            weight * irfft2(spectrum * lobe[..., None], shape, (1, 2), workers=thread_count()) for weight, lobe in pairs
        )
        return float(np.mean(np.square(seen), dtype=np.float64))


class _Patches(NamedTuple):
    """Squares of the texture: their tile, the places (row, column) / size of their texels, and millimetres a texel."""

    tile: NDArray[np.int64]
    place: Float
    mm_per_texel: Float


def _draw_patches(spec: SceneSpec, mesh: SkinMesh) -> _Patches:
    """Patches about points of the skin, drawn by area; on texels that coarser sizes share."""
    rng = np.random.default_rng([spec.output.seed, 5])
    area, width, height = mesh.face_area_mm2, *spec.texture.size
    face = rng.choice(len(area), _PATCHES, p=area / area.sum())
    uv = np.einsum("kc,kcd->kd", rng.dirichlet([1.0, 1.0, 1.0], _PATCHES), mesh.corner_uv[face])
    tile = tile_of_face(mesh)[face] if spec.texture.udim else np.full(_PATCHES, 1001)
    local = np.stack([local_uv(uv[k], int(tile[k])) for k in range(_PATCHES)])
    x, y = texel_xy(local[:, 0], local[:, 1], height, width)
    grid = 1 << MOST_HALVINGS
    first = [
        np.clip((at - _SIDE / 2) // grid * grid, 0, size - _SIDE).astype(np.int64)
        for at, size in ((y, height), (x, width))
    ]
    step = np.arange(_SIDE)
    row = (first[0][:, None] + step + 0.5) / height
    column = (first[1][:, None] + step + 0.5) / width
    place = np.stack(np.broadcast_arrays(row[:, :, None], column[:, None, :]), axis=-1)
    texels = np.abs(signed_uv_area(mesh)[face]) * width * height
    return _Patches(tile, place, np.sqrt(area[face] / np.maximum(texels, 1e-12)))


def _patch_light(spec: SceneSpec, maps: SkinMaps, patches: _Patches) -> tuple[Float, list[Float]]:
    """What of the albedo is blurred, (K, S, S, 3), and relative light on mapped normals from each side, (K, S, S)."""
    albedo = np.ones((_PATCHES, _SIDE, _SIDE, 3))
    before = spec.texturing.exponent_before
    if before and maps.albedo:
        albedo = np.maximum(_read(maps.albedo, patches, np.array(maps.albedo_rgb)), 0.0) ** before
    if not maps.normal:
        return albedo, [np.ones((_PATCHES, _SIDE, _SIDE))]
    normal = _read(maps.normal, patches, np.array([0.0, 0.0, 1.0]))
    if maps.normal_space == "tangent":
        normal[..., :2] *= maps.normal_strength
    normal = normalized(normal)
    mean = normalized(normal.mean(axis=(1, 2)))
    along = normalized(np.cross(mean, np.where(np.abs(mean[:, :1]) < 0.7, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])))
    across, slant = np.cross(mean, along), np.radians(_LIGHT_DEG)
    shades = []
    for turn in np.radians([0.0, 90.0]):  # detail of normals is about the same from the other sides
        side = np.cos(slant) * mean + np.sin(slant) * (np.cos(turn) * along + np.sin(turn) * across)
        shades.append(np.maximum(np.einsum("kyxc,kc->kyx", normal, side), 0.0) / np.cos(slant))
    return albedo, shades


def _read(images: Tiled[NDArray[np.float32]], patches: _Patches, constant: Float) -> Float:
    """A map's values on the patches, (K, S, S, C)."""
    out = np.broadcast_to(constant, (*patches.place.shape[:3], len(constant))).copy()
    for tile, image in images.items():
        mine = patches.tile == tile
        if mine.any():
            # Where the map's texels are the texture's, each is read as it is
            exact = patches.place[mine] * image.shape[:2] - 0.5
            texel = np.rint(exact).astype(np.int64)
            if np.abs(exact - texel).max() < 1e-6:
                out[mine] = image[texel[..., 0], texel[..., 1]]
                continue
            flat = read_bilinear(np.ascontiguousarray(image[None], np.float32), patches.place[mine].reshape(-1, 2))
            out[mine] = flat.reshape(out[mine].shape)
    return out


def _coarse(light: NDArray[np.float32], side: int) -> NDArray[np.float32]:
    """Light averaged over squares of texels and read back bilinearly, (K, S, S, 3)."""
    count = _SIDE // side
    means = light.reshape(_PATCHES, count, side, count, side, 3).mean(axis=(2, 4))
    # All patches side by side as the channels of one image
    read = magnify_bilinear(means.transpose(1, 2, 0, 3).reshape(count, count, -1), (_SIDE, _SIDE))
    return read.reshape(_SIDE, _SIDE, _PATCHES, 3).transpose(2, 0, 1, 3)


def _patch_weights(gaussians: GaussianSum, maps: SkinMaps, patches: _Patches) -> NDArray[np.float32]:
    """Weights of the lobes as shares of what comes back, (N, 3), or (N, K, S, S, 3) where maps vary the skin."""
    weights = SkinWeights.of(gaussians, maps).at(
        np.repeat(patches.tile, _SIDE * _SIDE), patches.place.reshape(-1, 2)
    )  # fmt: skip
    shares = (weights / gaussians.weight_rgb.sum(axis=0)).astype(np.float32)
    return shares if shares.ndim == 2 else shares.reshape(len(shares), *patches.place.shape[:3], 3)


def _transfer(variance_mm2: float, mm_per_texel: Float) -> NDArray[np.float32]:
    """What a lobe leaves of each frequency of a patch, (K, S, S / 2 + 1)."""
    squared = (2 * np.pi) ** 2 * (np.fft.fftfreq(_SIDE)[:, None] ** 2 + np.fft.rfftfreq(_SIDE) ** 2)
    texels2 = (variance_mm2 / np.maximum(mm_per_texel, 1e-9) ** 2)[:, None, None]
    return np.exp(-0.5 * texels2 * squared).astype(np.float32)
