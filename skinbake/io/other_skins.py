"""Skins by name or file, on the lobes of a bake that is there."""

from __future__ import annotations

from pathlib import Path

from skinbake.io.bake_folder import BakeFolder
from skinbake.io.config import load_named_skin
from skinbake.io.presets import skin_names
from skinbake.io.table import read_profile_csv
from skinbake.preview.other_skin import OtherSkin, stored_variances
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.profile.refit import refit


def other_skin(baked: BakeFolder, name: str) -> OtherSkin:
    """A skin, by its name or file, on the lobes of a bake.

    Raises
    ------
    InputError, ConfigError
        There is no such skin, or its file cannot be used; told once it is fitted.
    """

    def fit() -> GaussianSum:
        # White or not is the bake's: it goes with its albedo
        skin = load_named_skin(name).model_copy(update={"normalise": baked.spec.skin.normalise})
        csv = read_profile_csv(skin.path) if skin.model == "table" else None
        return refit(skin, stored_variances(baked.scene), baked.scene.table, csv)

    return OtherSkin(Path(name).stem, fit)


def other_skins(baked: BakeFolder) -> list[OtherSkin]:
    """The skins that come with skinbake, on the lobes of a bake."""
    return [other_skin(baked, name) for name in skin_names()]
