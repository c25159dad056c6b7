"""Round skin shines more than flat skin, hollows less: a factor on each lobe where light leaves (theory.md 9.8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Tiles, coarser_atlas, coarser_size, interpolate
from skinbake.atlas.sample import bilinear, texels_around
from skinbake.diffuse.diffuse_map import Lobe
from skinbake.diffuse.terms.mean_curvature import mean_curvature
from skinbake.kernels.compile import kernel
from skinbake.kernels.threads import parallel_for
from skinbake.numerics import Float
from skinbake.profile import GaussianSum
from skinbake.profile.curved_skin import curved_gain, curved_share
from skinbake.profile.effective_medium import one_layer
from skinbake.profile.skin_medium import SkinMedium
from skinbake.scene.decision import Decision
from skinbake.scene.mesh import SkinMesh
from skinbake.scene.spec import TextureSpec

Image = NDArray[np.float32]
SMOOTHED = 2.5  # times the length that light has come: curvature is a mean over it; best of 1.5 to 3 against walks
TEXEL_MM = 1.0  # curvature is smooth: no finer texels than these
ROUNDEST_PER_MM, STEPS = 1.0, 1000  # of the table of gains, which runs from the deepest hollow to the roundest form
FURTHEST_PATHS = 20.0  # free paths: further than that no diffusion length counts
NARROW = 0.01  # share of the gain that a lobe may have and be left as it is


@dataclass(frozen=True)
class CurvedSkin:
    """What curvature makes of lobes.

    Attributes
    ----------
    curvature_per_mm : Tiles
        Mean curvature by channel, (h, w, 3) a tile, of a small texture.
    gain : ndarray of shape (STEPS + 1, 3)
        Of curvatures from -ROUNDEST_PER_MM to ROUNDEST_PER_MM.
    share : ndarray of shape (N, 3)
        Of the gain less 1 that each lobe has.
    """

    curvature_per_mm: Tiles
    gain: Float
    share: Float

    @property
    def spreads_beams_alone(self) -> bool:
        """Whether no lobe changes by it, as of a white profile: there is nothing to it where no beam is shifted."""
        return not self.share.any()

    def applied(self, lobes: Sequence[Lobe]) -> tuple[Lobe, ...]:
        """The lobes of the profile, each times what curvature makes of it."""
        found = []
        for lobe, share in zip(lobes, self.share, strict=True):
            if share.max() < NARROW:
                found.append(lobe)
                continue
            change = share * (self.gain - 1)
            factor = np.where(change > 0, 1 + change, 1 / (1 - np.minimum(change, 0)))  # never below 0
            rgb = {tile: np.array(image, np.float32) for tile, image in lobe.rgb.items()}
            for tile, image in rgb.items():
                parallel_for(_multiply, image.shape[1], self.curvature_per_mm[tile], factor, image)
            found.append(replace(lobe, rgb=rgb))
        return tuple(found)


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
    path_mm, decay = layer.medium.free_path_mm, layer.medium.sigma_tr_per_mm
    smoothed_mm = SMOOTHED * path_mm / np.sqrt(np.maximum(decay * path_mm, 1 / FURTHEST_PATHS))
    of_vertex = mean_curvature(mesh, smoothed_mm)
    nodes = np.linspace(-ROUNDEST_PER_MM, ROUNDEST_PER_MM, STEPS + 1)
    gain = curved_gain(layer.medium, layer.eta, nodes)

    corner = of_vertex[mesh.faces]
    at_face = np.clip(corner.mean(axis=1), -ROUNDEST_PER_MM, ROUNDEST_PER_MM)
    area, total = mesh.face_area_mm2, gaussians.weight_rgb.sum(axis=0)
    change = np.stack([np.interp(at_face[:, c], nodes, gain[:, c]) for c in range(3)], axis=1) - 1
    square = (area[:, None] * (total * change) ** 2).sum() / max((total**2).sum() * area.sum(), 1e-300)
    rms = float(np.sqrt(square))
    kept = switch == "on" or rms > negligible
    why = f"{switch}: round skin sends back otherwise than flat skin by {rms:.2%} (rms)"
    line = Decision("curvature", kept, f"{why}; left out below {negligible:.2%}", 0.0 if kept else rms)
    if not kept:
        return None, line

    small = coarser_size(mesh, texture.size, TEXEL_MM)
    atlas = coarser_atlas(mesh, texture.size, texture.gutter, texture.udim, small)
    tiles = {raster.tile: interpolate(raster, corner) for raster in atlas}
    # A white profile is what skin sends back of light from everywhere, its own form included, as albedo maps are
    white = gaussians.normalise == "white"
    share = np.zeros_like(gaussians.weight_rgb) if white else curved_share(gaussians, layer.medium, layer.eta)
    return CurvedSkin(tiles, gain, share), line


def formed_already(switch: str) -> Decision:
    """The plan's line where curvature changes nothing: a white profile, and no light whose beams are shifted."""
    return Decision("curvature", False, f"{switch}: a white profile has the skin's own form in it")


@kernel
def _multiply(first, stop, curvature, factor, image):  # type: ignore[no-untyped-def]
    """Multiply a lobe by the factor of the curvature at each texel, read bilinearly, linear between the table's nodes.

    Parameters
    ----------
    first, stop : int
        Rows.
    curvature : ndarray of shape (h, w, 3)
        1/mm, by channel, of any size.
    factor : ndarray of shape (n, 3)
        At curvatures from -ROUNDEST_PER_MM to ROUNDEST_PER_MM in even steps.
    image : ndarray of shape (L, H, W, 3), changed in place
    """
    h, w = curvature.shape[:2]
    lights, height, width = image.shape[:3]
    last = len(factor) - 1
    for row in range(first, stop):
        for col in range(width):
            around = texels_around((col + 0.5) / width, 1.0 - (row + 0.5) / height, h, w)
            for c in range(3):
                bend = bilinear(curvature, c, around) / ROUNDEST_PER_MM
                x = min(max((bend + 1.0) / 2.0, 0.0), 1.0) * last
                i = min(int(x), last - 1)
                t = x - i
                times = np.float32(factor[i, c] + t * (factor[i + 1, c] - factor[i, c]))
                for light in range(lights):
                    image[light, row, col, c] *= times
