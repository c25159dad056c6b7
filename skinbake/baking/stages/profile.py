"""Stage: the sum of Gaussians fitted to the skin's profile."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skinbake.io.code_digest import code_digest
from skinbake.io.digests import key_of
from skinbake.io.table import read_profile_csv
from skinbake.pipeline import Stage
from skinbake.profile import FitReport, GaussianSum, fit_skin

if TYPE_CHECKING:
    from skinbake.baking.inputs import BakeInputs
    from skinbake.baking.result_store import ResultStore
    from skinbake.pipeline import StageTimer

CODE = (__name__, "skinbake.io.profile")


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
        maps = inputs.key(*inputs.skin_maps) if inputs.skin_maps else None
        return key_of(code_digest(*CODE), written, inputs.digests.get("skin"), maps)

    def load(self) -> GaussianSum | None:
        """The Gaussians of profile.json."""
        return self._results.fit(self.key())

    def compute(self) -> FitReport:
        """The fit with its figures."""
        path = self._inputs.table_path
        table = read_profile_csv(path) if path else None
        return fit_skin(self._inputs.spec.skin, table, over=self._inputs.varying)

    def store(self, made: FitReport) -> GaussianSum:
        """Keep the fit, and give its Gaussians."""
        self._results.keep_fit(made, self.key())
        return made.gaussians

    def stale(self) -> str:
        """Why the skin would be fitted."""
        return "" if self.load() is not None else "to fit"
