"""Stage: the sum of Gaussians fitted to the skin's profile."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skinbake.baking.kept_fit import KeptFit, fit_key, kept_fit
from skinbake.pipeline import Stage
from skinbake.profile import FitReport, GaussianSum

if TYPE_CHECKING:
    from skinbake.baking.inputs import BakeInputs
    from skinbake.baking.result_store import ResultStore
    from skinbake.pipeline import StageTimer


class ProfileStage(Stage[FitReport | KeptFit, GaussianSum]):
    """Fits the skin; stored as profile.json, .csv and .png."""

    name = "profile"

    def __init__(self, inputs: BakeInputs, results: ResultStore, timer: StageTimer) -> None:
        super().__init__(timer)
        self._inputs, self._results = inputs, results

    def key(self) -> str:
        """As `fit_key`."""
        return fit_key(self._inputs)

    def load(self) -> GaussianSum | None:
        """The Gaussians of profile.json."""
        return self._results.fit(self.key())

    def compute(self) -> FitReport | KeptFit:
        """The fit with its figures: one that any folder's bake has made before, else made now."""
        return kept_fit(self.key()) or self._inputs.fit

    def store(self, made: FitReport | KeptFit) -> GaussianSum:
        """Keep the fit, and give its Gaussians."""
        self._results.keep_fit(made, self.key())
        return made.gaussians

    def stale(self) -> str:
        """Why the skin would be fitted."""
        return "" if self.load() is not None else "to fit"
