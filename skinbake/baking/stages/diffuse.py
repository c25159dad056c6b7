"""Stage: light leaving the skin, one lobe a Gaussian."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from skinbake.baking.incidence_table import entered_skin
from skinbake.baking.inputs_roles import OCCLUDERS
from skinbake.baking.provenance import Provenance
from skinbake.diffuse import DiffuseMap, Lobe
from skinbake.diffuse.aside import Aside
from skinbake.diffuse.memoize import Kind, Make
from skinbake.diffuse.scatter import Remember, scatter
from skinbake.io.code_digest import code_digest
from skinbake.io.digests import key_of
from skinbake.io.lobes import as_stored_lobe, as_stored_lobes
from skinbake.io.weight_table import table_record
from skinbake.pipeline import Stage
from skinbake.profile import GaussianSum
from skinbake.profile.entered_skin import EnteredSkin
from skinbake.profile.skin_medium import SkinMedium, skin_medium
from skinbake.profile.varying_skin import mean_skin
from skinbake.relight.reuse import decide_reuse, reused_lights
from skinbake.scene.decision import NO_DIRECTIONS
from skinbake.scene.skin import SkinSpec

if TYPE_CHECKING:
    from skinbake.baking.inputs import BakeInputs
    from skinbake.baking.result_store import ResultStore
    from skinbake.baking.stages.irradiance import GivenIrradiance, IrradianceStage
    from skinbake.baking.stages.profile import ProfileStage
    from skinbake.baking.stages.raster import RasterStage
    from skinbake.baking.stages.relight import RelightStage
    from skinbake.pipeline import StageTimer


class DiffuseStage(Stage[DiffuseMap, DiffuseMap]):
    """Blurs the light by each Gaussian and measures the error; stored as lobe_*.exr and transmission.exr.

    What is loaded has no pixels: nobody but the picture wants them, and it asks the store.
    """

    name = "diffuse"

    def __init__(
        self,
        inputs: BakeInputs,
        profile: ProfileStage,
        raster: RasterStage,
        irradiance: IrradianceStage | GivenIrradiance,
        results: ResultStore,
        timer: StageTimer,
        say: Callable[[str], None],
        transfer: RelightStage | None = None,
    ) -> None:
        super().__init__(timer)
        self._transfer = transfer  # by which the lights are shown, if that is near enough
        self._inputs, self._results, self._say = inputs, results, say
        self._profile, self._raster, self._irradiance = profile, raster, irradiance

    def key(self) -> str:
        """Digest of the Gaussians, the light, the skin and how it is diffused and written."""
        return self._key(self._profile.result())

    def _key(self, gaussians: GaussianSum) -> str:
        spec = self._inputs.spec
        return key_of(
            code_digest(__name__),
            [values.tolist() for values in (gaussians.variance_mm2, gaussians.weight_rgb, gaussians.energy_rgb)],
            gaussians.fit_error,
            gaussians.table and table_record(gaussians.table),
            self._inputs.base and self._inputs.base.identity,
            self._inputs.key(*self._inputs.skin_maps),
            self._irradiance.identity,
            self._inputs.key("mesh"),
            spec.diffusion.model_dump(mode="json"),
            spec.terms.transmission,
            self._albedo_before(),
            self._entering(gaussians),
            self._decided(),
            self._reused(),
            # The albedo's mean decides there, and casters are in the way
            (self._inputs.key("albedo", OCCLUDERS), skin_medium(spec.skin).identity)
            if spec.terms.transmission != "off"
            else None,
            (
                spec.output.precision,
                spec.packing,
                spec.output.layout,
                spec.output.lights,
                spec.output.seed,
            ),
        )

    def _reused(self) -> Any:
        """What decides whether a transfer shows the lights, and how."""
        relight = self._inputs.spec.relight
        return relight.model_dump(mode="json") if relight is not None and self._transfer is not None else None

    def _albedo_before(self) -> Any:
        """What of the albedo is in the light that is blurred."""
        before = self._inputs.spec.texturing.exponent_before
        return before, self._inputs.key("albedo") if before else None

    def _sources(self) -> Any:
        """What makes texels weigh less as sources."""
        return self._inputs.key("scatter") if "scatter" in self._inputs.skin_maps else None

    def _entering(self, gaussians: GaussianSum) -> list[Any]:
        """What terms read that change entering light, besides that light, its maps and the mesh."""
        inputs, spec = self._inputs, self._inputs.spec
        terms, total = spec.terms, (gaussians.weight_rgb.sum(axis=0).tolist(), inputs.key(*inputs.skin_maps))
        found = skin_medium(spec.skin)
        medium = found.identity, found.why, found.named
        lobes = gaussians.variance_mm2.tolist(), gaussians.weight_rgb.tolist()  # what is moved has their share
        incidence = beam = curvature = interreflection = shape = None
        if terms.incidence != "off":
            incidence = (terms.incidence, medium, spec.skin.normalise, total)
        if terms.beam != "off":
            beam = (terms.beam, medium, lobes)
        if terms.curvature != "off":
            curvature = (terms.curvature, medium, spec.skin.normalise)
        if terms.interreflection != "off":
            oil = spec.specular.model_dump(mode="json") if inputs.decisions.energy_conservation.enabled else None
            interreflection = (terms.interreflection, terms.bounces, oil, total, inputs.key("albedo", OCCLUDERS))
        if terms.diffuse_profile != "off":
            entering = getattr(spec.skin, "incidence", None)  # of the profile
            shape = (terms.diffuse_profile, medium, lobes, entering)
        return [incidence, beam, curvature, interreflection, shape]

    def _decided(self) -> list[Any]:
        """The tolerance's parts, and what the look's own decisions leave of it."""
        decisions = self._inputs.decisions
        return [decisions.budget.record(), [line.error for line in decisions.of_look]]

    def _mean_skin(self) -> SkinSpec:
        """The skin that terms of a medium see where maps vary it."""
        return mean_skin(self._inputs.spec.skin, self._inputs.varying)

    def _entered(self, gaussians: GaussianSum, skin: SkinSpec) -> EnteredSkin:
        """A skin as light enters it, as far as the directions of light are known."""
        given = self._irradiance.light_keys is None
        medium = SkinMedium(why=NO_DIRECTIONS) if given else skin_medium(skin)
        return entered_skin(gaussians, medium, self._inputs.spec.terms, self._say)

    @property
    def inputs_read(self) -> dict[str, str]:
        """Digests of the files that are read for it, by role."""
        spec, digests = self._inputs.spec, self._inputs.digests
        own = {"mesh", "skin", *self._irradiance.inputs_read}
        terms = spec.terms
        if spec.texturing.exponent_before or terms.transmission != "off" or terms.interreflection != "off":
            own.add("albedo")
        own.update(self._inputs.skin_maps)
        return {role: digest for role, digest in digests.items() if role in own}

    def result(self) -> DiffuseMap:
        """What is stored or computed; nothing where all lights come later."""
        return super().result() if self._inputs.decisions.stored_lights else DiffuseMap((), (), None)

    def load(self) -> DiffuseMap | None:
        """Lobes without pixels, with all that is known of them."""
        return self._results.lobes(self.key())

    def compute(self) -> DiffuseMap:
        """Every lobe; a light that the cache knows is not blurred again."""
        inputs = self._inputs
        gaussians, irradiance = self._profile.result(), self._irradiance.result()
        spool, base, skin = self._results.spool, inputs.base, self._mean_skin()
        line = None
        if self._transfer is not None:
            left = inputs.decisions.budget.left
            transfer, line = decide_reuse(inputs.spec, self._transfer.result, gaussians, left)
            if transfer:
                return reused_lights(inputs.spec, transfer, gaussians, inputs.scene().environments, line)

        def put_aside(lobe: Lobe) -> Lobe:
            stored = as_stored_lobe(lobe, inputs.spec.output.precision, spool)
            self._results.pack_lobe(stored, irradiance[0].lights)
            return stored

        made = scatter(
            inputs.spec.model_copy(update={"skin": skin}),
            inputs.decisions,
            inputs.scene(),
            self._raster.result(),
            irradiance,
            self._entered(gaussians, skin),
            say=self._say,
            remember=self._remember(),
            base=self._entered(base.gaussians, base.skin) if base else None,
            aside=Aside(
                put_aside,
                spool.keep,
                spool.zeros,
                spool.rest,
                spool.on_disk,
            ),
        )
        return made if line is None else replace(made, plan=(*made.plan, line))

    def _remember(self) -> Remember | None:
        """What the cache knows of lights that enter; None where there is no use for it."""
        cache = self._results.cache
        if cache is None or self._irradiance.light_keys is None or not self._inputs.decisions.separate_lights:
            return None

        def remember(kind: Kind, lights: Mapping[str, str], make: Make) -> Any:
            return cache.get_many({name: self._blur_key(light, kind) for name, light in lights.items()}, make)

        return remember

    def _blur_key(self, light: str, kind: Kind) -> str:
        """Digest of one light's lobe, or its values at probes.

        Parameters
        ----------
        light : str
            Digest of the light that enters: whatever decided on it is in there.
        kind : tuple
            How it is blurred.
        """
        spec, budget = self._inputs.spec, self._inputs.decisions.budget
        return key_of(
            code_digest(__name__),
            self._inputs.key("mesh"),
            spec.diffusion.model_dump(mode="json", exclude={"probes"}),
            budget.blur,
            self._sources(),
            light,
            kind,
        )

    def store(self, made: DiffuseMap) -> DiffuseMap:
        """Round the lobes as their files hold them, and keep them."""
        result = as_stored_lobes(made, self._inputs.spec.output.precision, self._results.spool)
        self._results.keep_lobes(result, Provenance(self.key(), self.inputs_read))
        return result

    def stale(self) -> str:
        """Why lobes would be made: computes no fit to tell."""
        gaussians = self._profile.load()
        if gaussians is None:
            return "after the profile"
        if self._results.lobes(self._key(gaussians)) is not None:
            return ""
        return "after the irradiance" if self._irradiance.stale() else "to blur"
