"""What skin sends on to skin, added light by light where that is worth it (theory.md 9.7)."""

from __future__ import annotations

from dataclasses import replace
from math import hypot

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas
from skinbake.diffuse.terms.bounced_light import (
    SkinLight,
    add_at_full_size,
    bounced_light,
    fitted,
    lights_at_once,
)
from skinbake.diffuse.terms.interreflection import decide_interreflection, receivers
from skinbake.diffuse.terms.skin_hits import TexturedSkin
from skinbake.diffuse.terms.skin_view import SkinView, look_around
from skinbake.irradiance.scene_data import SceneData
from skinbake.scene.decision import Decision
from skinbake.scene.spec import SceneSpec

Image = NDArray[np.float32]


def add_bounces(
    spec: SceneSpec,
    scene: SceneData,
    atlas: Atlas,
    names: tuple[str, ...],
    light: dict[int, Image],
    reflected: list[Image],
    gain: dict[str, Image],
    limits: list[float],
    view: SkinView | None,
) -> tuple[list[Decision], SkinLight | None]:
    """Add to each light what skin sends on to skin, where that is worth it; the plan's lines, and how that was done.

    Parameters
    ----------
    spec : SceneSpec
    scene : SceneData
    atlas : Atlas
    names : tuple of L str
    light : dict of int to ndarray of shape (L, H, W, 3), changed in place
        Irradiance, by tile.
    reflected : list of ndarray of shape (H, W, 3) or (1, 1, 3)
        What of it leaves as M, by tile.
    gain : dict of str to ndarray of shape (3,)
        By light, what of light from skin counts where it enters.
    limits : list of L float
        What may be left out of each light.
    view : SkinView, optional
        Where it was looked around already.
    """
    terms, texture = spec.terms, spec.texture
    if terms.interreflection == "off":  # nothing that rays meet is made
        return [Decision("interreflection", False, "off")], None
    skin = TexturedSkin(scene.mesh, scene.occluder, texture.size, texture.udim)
    mean_gain = np.mean(list(gain.values()), axis=0)
    lines, bounced = decide_interreflection(
        skin, names, list(light.values()), reflected, atlas, terms.interreflection, limits, mean_gain
    )
    if not any(line.enabled for line in lines):
        return lines, None
    kept = [i for i, line in enumerate(lines) if line.enabled]
    taken = receivers([bounced[i] for i in kept], [limits[i] for i in kept], atlas)
    view = view or look_around(skin, texture.gutter, taken.width_mm, taken.rays, taken.with_neighbours)
    seen = [fitted(colour, raster.shape) for colour, raster in zip(reflected, view.atlas, strict=True)]
    bounces, wrong, at_once = dict[str, tuple[int, float]](), dict[str, float](), lights_at_once(view, atlas[0].shape)
    for some in (kept[k : k + at_once] for k in range(0, len(kept), at_once)):
        side_by_side = slice(some[0], some[-1] + 1) if some[-1] - some[0] == len(some) - 1 else some
        sent = [rgb[side_by_side] for rgb in light.values()]
        most, enough = zip(*(terms.bounces_for(limits[i], bounced[i].rms) for i in some), strict=True)
        counts = np.stack([gain[names[i]] for i in some])
        found = bounced_light(view, sent, seen, most, enough, counts, colour=reflected)
        for k, i in enumerate(some):
            times, rms = int(found.bounces[k]), bounced[i].rms
            of_rays = taken.error(bounced[i], found.noise[k] * rms)
            bounces[names[i]], wrong[names[i]] = (most[k], enough[k]), min(of_rays / max(rms, 1e-30), 1.0)
            lines[i] = replace(
                lines[i],
                error=hypot(of_rays, found.left[k] * rms),
                how="1 bounce" if times == 1 else f"{times} bounces",
            )
            for raster, small in zip(atlas, found.tiles, strict=True):
                add_at_full_size(gain[names[i]] * small[k], raster, light[raster.tile][i])
    return lines, SkinLight(view, seen, {name: gain[name] for name in bounces}, bounces, wrong)
