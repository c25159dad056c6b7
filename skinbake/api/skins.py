"""Profiles of skins."""

from __future__ import annotations

from pathlib import Path

from skinbake import profile
from skinbake.io.config import load_skin
from skinbake.io.table import read_profile_csv
from skinbake.numerics import Float
from skinbake.profile import DiffusionProfile, FitReport
from skinbake.scene.skin import SkinSpec
from skinbake.scene.spec import SceneSpec


def profile_of(skin: SkinSpec | SceneSpec | Path | str) -> DiffusionProfile:
    """Scattering model of a skin.

    Parameters
    ----------
    skin : SkinSpec, SceneSpec or path
        `look.skin`, a look, or the file of a look or of just its skin.

    Returns
    -------
    DiffusionProfile
        Its `reflectance(radius_mm)` is R(r), mm^-2; `skinbake.profile.evaluate` gives a table.

    Raises
    ------
    InputError, ConfigError
        The file cannot be used.
    """
    spec = _skin(skin)
    return profile.profile_of(spec, _table(spec))


def fit_skin(skin: SkinSpec | SceneSpec | Path | str) -> FitReport:
    """Sum of Gaussians fitted to a skin's profile, as many as its `fit` asks for, and how good it is.

    Parameters
    ----------
    skin : SkinSpec, SceneSpec or path
        `look.skin`, a look, or the file of a look or of just its skin.

    Returns
    -------
    FitReport
        `gaussians.variance_mm2` (N,), `gaussians.weight_rgb` (N, 3), `relative_error_rgb` (3,).

    Raises
    ------
    InputError, ConfigError
        The file cannot be used, or the profile is dark.
    """
    spec = _skin(skin)
    return profile.fit_skin(spec, _table(spec))


def _skin(skin: SkinSpec | SceneSpec | Path | str) -> SkinSpec:
    if isinstance(skin, SceneSpec):
        return skin.skin
    return load_skin(skin) if isinstance(skin, Path | str) else skin


def _table(skin: SkinSpec) -> tuple[Float, Float] | None:
    path = getattr(skin, "path", None)
    return read_profile_csv(path) if path else None
