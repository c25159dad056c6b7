"""Light at the points at which every setting is judged: exact, and as stored lobes give it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinbake.numerics import Float
from skinbake.scene.spec import SceneSpec

if TYPE_CHECKING:
    from skinbake.diffuse.probes import Probes
    from skinbake.diffuse.skin_geometry import SkinGeometry


@dataclass(frozen=True)
class Probed:
    """Points of the skin at which every setting is judged.

    Attributes
    ----------
    place : ndarray of shape (P, 2)
        (row, column) / size within the tile.
    tile : ndarray of shape (P,)
        UDIM number.
    position_mm, normal : ndarray of shape (P, 3)
    texture_mm2 : ndarray of shape (P,)
        Skin area that a whole tile would span at the scale found there: times 1 / texels, that of one texel.
    """

    place: Float
    tile: NDArray[np.int32]
    position_mm: Float
    normal: NDArray[np.float32]
    texture_mm2: NDArray[np.float32]

    @classmethod
    def of(cls, measured: dict[str, Any]) -> Probed:
        """The points of a reference, which has their fields among its own."""
        return cls(*(measured[field.name] for field in fields(cls)))


def drawn_points(spec: SceneSpec, count: int) -> Probed:
    """Points drawn as a bake of this look draws those that it verifies itself with; no light is traced.

    Parameters
    ----------
    spec : SceneSpec
    count : int
        How many.
    """
    from skinbake.atlas.look_atlas import look_atlas
    from skinbake.diffuse.draw_probes import draw_probes
    from skinbake.diffuse.skin_geometry import SkinGeometry
    from skinbake.io.scene_files import read_scene

    mesh = read_scene(spec).mesh
    geometry = SkinGeometry(look_atlas(spec.texture, mesh), mesh)
    return _probed(geometry, draw_probes(geometry, count, spec.output.seed))


def _probed(geometry: SkinGeometry, probes: Probes) -> Probed:
    """Where probes are, in the mesh's millimetres, for textures of any size."""
    own = probes.position + geometry.centre_mm
    return Probed(probes.place, probes.tile, own, probes.normal, probes.texel_mm2 * np.prod(geometry.size))


