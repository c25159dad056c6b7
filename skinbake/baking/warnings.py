"""What of a look is probably not meant, though it bakes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from skinbake.atlas.report import UvReport, uv_report
from skinbake.irradiance.light_texels import DARK
from skinbake.profile.fit import more_gaussians

if TYPE_CHECKING:
    from skinbake.baking.inputs import BakeInputs
    from skinbake.irradiance.scene_data import SceneData
    from skinbake.pipeline import Baked, Stages
    from skinbake.profile import GaussianSum
    from skinbake.scene.spec import SceneSpec

EMPTY_PICTURE = "nothing of the head is in the picture: preview.camera looks elsewhere, or stands inside of it"
NEARLY = 1.25  # texels wider than the finest detail by less lose little of it
LARGEST_TEXTURE = 16384  # that is proposed


def look_warnings(spec: SceneSpec, scene: SceneData, texel_mm: float, gaussians: GaussianSum) -> list[str]:
    """Warnings that a look has before any light is traced.

    Parameters
    ----------
    spec : SceneSpec
    scene : SceneData
        Its files.
    texel_mm : float
        Median side of a texel on the skin.
    gaussians : GaussianSum
        The fitted profile.
    """
    return [*scene.warnings, *_coarse(spec, texel_mm, gaussians), *_few_gaussians(spec, gaussians)]


def bake_warnings(
    inputs: BakeInputs, stages: Stages, baked: Baked, before: Mapping[str, Any], uv: UvReport | None
) -> list[str]:
    """Warnings of a bake; those of the last one, where nothing that they follow from has changed.

    Parameters
    ----------
    inputs : BakeInputs
    stages : Stages
        That were run.
    baked : Baked
    before : mapping
        The folder's last manifest.
    uv : UvReport, optional
        Of the look, where it was made.
    """
    dark = [f"light {line.term}: {line.why}" for line in baked.plan if line.why == DARK]
    if uv is None and stages.diffuse.reused and before.get("inputs") == inputs.digests:
        kept = [str(line) for line in before.get("warnings", ()) if line not in (*dark, EMPTY_PICTURE)]
        return [*kept, *dark]
    scene = inputs.scene()
    uv = uv or uv_report(scene.mesh, stages.raster.result())
    finer = inputs.spec.texture.size[0] / inputs.asked.texture.size[0]  # texels as they were asked for
    return [*look_warnings(inputs.asked, scene, uv.mm_per_texel[1] * finer, baked.gaussians), *dark]


def _few_gaussians(spec: SceneSpec, gaussians: GaussianSum) -> list[str]:
    """A sentence where skins that maps vary share too few Gaussians."""
    more = more_gaussians(gaussians, spec.skin.fit)
    if gaussians.table is None or not gaussians.table.names or not more:
        return []
    count, (where, error) = np.count_nonzero(gaussians.variance_mm2), gaussians.table.worst
    node = ", ".join(f"{name} {value:.3g}" for name, value in where.items())
    return [
        f"the {count} Gaussians that the skins of your maps share are off by up to {error:.1%} (at {node}); "
        f"skin.fit: {{gaussians: {more}}} comes nearer"
    ]


def _coarse(spec: SceneSpec, texel_mm: float, gaussians: GaussianSum) -> list[str]:
    """A sentence where texels lose detail that skin would show: those of two texels or more are kept.

    How fine skin shows detail is how far its light goes on average, over the channels: finer light is blurred anyway.
    """
    weight = gaussians.weight_rgb / np.maximum(gaussians.weight_rgb.sum(axis=0), 1e-12)
    finest_mm = float((gaussians.variance_mm2**0.5 @ weight).mean())
    if texel_mm <= NEARLY * finest_mm:
        return []
    width, height = spec.texture.size
    times = 2
    while 2 * texel_mm / times > finest_mm and max(width, height) * times < LARGEST_TEXTURE:
        times *= 2
    finer = str(width * times) if width == height else f"[{width * times}, {height * times}]"
    kept = "would keep it" if 2 * texel_mm / times <= finest_mm else "would lose less"
    return [
        f"your texels are {texel_mm:.2g} mm; detail below {finest_mm:.2g} mm, which this skin shows, is lost; "
        f"texture.size: {finer} {kept}"
    ]
