"""What a bake would do, without doing any of it."""

from __future__ import annotations

from skinbake.bake.baking import preview_is_current
from skinbake.bake.folder import BakeFolder
from skinbake.bake.keys import preview_key


def stale_stages(stages: BakeFolder, preview: bool) -> dict[str, str]:
    """Stages that would run, and why.

    Raises
    ------
    InputError
        An input is missing.
    """
    found: dict[str, str] = {}
    if stages.force:
        found["profile"] = "forced"
    gaussians = stages.kept_fit()
    if gaussians is None and not stages.force:
        found["profile"] = "to fit"
    lights = stages.stale_lights()
    if lights is not None:
        found["irradiance"] = _lights(stages, lights)
    lobes = stages.diffuse_key(gaussians, stages.light_keys) if gaussians is not None else None
    if lobes is None:
        found["diffuse"] = "after the profile"
    elif stages.kept_lobes(lobes) is None:
        found["diffuse"] = "after the irradiance" if lights is not None else "to blur"
    if preview and (lobes is None or not preview_is_current(stages.out, _drawn(stages, lobes))):
        found["preview"] = "to draw"
    return found


def _lights(stages: BakeFolder, lights: tuple[str, ...]) -> str:
    cache = stages.cache
    ready = [name for name in lights if cache is not None and cache.path_of(stages.light_keys[name]).exists()]
    trace = [name for name in lights if name not in ready]
    parts = [f"trace {', '.join(trace)}"] if trace else []
    parts += [f"from the cache {', '.join(ready)}"] if ready else []
    return "; ".join(parts) or "to put in order"


def _drawn(stages: BakeFolder, lobes: str) -> str:
    return preview_key(stages.spec, stages.inputs, lobes)
