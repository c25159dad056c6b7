"""Fits of skins that were made before, with their plots, in the user's cache: a look is fitted once."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skinbake.io.code_digest import code_digest
from skinbake.io.digests import key_of
from skinbake.io.output_names import FIT_FILES
from skinbake.io.profile import gaussians_of_text
from skinbake.io.user_cache import user_cache
from skinbake.profile import GaussianSum

if TYPE_CHECKING:
    from skinbake.baking.inputs import BakeInputs

CODE = ("skinbake.baking.stages.profile", "skinbake.io.profile", "skinbake.io.table", "skinbake.profile")
PLOT_CODE = "skinbake.io.profile_plot"


class KeptFit(NamedTuple):
    """A fit as it was written.

    Attributes
    ----------
    gaussians : GaussianSum
    files : dict of str to bytes
        Contents of profile.json, .csv and .png, by name.
    """

    gaussians: GaussianSum
    files: dict[str, bytes]


def fit_key(inputs: BakeInputs) -> str:
    """Digest of the skin's keys, its table and the maps that vary it; given Gaussians are fitted again only where
    `fit` is written.
    """
    skin = inputs.spec.skin
    written = (skin.model_dump(mode="json", exclude={"path", "medium"}), "fit" in skin.model_fields_set)
    # Ranges of maps are over the mesh's tiles, and over its own layout where one is made
    laid_out = inputs.spec.texture.udim or inputs.spec.texture.unwrap != "none"
    roles = (*inputs.skin_maps, *(("mesh",) if laid_out else ()))
    maps = inputs.key(*roles) if inputs.skin_maps else None
    onto = inputs.base.gaussians.variance_mm2.tolist() if inputs.base else None
    return key_of(code_digest(*CODE), written, inputs.digests.get("skin"), maps, onto)


def kept_fit(key: str) -> KeptFit | None:
    """What the user's cache has of a fit; None where it has nothing, or something that cannot be read.

    Parameters
    ----------
    key : str
        As `fit_key` gives it.
    """
    cache = user_cache()
    entry = cache.read(_entry_key(key)) if cache else None
    if entry is None or set(entry) != set(FIT_FILES):
        return None
    files = {name: entry[name].tobytes() for name in FIT_FILES}
    gaussians = gaussians_of_text(files[FIT_FILES[0]].decode("utf-8", "replace"), key)
    return None if gaussians is None else KeptFit(gaussians, files)


def keep_fit(key: str, folder: Path) -> None:
    """Put the files of a fit that was written under `key` into the user's cache, where there is one.

    Parameters
    ----------
    key : str
    folder : Path
        That has them.
    """
    if cache := user_cache():
        files = {name: (folder / name).read_bytes() for name in FIT_FILES}
        cache.write(_entry_key(key), {name: np.frombuffer(content, np.uint8) for name, content in files.items()})


def _entry_key(key: str) -> str:
    """The plot's own code counts, too."""
    return key_of("fit", key, code_digest(PLOT_CODE))
