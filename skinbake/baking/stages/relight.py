"""Stage: textures with which any sky and any sun can be shown."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from skinbake.baking.incidence_table import entered_skin
from skinbake.baking.inputs_roles import LATER, OCCLUDERS
from skinbake.baking.provenance import Provenance
from skinbake.io.code_digest import code_digest
from skinbake.io.digests import key_of
from skinbake.io.relight import stored_transfer, transfer_entry, transfer_of_entry
from skinbake.io.weight_table import table_record
from skinbake.pipeline import Stage
from skinbake.profile import GaussianSum
from skinbake.profile.skin_medium import skin_medium
from skinbake.profile.varying_skin import mean_skin
from skinbake.relight.reuse import blurred_for_reuse
from skinbake.relight.transfer import Transfer, make_transfer
from skinbake.scene.spec import SceneSpec

if TYPE_CHECKING:
    from skinbake.baking.inputs import BakeInputs
    from skinbake.baking.result_store import ResultStore
    from skinbake.baking.stages.profile import ProfileStage
    from skinbake.pipeline import StageTimer


class RelightStage(Stage[Transfer, Transfer]):
    """Lights the skin from everywhere and scatters that; stored as relight.exr and relight.json."""

    name = "relight"

    def __init__(
        self,
        inputs: BakeInputs,
        profile: ProfileStage,
        results: ResultStore,
        timer: StageTimer,
        say: Callable[[str], None],
    ) -> None:
        super().__init__(timer)
        self._inputs, self._profile, self._results, self._say = inputs, profile, results, say

    def key(self) -> str:
        """Digest of everything but the lights."""
        return self._key(self._profile.result())

    def _key(self, gaussians: GaussianSum) -> str:
        inputs, spec = self._inputs, self._spec
        assert spec.relight is not None
        medium = skin_medium(spec.skin)  # its maps are in the key by themselves
        return key_of(
            code_digest(__name__),
            [values.tolist() for values in (gaussians.variance_mm2, gaussians.weight_rgb, gaussians.energy_rgb)],
            gaussians.table and table_record(gaussians.table),
            inputs.key(*LATER, *inputs.skin_maps, OCCLUDERS),
            (medium.identity, medium.why, medium.named, spec.skin.normalise),
            spec.relight.model_dump(mode="json", exclude={"reuse"}),
            [part.model_dump(mode="json") for part in (spec.diffusion, spec.terms, spec.specular)],
            (spec.shadows, spec.texturing.exponent_before, inputs.decisions.energy_conservation.enabled),
            (spec.output.precision, spec.output.compression, spec.output.seed),
        )

    @property
    def _reused(self) -> bool:
        """Whether the look only wants its lights shown by the textures."""
        return self._inputs.spec.relight is not None and self._inputs.spec.relight.reuse

    @property
    def _spec(self) -> SceneSpec:
        """The look; all of a batch that differ in lights and tolerance want one transfer."""
        return blurred_for_reuse(self._inputs.spec) if self._reused else self._inputs.spec

    @property
    def inputs_read(self) -> dict[str, str]:
        """Digests of the files that are read for it, by role."""
        digests = self._inputs.digests
        return {
            r: d
            for r, d in digests.items()
            if r in (*LATER, *self._inputs.skin_maps, "skin") or r.startswith("occluder.")
        }

    def load(self) -> Transfer | None:
        """What the files say, without the textures' pixels; nothing for a look that needs these."""
        return None if self._reused else self._results.transfer(self.key())

    def compute(self) -> Transfer:
        """Textures, and their error on lights that they were not made for; rounded as they are stored."""
        cache = self._results.cache
        if cache is None:
            return self._made()
        found = cache.get_many({"relight": self.key()}, lambda names: {n: transfer_entry(self._made()) for n in names})
        return transfer_of_entry(found["relight"])

    def _made(self) -> Transfer:
        inputs = self._inputs
        skin = mean_skin(inputs.spec.skin, inputs.varying)
        entered = entered_skin(self._profile.result(), skin_medium(skin), inputs.spec.terms, self._say)
        made = make_transfer(
            self._spec.model_copy(update={"skin": skin}),
            inputs.decisions,
            inputs.scene(),
            entered,
            self._say,
        )
        return stored_transfer(made, inputs.spec.output.precision)

    def store(self, made: Transfer) -> Transfer:
        """Keep the textures, unless the look only wants its lights shown by them."""
        if not self._reused:
            self._results.keep_transfer(made, Provenance(self.key(), self.inputs_read))
        return made

    def stale(self) -> str:
        """Why the textures would be made: computes no fit to tell."""
        gaussians = self._profile.load()
        if gaussians is None:
            return "after the profile"
        return "" if self._results.transfer(self._key(gaussians)) is not None else "to light from everywhere"