def exact_values(spec: SceneSpec, count: int, at: Probed | None = None) -> tuple[Float, Probed]:
    """Diffuse light by the surface integral of the look's Gaussians, (P, 3), summed over lights, and the probes.

    Parameters
    ----------
    spec : SceneSpec
    count : int
        Probes to draw as a bake of this look draws those it verifies itself with.
    at : Probed, optional
        Probes of another texture size instead.
    """
    from skinbake.atlas.look_atlas import look_atlas
    from skinbake.baking.incidence_table import entered_skin
    from skinbake.diffuse.draw_probes import draw_probes
    from skinbake.diffuse.light_entering import light_entering
    from skinbake.diffuse.memoize import Memoizer
    from skinbake.diffuse.methods import REFERENCE, LobeParameters
    from skinbake.diffuse.probes import Probes, read_at_probes
    from skinbake.diffuse.resources import LobeResources
    from skinbake.diffuse.skin_geometry import SkinGeometry
    from skinbake.diffuse.skin_weights import SkinWeights
    from skinbake.io.scene_files import read_scene
    from skinbake.io.table import read_profile_csv
    from skinbake.irradiance.decide import decide
    from skinbake.irradiance.light_skin import light_skin
    from skinbake.profile import fit_skin
    from skinbake.profile.skin_medium import skin_medium
    from skinbake.profile.varying_skin import mean_skin, ranges_of
    from skinbake.scene.decision import TOTAL_LIGHT

    scene = read_scene(spec)
    path = getattr(spec.skin, "path", None)
    atlas = look_atlas(spec.texture, scene.mesh)
    over = ranges_of(scene.maps, spec.skin, [raster.tile for raster in atlas])
    gaussians = fit_skin(spec.skin, read_profile_csv(path) if path else None, over=over).gaussians
    decisions, entered = decide(spec), entered_skin(gaussians, skin_medium(mean_skin(spec.skin, over)), spec.terms)
    irradiance = light_skin(spec, decisions, scene, atlas, gaussians=gaussians)
    entering = light_entering(spec, decisions, scene, atlas, irradiance, entered)
    source, of_wide, of_everywhere = (
        {tile: rgb.sum(axis=0, keepdims=True, dtype=np.float32) for tile, rgb in light.rgb.items()} if light else {}
        for light in (entering, entering.beam, entering.everywhere)
    )
    wide_mm2 = entering.beam.narrowest_mm2 if entering.beam else np.inf
    everywhere = entering.everywhere and entering.everywhere._replace(rgb=of_everywhere)
    del irradiance, entering
    geometry = SkinGeometry(atlas, scene.mesh)
    skin_weights = SkinWeights.of(gaussians, scene.maps)
    share = skin_weights.scattering_share(atlas)
    resources, resources_of_wide = (
        LobeResources(light, geometry, spec.diffusion, share) if light else None for light in (source, of_wide)
    )
    assert resources is not None
    memoizer = Memoizer(resources, (TOTAL_LIGHT,), None, resources_of_wide, wide_mm2, everywhere)
    if at is None:
        probes = draw_probes(geometry, count, spec.output.seed)
        at = _probed(geometry, probes)
    else:
        probes = Probes(
            at.tile,
            np.zeros(len(at.tile), np.int64),
            at.place,
            (at.position_mm - geometry.centre_mm).astype(np.float32),
            at.normal,
            (at.texture_mm2 / np.prod(geometry.size)).astype(np.float32),
        )
    total = np.zeros((len(probes), 3))
    weights = skin_weights.at_probes(probes)
    for variance, weight in zip(gaussians.variance_mm2, weights, strict=True):
        lobe = LobeParameters(float(variance))
        blurred = memoizer.of_lobe(float(variance))
        # Probes of another size have no texel of their own to read where there is no blur
        read = REFERENCE.at_probes(blurred, lobe, probes) if variance > 0 else read_at_probes(source, probes)
        total += weight * read
    return total * _albedo_after(spec, scene.maps.albedo, scene.maps.albedo_rgb, at), at


def stored_values(folder: Path, at: Probed, through_only: bool = False) -> Float:
    """Diffuse light at probes as a reader of the files sees it, (P, 3), summed over lights.

    Parameters
    ----------
    folder : Path
        Of a bake.
    at : Probed
    through_only : bool
        Only what comes through thin parts.
    """
    from skinbake.bilinear import read_bilinear
    from skinbake.diffuse.skin_weights import SkinWeights
    from skinbake.io.bake_folder import read_bake_folder

    baked = read_bake_folder(folder, summed=True)
    scene = baked.scene
    total = np.zeros((len(at.tile), 3))
    weights = SkinWeights(np.array([lobe.weight_rgb for lobe in scene.lobes]), scene.table, scene.maps)
    for lobe, weight in zip(scene.lobes, weights.at(at.tile, at.place), strict=True):
        if through_only and lobe.variance_mm2 is not None:
            continue
        for tile, stored in lobe.rgb.items():
            mine = at.tile == tile
            image = np.asarray(stored, np.float32)
            values = read_bilinear(image, at.place[mine]).reshape(np.count_nonzero(mine), len(image), 3)
            total[mine] += np.broadcast_to(weight, total.shape)[mine] * values.sum(axis=1)
    return total * _albedo_after(baked.spec, scene.maps.albedo, scene.maps.albedo_rgb, at)


def _albedo_after(spec: SceneSpec, albedo: Any, constant: tuple[float, float, float], at: Probed) -> Float:
    """albedo^(1 - x) at the probes, 1 where all of it went in before the blur."""
    from skinbake.bilinear import read_bilinear

    exponent = 1 - spec.texturing.exponent_before
    if exponent == 0:
        return np.ones((1, 3))
    values = np.broadcast_to(np.asarray(constant, np.float64), (len(at.tile), 3)).copy()
    for tile, image in albedo.items():
        mine = at.tile == tile
        values[mine] = read_bilinear(np.asarray(image, np.float32)[None], at.place[mine])
    return np.maximum(values, 0) ** exponent
