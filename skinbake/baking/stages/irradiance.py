"""Stage: light arriving at each texel, each light on its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from skinbake.atlas import Atlas
from skinbake.baking.inputs_roles import OCCLUDERS, OILY, SHAPING
from skinbake.baking.provenance import Provenance
from skinbake.io.code_digest import code_digest
from skinbake.io.digests import key_of
from skinbake.io.irradiance import plan_of_text, plan_text
from skinbake.irradiance import IrradianceMap
from skinbake.irradiance.light_skin import light_skin
from skinbake.numerics import Zeros, stacked
from skinbake.pipeline import Stage
from skinbake.profile import GaussianSum
from skinbake.stored_precision import as_stored

if TYPE_CHECKING:
    from skinbake.baking.inputs import BakeInputs
    from skinbake.baking.result_store import ResultStore
    from skinbake.baking.session import BakeSession
    from skinbake.baking.stages.profile import ProfileStage
    from skinbake.baking.stages.raster import RasterStage
    from skinbake.pipeline import StageTimer

Maps = tuple[IrradianceMap, ...]
Arrays = dict[str, NDArray[Any]]


class IrradianceStage(Stage[Maps, Maps]):
    """Lights the skin; stored as irradiance.exr. A light is traced where neither the store nor the cache has it."""

    name = "irradiance"

    def __init__(
        self,
        inputs: BakeInputs,
        profile: ProfileStage,
        raster: RasterStage,
        results: ResultStore,
        session: BakeSession,
        timer: StageTimer,
        say: Callable[[str], None],
    ) -> None:
        super().__init__(timer)
        self._inputs, self._raster, self._results, self._session = inputs, raster, results, session
        self._profile, self._say = profile, say

    @cached_property
    def light_keys(self) -> dict[str, str]:
        """Key of each light's irradiance, in the order of the look."""
        return {light.name: self._light_key(light.name) for light in self._inputs.spec.lights}

    @property
    def identity(self) -> list[Any]:
        """What tells this light from other light: each light's name and key."""
        return list(self.light_keys.items())

    @cached_property
    def inputs_read(self) -> dict[str, str]:
        """Digests of the files that are read for it, by role."""
        digests, oil = self._inputs.digests, self._inputs.decisions.energy_conservation.enabled
        roles = {*SHAPING, *(OILY if oil else ()), *(f"light.{name}" for name in self.light_keys)}
        return {role: digest for role, digest in digests.items() if role in roles or role.startswith("occluder.")}

    def _light_key(self, name: str) -> str:
        inputs, spec = self._inputs, self._inputs.spec
        light = spec.light(name)
        # By which skies and rectangles are planned, and what smooths the noise of a rectangle's rays
        tolerance = inputs.decisions.budget.sky_directions if light.type in ("environment", "rectangle") else None
        skin = self._gaussians if light.type == "rectangle" else None
        smoothing = skin and (skin.variance_mm2.tolist(), skin.weight_rgb.tolist())
        oil = None
        if inputs.decisions.energy_conservation.enabled:
            oil = (spec.specular.model_dump(mode="json"), inputs.key(*OILY))
        return key_of(
            code_digest(__name__),
            inputs.key(*SHAPING, OCCLUDERS),
            (inputs.key(f"light.{name}"), tolerance, spec.shadows, spec.output.seed, spec.output.precision),
            oil,
            smoothing,
        )

    @cached_property
    def _gaussians(self) -> GaussianSum:
        """The skin's that lights are made for: of the base, whose blurs are taken, where there is one."""
        inputs = self._inputs
        return inputs.base.gaussians if inputs.base else self._profile.load() or inputs.gaussians()

    def key(self) -> str:
        """Digest of all lights in their order, of how the file is packed, and of whose UVs it is on."""
        spec = self._inputs.spec
        return key_of(self.identity, self.inputs_read, spec.packing, spec.output.layout, spec.texture.unwrap)

    def load(self) -> Maps | None:
        """What irradiance.exr holds."""
        return self._results.irradiance() if self._results.has_irradiance(self.key()) else None

    def compute(self) -> Maps:
        """Each light from the store, the cache, or traced.

        Rounded as the file will hold them: a bake taken up from files or from the cache must not differ from one made
        in one go.
        """
        inputs, spec, spool = self._inputs, self._inputs.spec, self._results.spool
        missing = self.missing_lights()
        stored = self._results.irradiance() if len(missing) < len(self.light_keys) else ()
        if stored is None:  # damaged: as good as missing
            missing, stored = tuple(self.light_keys), ()
        atlas, traced = self._raster.result(), list[Maps]()

        def trace(names: tuple[str, ...]) -> dict[str, Arrays]:
            def rounded(image: NDArray[np.float32]) -> NDArray[np.floating]:
                return as_stored(image, spec.output.precision)

            rectangles = any(light.type == "rectangle" and light.name in names for light in spec.lights)
            skin = self._gaussians if rectangles else None
            scene, zeros = inputs.scene(), spool.zeros
            made = light_skin(spec, inputs.decisions, scene, atlas, names, rounded, self._say, zeros, skin)
            self._session.traced += names
            traced.append(made)
            return _by_light(made)

        cache = self._results.cache
        if cache is not None:
            found = cache.get_many({name: self.light_keys[name] for name in missing}, trace)
        else:
            found = trace(missing) if missing else {}
        names = tuple(self.light_keys)
        whole = next((made for made in traced if made[0].lights == names), ())
        return _merged(names, found, stored, atlas, spool.zeros, whole)

    def store(self, made: Maps) -> Maps:
        """Keep the irradiance; computed values are rounded already."""
        keep = self._results.spool.keep
        made = tuple(replace(tile, rgb=keep(tile.rgb), visibility=keep(tile.visibility)) for tile in made)
        self._results.keep_irradiance(made, Provenance(self.key(), self.inputs_read, self.light_keys))
        return made

    def missing_lights(self) -> tuple[str, ...]:
        """Lights that the store has not as they are now."""
        stored = self._results.light_keys()
        return tuple(name for name, key in self.light_keys.items() if stored.get(name) != key)

    def stale(self) -> str:
        """Which lights would be traced, and which come from the cache."""
        if self._results.has_irradiance(self.key()):
            return ""
        cache, missing = self._results.cache, self.missing_lights()
        ready = [name for name in missing if cache is not None and cache.path_of(self.light_keys[name]).exists()]
        trace = [name for name in missing if name not in ready]
        parts = [f"trace {', '.join(trace)}"] if trace else []
        parts += [f"from the cache {', '.join(ready)}"] if ready else []
        return "; ".join(parts) or "to put in order"


