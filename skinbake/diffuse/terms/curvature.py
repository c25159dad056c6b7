"""Round skin, edges and fins shine more than flat skin, hollows less: a factor on each lobe where light leaves.

See theory.md 9.8. What comes straight through thin parts is a lobe of its own (`transmission`), and taken off.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Tiles, coarser_atlas, coarser_size, interpolate, local_uv, tile_of_face
from skinbake.atlas.sample import bilinear, texels_around
from skinbake.atlas.texel_coordinates import texel_xy
from skinbake.bilinear import between, magnify_bilinear
from skinbake.diffuse.diffuse_map import Lobe
from skinbake.diffuse.terms.flesh_form import decay_below
from skinbake.diffuse.terms.mean_curvature import mean_curvature
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float, safe_div
from skinbake.profile import GaussianSum
from skinbake.profile.curved_skin import curved_gain, curved_share, through_curved
from skinbake.profile.effective_medium import one_layer
from skinbake.profile.layers import Layer
from skinbake.profile.medium import Medium
from skinbake.profile.skin_medium import SkinMedium
from skinbake.scene.decision import Decision
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import TextureSpec

Image = NDArray[np.float32]
SMOOTHED = 2.5  # times the length that light has come: curvature is a mean over it; best of 1.5 to 3 against walks
TEXEL_MM = 1.0  # curvature is smooth: no finer texels than these
MOST_GAIN, STEPS = 4.0, 1000  # of the table of the lobes' factors
SUMS_ERROR = 0.03  # of the decay below the face, by sums over a mesh's facets: up to that mean curvature tells it
FURTHEST_PATHS = 20.0  # free paths: further than that no diffusion length counts
NARROW = 0.01  # share of the gain that a lobe may have and be left as it is


@dataclass(frozen=True)
class CurvedSkin:
    """What curvature makes of lobes.

    Attributes
    ----------
    curvature_per_mm : Tiles
        Mean curvature by channel, (h, w, 3) a tile, of a small texture; it spreads beams.
    gain : Tiles
        What skin sends back over what a plane does, of light from everywhere, likewise.
    weight, share : ndarrays of shape (N, 3)
        Of the lobes; the latter says how they share the gain less 1.
    layer : Layer
        The medium that all this is of.
    stands_in : bool
        For several layers or wavelengths, whose profile it has.
    """

    curvature_per_mm: Tiles
    gain: Tiles
    weight: Float
    share: Float
    layer: Layer
    stands_in: bool = False

    @property
    def spreads_beams_alone(self) -> bool:
        """Whether no lobe changes by it, as of a white profile: there is nothing to it where no beam is shifted."""
        return not self.share.any()

    def through_slabs(self, thickness_mm: Float) -> Float:
        """What the gain has of light from a slab's other side, (K, 3), as a share of what a plane sends back."""
        return through_curved(self.layer.medium, self.layer.eta, _decay(self.layer.medium), thickness_mm)

    def held(self, mesh: SkinMesh, udim: bool, face: NDArray[np.int64], uv: Float) -> Image | None:
        """Light inside at places of the skin over that below a plane, (n, 3); None: as below one.

        That is the gain of mean curvature alone, as what comes through the flesh is counted where it leaves. Its square
        root: against walks through two heads the gain itself was too much, none too little. A white profile has its
        form in it, and a medium that stands for layers knows not what these let through: of three layers red was 15 %
        too bright in thin parts by it, 13 % without.

        Parameters
        ----------
        mesh : SkinMesh
        udim : bool
        face : ndarray of shape (n,)
            -1: none there.
        uv : ndarray of shape (n, 2)
        """
        if self.spreads_beams_alone or self.stands_in:
            return None
        of_face = tile_of_face(mesh, udim)
        found = np.ones((len(face), 3), np.float32)
        for tile, bend in self.curvature_per_mm.items():
            height, width = bend.shape[:2]
            gain = np.sqrt(curved_gain(self.layer.medium, self.layer.eta, bend.reshape(-1, 3).astype(np.float64)))
            pick = np.flatnonzero((face >= 0) & (of_face[face] == tile))
            local = local_uv(uv[pick], tile)
            x, y = texel_xy(local[:, 0], local[:, 1], height, width)  # curvature is smooth: its nearest texel
            row, col = np.clip(y.astype(np.int64), 0, height - 1), np.clip(x.astype(np.int64), 0, width - 1)
            found[pick] = gain[row * width + col]
        return found

    def left(self, through: Mapping[int, Image] | None) -> Tiles:
        """Gain that lobes have beside another one.

        Parameters
        ----------
        through
            As of `applied`.
        """
        return {tile: _less(image, through.get(tile) if through else None) for tile, image in self.gain.items()}

    def factors(self) -> list[Float | None]:
        """Factor of each lobe, (STEPS + 1, 3), by the gain that is left to them all; None: it is left as it is."""
        of_all = lobe_factors(self.weight, self.share)
        return [None if share.max() < NARROW else of for of, share in zip(of_all, self.share, strict=True)]

    def applied(
        self,
        lobes: Sequence[Lobe],
        through: Mapping[int, Image] | None = None,
        aside: Callable[[Lobe], Lobe] = lambda lobe: lobe,
    ) -> tuple[Lobe, ...]:
        """The lobes of the profile, each times what the skin's form makes of it.

        However smooth a lobe is, form may change within its texels: it gets as many as the gain has at least.

        Parameters
        ----------
        lobes : sequence of Lobe
        through : mapping of int to ndarray of shape (h, w, 3), optional
            What of the gain in even light another lobe has, as a share of what a plane sends back.
        aside : callable, optional
            Takes each as soon as it is made and gives it as it is read again; may take its pixels out of it.
        """
        found, gain = list[Lobe](), self.left(through)
        pixels = [tuple(map(id, lobe.rgb.values())) for lobe in lobes]
        unchanged: dict[tuple[int, ...], Lobe] = {}  # several may be the light itself
        for lobe, of, factor in zip(lobes, pixels, self.factors(), strict=True):
            if factor is None:
                if of not in unchanged:
                    unchanged[of] = aside(lobe)
                found.append(unchanged[of].figured_as(lobe))
                continue
            rgb = {}
            for tile, image in lobe.rgb.items():
                rgb[tile] = np.empty((len(image), *bent_shape(image, gain[tile]), 3), np.float32)
                for light, out in zip(image, rgb[tile], strict=True):
                    out[:] = magnify_bilinear(np.asarray(light, np.float32), out.shape[:2])
                multiply_by_gain(gain[tile], factor, rgb[tile])
            found.append(aside(replace(lobe, rgb=rgb)))
        return tuple(found)


