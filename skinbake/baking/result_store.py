"""Where results of stages are kept: what a bake folder and memory have in common."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:  # stages import this, and their code keys must not hang on what stores are made of
    import numpy as np
    from numpy.typing import NDArray

    from skinbake.baking.kept_fit import KeptFit
    from skinbake.baking.provenance import Provenance
    from skinbake.diffuse import DiffuseMap
    from skinbake.io.cache import Cache
    from skinbake.io.lobes import StoredLobe
    from skinbake.io.spool import Spool
    from skinbake.irradiance import IrradianceMap
    from skinbake.profile import FitReport, GaussianSum
    from skinbake.relight.transfer import Transfer


class ResultStore(Protocol):
    """Results by the key of what they depend on. Reading gives None, or nothing, where there is none of that key."""

    @property
    def spool(self) -> Spool:
        """Where results stand until they are written."""

    @property
    def cache(self) -> Cache | None:
        """Results that looks share, by key."""

    def fit(self, key: str) -> GaussianSum | None:
        """The fitted profile."""

    def keep_fit(self, made: FitReport | KeptFit, key: str) -> None:
        """Keep a fit with its figures and its plot."""

    def light_keys(self) -> dict[str, str]:
        """Key of each light whose irradiance is there, in every tile."""

    def has_irradiance(self, key: str) -> bool:
        """Whether the irradiance of every light is there, under the key of them all."""

    def irradiance(self) -> tuple[IrradianceMap, ...] | None:
        """The irradiance that is there, one map a tile; None where it is damaged."""

    def keep_irradiance(self, maps: tuple[IrradianceMap, ...], provenance: Provenance) -> None:
        """Keep irradiance under the key of all lights, each light under its own."""

    def lobes(self, key: str) -> DiffuseMap | None:
        """Lobes with all figures, the error and the plan, but without pixels."""

    def lobe_totals(self, result: DiffuseMap) -> DiffuseMap:
        """Lobes that `lobes` gave, each with the sum over its lights."""

    def pack_lobe(self, lobe: StoredLobe, lights: tuple[str, ...]) -> None:
        """Begin with a lobe of these lights that `keep_lobes` will be given later, as likely as not."""

    def keep_lobes(self, result: DiffuseMap, provenance: Provenance) -> None:
        """Keep lobes that are rounded as they are stored."""

    def transfer(self, key: str) -> Transfer | None:
        """Textures for any light, with all figures but without pixels."""

    def keep_transfer(self, transfer: Transfer, provenance: Provenance) -> None:
        """Keep textures for any light, which are rounded as they are stored."""

    def stale_textures(self, result: DiffuseMap) -> dict[Path, int]:
        """Files whose .tx for renderers are missing or of another bake, and the tile of each."""

    def keep_textures(self, path: Path, coverage: NDArray[np.floating]) -> None:
        """Make the .tx of a file; `coverage` is that of its tile."""

    def has_picture(self, key: str) -> bool:
        """Whether the picture of the bake is there."""

    def keep_picture(self, pixels: NDArray[np.uint8], key: str) -> None:
        """Keep the picture."""