def _by_light(maps: Maps) -> dict[str, Arrays]:
    """Each light's irradiance, visibility and plan, as the cache holds them."""
    entries: dict[str, Arrays] = {name: {} for name in maps[0].lights}
    for tile in maps:
        for i, name in enumerate(tile.lights):
            entries[name][f"{tile.tile}.rgb"] = tile.rgb[i]
            entries[name][f"{tile.tile}.visibility"] = tile.visibility[i]
            if name in tile.plan:
                entries[name]["plan"] = np.frombuffer(plan_text(tile.plan[name]).encode(), np.uint8)
    return entries


def _merged(
    names: tuple[str, ...],
    found: Mapping[str, Arrays],
    stored: Sequence[IrradianceMap],
    atlas: Atlas,
    zeros: Zeros,
    whole: Maps = (),
) -> Maps:
    """Lights in the order of `names`: from `found` where it has them, else from what was `stored`.

    Parameters
    ----------
    names : tuple of str
    found : mapping of light name to arrays
        As `_by_light` gives them.
    stored : sequence of IrradianceMap
    atlas : Atlas
    zeros : callable
        Makes the images.
    whole : tuple of IrradianceMap
        Where all lights of `found` were traced together: their images are taken as they are.
    """
    tiles = []
    plan = {name: lines for tile in stored[:1] for name, lines in tile.plan.items() if name in names}
    for name, entry in found.items():
        plan.pop(name, None)
        if "plan" in entry:
            plan[name] = plan_of_text(entry["plan"].tobytes().decode())
    for k, raster in enumerate(atlas):
        if whole:
            traced = whole[k]
            tiles.append(IrradianceMap(raster.tile, names, traced.rgb, traced.visibility, raster.coverage, plan))
            continue
        rgb, visibility = [], []
        for name in names:
            if name in found:
                rgb.append(found[name][f"{raster.tile}.rgb"])
                visibility.append(found[name][f"{raster.tile}.visibility"])
            else:
                j = stored[k].lights.index(name)
                rgb.append(stored[k].rgb[j])
                visibility.append(stored[k].visibility[j])
        images = stacked(rgb, zeros), stacked(visibility, zeros)
        tiles.append(IrradianceMap(raster.tile, names, *images, raster.coverage, plan))
    return tuple(tiles)


class GivenIrradiance(Stage[Maps, Maps]):
    """Irradiance that somebody else has made, in place of a look's lights.

    Parameters
    ----------
    maps : tuple of IrradianceMap
    digests : sequence of str
        Of its files.
    """

    name = "irradiance"
    light_keys: Mapping[str, str] | None = None  # one file for all: a light has no key of its own

    def __init__(self, maps: Maps, digests: Sequence[str], inputs: BakeInputs, timer: StageTimer) -> None:
        super().__init__(timer)
        self.identity = list(digests)
        self.inputs_read = {role: digest for role, digest in inputs.digests.items() if role == "mesh"}
        self._result, self.reused = maps, True

    def key(self) -> str:
        """Digest of the files."""
        return key_of(self.identity)

    def load(self) -> Maps | None:
        """What was given."""
        return self._result

    def compute(self) -> Maps:
        """Never asked for: what was given is there.

        Raises
        ------
        NotImplementedError
        """
        raise NotImplementedError

    def store(self, made: Maps) -> Maps:
        """Nothing is kept: the files are somebody else's."""
        return made

    def stale(self) -> str:
        """Never."""
        return ""