def bent_shape(image: NDArray[np.floating], gain: Image) -> tuple[int, int]:
    """Rows and columns that a lobe (L, h, w, 3) has once it is multiplied by a gain (h, w, 3)."""
    return max(image.shape[1], gain.shape[0]), max(image.shape[2], gain.shape[1])


def _less(gain: Image, through: Image | None) -> Image:
    """Gain less what another lobe adds, at the latter's size."""
    if through is None:
        return gain
    return np.maximum(magnify_bilinear(gain, through.shape[:2]) - through, 0)


def lobe_factors(weight: Float, share: Float) -> Float:
    """Factor on each lobe, (N, STEPS + 1, 3), for gains of their sum from 0 to `MOST_GAIN`; their mean is the gain.

    What is added is shared as `share` says. What is taken off leaves no lobe below 0: by 1 / (1 + t share).

    Parameters
    ----------
    weight, share : ndarrays of shape (N, 3)
    """
    gain = np.linspace(0, MOST_GAIN, STEPS + 1)[:, None]
    part = safe_div(weight, weight.sum(axis=0))[:, None]
    more = share[:, None] > 0
    low, high = np.zeros((STEPS + 1, weight.shape[1])), np.full((STEPS + 1, weight.shape[1]), 1e6)
    for _ in range(60):  # the sum falls with t
        middle = np.sqrt((low + 1e-9) * high)
        above = (part / (1 + middle * np.where(more, share[:, None], 0))).sum(axis=0) > gain
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    less = 1 / (1 + high * share[:, None])
    return np.where(gain >= 1, 1 + share[:, None] * (gain - 1), np.where(more, less, 1.0))


