"""Stage: the sum of Gaussians fitted to the skin's profile."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skinbake.io.code_digest import code_digest
from skinbake.io.digests import key_of
from skinbake.pipeline import Stage
from skinbake.profile import FitReport, GaussianSum

if TYPE_CHECKING:
    from skinbake.baking.inputs import BakeInputs
    from skinbake.baking.result_store import ResultStore
    from skinbake.pipeline import StageTimer

CODE = (__name__, "skinbake.io.profile", "skinbake.io.table", "skinbake.profile")


class ProfileStage(Stage[FitReport, GaussianSum]):
    """Fits the skin; stored as profile.json, .csv and .png."""

    name = "profile"

    def __init__(self, inputs: BakeInputs, results: ResultStore, timer: StageTimer) -> None:
        super().__init__(timer)
        self._inputs, self._results = inputs, results

    def key(self) -> str:
        """Digest of the skin's keys, its table and the maps that vary it; given Gaussians are fitted again only where
        `fit` is written.
        """
        inputs, skin = self._inputs, self._inputs.spec.skin
        written = (skin.model_dump(mode="json", exclude={"path", "medium"}), "fit" in skin.model_fields_set)
        # Ranges of maps are over the mesh's tiles, and over its own layout where one is made
        laid_out = inputs.spec.texture.udim or inputs.spec.texture.unwrap != "none"
        roles = (*inputs.skin_maps, *(("mesh",) if laid_out else ()))
        maps = inputs.key(*roles) if inputs.skin_maps else None
        onto = inputs.base.gaussians.variance_mm2.tolist() if inputs.base else None
        return key_of(code_digest(*CODE), written, inputs.digests.get("skin"), maps, onto)

    def load(self) -> GaussianSum | None:
        """The Gaussians of profile.json."""
        return self._results.fit(self.key())

    def compute(self) -> FitReport:
        """The fit with its figures."""
        return self._inputs.fit

    def store(self, made: FitReport) -> GaussianSum:
        """Keep the fit, and give its Gaussians."""
        self._results.keep_fit(made, self.key())
        return made.gaussians

    def stale(self) -> str:
        """Why the skin would be fitted."""
        return "" if self.load() is not None else "to fit"
