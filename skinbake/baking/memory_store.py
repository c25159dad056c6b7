"""Results of a bake that writes nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from skinbake.baking.kept_fit import KeptFit
from skinbake.baking.provenance import Provenance
from skinbake.diffuse import DiffuseMap
from skinbake.io.lobes import StoredLobe
from skinbake.io.spool import Spool
from skinbake.irradiance import IrradianceMap
from skinbake.profile import FitReport, GaussianSum
from skinbake.relight.transfer import Transfer


class MemoryStore:
    """A `ResultStore` in which nothing is ever found: stages hand their results on, and whoever asked keeps them."""

    cache, spool = None, Spool()

    def fit(self, key: str) -> GaussianSum | None:
        """Nothing."""
        return None

    def keep_fit(self, made: FitReport | KeptFit, key: str) -> None:
        """Write nothing."""

    def light_keys(self) -> dict[str, str]:
        """Nothing."""
        return {}

    def has_irradiance(self, key: str) -> bool:
        """Never."""
        return False

    def irradiance(self) -> tuple[IrradianceMap, ...] | None:
        """Nothing."""
        return None

    def keep_irradiance(self, maps: tuple[IrradianceMap, ...], provenance: Provenance) -> None:
        """Write nothing."""

    def lobes(self, key: str) -> DiffuseMap | None:
        """Nothing."""
        return None

    def lobe_totals(self, result: DiffuseMap) -> DiffuseMap:
        """The lobes, which have their totals."""
        return result

    def pack_lobe(self, lobe: StoredLobe, lights: tuple[str, ...]) -> None:
        """Write nothing."""

    def keep_lobes(self, result: DiffuseMap, provenance: Provenance) -> None:
        """Write nothing."""

    def transfer(self, key: str) -> Transfer | None:
        """Nothing."""
        return None

    def keep_transfer(self, transfer: Transfer, provenance: Provenance) -> None:
        """Write nothing."""

    def stale_textures(self, result: DiffuseMap) -> dict[Path, int]:
        """None: there are no files."""
        return {}

    def keep_textures(self, path: Path, coverage: NDArray[np.floating]) -> None:
        """Write nothing."""

    def has_picture(self, key: str) -> bool:
        """Never."""
        return False

    def keep_picture(self, pixels: NDArray[np.uint8], key: str) -> None:
        """Write nothing."""