def curve_skin(
    mesh: SkinMesh,
    texture: TextureSpec,
    gaussians: GaussianSum,
    medium: SkinMedium,
    switch: str,
    negligible: float,
    beams: bool = True,
) -> tuple[CurvedSkin | None, Decision]:
    """What the skin's curvature makes of the lobes, where that is worth it, and the plan's line.

    Parameters
    ----------
    mesh : SkinMesh
    texture : TextureSpec
    gaussians : GaussianSum
    medium : SkinMedium
    switch : "auto", "on" or "off"
    negligible : float
        It costs next to nothing, and is left out below this root mean square only.
    beams : bool
        Whether there may be slanted beams, which it spreads also where the profile is white.
    """
    if switch == "off":
        return None, Decision("curvature", False, "off")
    layer = one_layer(medium, gaussians)
    if isinstance(layer, str):
        return None, Decision("curvature", False, f"{switch}: {layer}")
    if gaussians.normalise == "white" and not beams:
        return None, formed_already(switch)
    # Light that leaves has come from as far as the geometric mean of a free path and the diffusion length
    path_mm, decay = layer.medium.free_path_mm, _decay(layer.medium)
    smoothed_mm = SMOOTHED * path_mm / np.sqrt(decay * path_mm)
    bend = mean_curvature(mesh, smoothed_mm)
    # A white profile has the skin's own form in it: where beams are spread, mean curvature is all that counts
    white, slower = gaussians.normalise == "white", bend
    if not white:
        slower = bend + _beyond(decay - decay_below(mesh, decay) - bend, SUMS_ERROR * decay)
    gain = curved_gain(layer.medium, layer.eta, slower)
    area, total = mesh.face_area_mm2, gaussians.weight_rgb.sum(axis=0)
    change = gain[mesh.faces].mean(axis=1) - 1
    square = (area[:, None] * (total * change) ** 2).sum() / max((total**2).sum() * area.sum(), 1e-300)
    rms = float(np.sqrt(square))
    kept = switch == "on" or rms > negligible
    why = f"{switch}: round skin sends back otherwise than flat skin by {rms:.2%} (rms)"
    line = Decision("curvature", kept, f"{why}; left out below {negligible:.2%}", 0.0 if kept else rms)
    if not kept:
        return None, line

    small = coarser_size(mesh, texture.size, TEXEL_MM)
    atlas = coarser_atlas(mesh, texture.size, texture.gutter, texture.udim, small)
    curvature, even = ({r.tile: interpolate(r, of[mesh.faces]) for r in atlas} for of in (bend, gain))
    # A white profile is what skin sends back of light from everywhere, its own form included, as albedo maps are
    share = np.zeros_like(gaussians.weight_rgb) if white else curved_share(gaussians, layer.medium, layer.eta)
    return CurvedSkin(curvature, even, gaussians.weight_rgb, share, layer, layer is not medium.layers[0]), line


def _decay(medium: Medium) -> Float:
    """Rate at which light dies away below a plane, 1/mm, where it reaches no further than counts."""
    return np.maximum(medium.sigma_tr_per_mm, 1 / (FURTHEST_PATHS * medium.free_path_mm))


def _beyond(difference: Float, error: Float) -> Float:
    """What of a difference is more than an error."""
    more: Float = np.sign(difference) * np.maximum(np.abs(difference) - error, 0)
    return more


def formed_already(switch: str) -> Decision:
    """The plan's line where curvature changes nothing: a white profile, and no light whose beams are shifted."""
    return Decision(
        "curvature", False, f"{switch}: where no beam is shifted, a white profile has the skin's own form in it"
    )


def multiply_by_gain(gain: Image, factor: Float, image: Image) -> None:
    """Multiply images in place by the factor of the gain at each texel.

    Parameters
    ----------
    gain : ndarray of shape (h, w, 3), float32
        Of any size.
    factor : ndarray of shape (STEPS + 1, 3)
        At gains from 0 to `MOST_GAIN`.
    image : ndarray of shape (L, H, W, 3), float32, changed in place
    """
    parallel_for(_multiply, image.shape[1], gain, np.ascontiguousarray(factor), image)


@kernel
def _multiply(first, stop, gain, factor, image):  # type: ignore[no-untyped-def]
    """Multiply a lobe by the factor of the gain at each texel, read bilinearly, linear between the table's nodes.

    Parameters
    ----------
    first, stop : int
        Rows.
    gain : ndarray of shape (h, w, 3)
        By channel, of any size.
    factor : ndarray of shape (n, 3)
        At gains from 0 to MOST_GAIN in even steps.
    image : ndarray of shape (L, H, W, 3), changed in place
    """
    h, w = gain.shape[:2]
    lights, height, width = image.shape[:3]
    for row in range(first, stop):
        for col in range(width):
            around = texels_around((col + 0.5) / width, 1.0 - (row + 0.5) / height, h, w)
            for c in range(3):
                times = _factor_at(factor, c, bilinear(gain, c, around))
                for light in range(lights):
                    image[light, row, col, c] *= times


@kernel(inner=True)
def _factor_at(factor: Float, c: int, gain: float) -> np.float32:
    """Factor (n, 3) of a channel at a gain, of gains from 0 to MOST_GAIN in even steps."""
    last = len(factor) - 1
    x = min(max(gain / MOST_GAIN, 0.0), 1.0) * last
    i = min(int(x), last - 1)
    return np.float32(factor[i, c] + (x - i) * (factor[i + 1, c] - factor[i, c]))


def add_by_gain(gain: Image, factor: Float, image: Image, base: Image, out: Image) -> None:
    """Write base + image times the factor of the gain at each texel.

    Parameters
    ----------
    gain, factor
        As of `multiply_by_gain`.
    image, base, out : ndarrays of shape (L, H, W, 3), float32
    """
    (rows, down), (cols, right) = (
        between(size, count) for size, count in zip(image.shape[1:3], gain.shape[:2], strict=True)
    )
    places = rows, down, cols, right
    parallel_for(_add, image.shape[1], gain, places, np.ascontiguousarray(factor), (image, base, out))


@kernel
def _add(first, stop, gain, places, factor, images):  # type: ignore[no-untyped-def]
    """`add_by_gain` of some rows, the gain read between its rows first.

    Parameters
    ----------
    first, stop : int
        Rows.
    gain : ndarray of shape (h, w, 3)
    places : tuple of four ndarrays
        Of the gain: lower rows (H,) and the share of the next, columns (W,) and the share of the next.
    factor : ndarray of shape (STEPS + 1, 3)
    images : tuple of three ndarrays of shape (L, H, W, 3)
        `image`, `base` and `out`.
    """
    (rows, down, cols, right), (image, base, out) = places, images
    lights, _, width = image.shape[:3]
    line = np.empty((gain.shape[1], 3), np.float32)
    for row in range(first, stop):
        upper, lower, share = gain[rows[row]], gain[min(rows[row] + 1, len(gain) - 1)], down[row]
        for k in range(len(line)):
            for c in range(3):
                line[k, c] = upper[k, c] + (lower[k, c] - upper[k, c]) * share
        for col in range(width):
            something = False
            for light in range(lights):
                for c in range(3):
                    out[light, row, col, c] = base[light, row, col, c]
                    something |= image[light, row, col, c] != 0
            if not something:  # as beyond the charts
                continue
            at, after = cols[col], min(cols[col] + 1, len(line) - 1)
            for c in range(3):
                times = _factor_at(factor, c, line[at, c] + (line[after, c] - line[at, c]) * right[col])
                for light in range(lights):
                    out[light, row, col, c] += image[light, row, col, c] * times
