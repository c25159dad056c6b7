"""A skin on the variances of another one, with all that a bake asks of a fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skinbake.numerics import Float
from skinbake.profile.edge_error import edge_error
from skinbake.profile.fit import fit_skin
from skinbake.profile.fit_report import FitReport
from skinbake.profile.from_skin import profile_of
from skinbake.profile.refit import refit
from skinbake.scene.skin import GaussiansSkin, SkinSpec


def fit_onto(skin: SkinSpec, variance_mm2: Float, table: tuple[Float, Float] | None = None) -> FitReport:
    """Gaussians of given variances for a skin that is the same everywhere; given ones of these variances stay.

    Parameters
    ----------
    skin : SkinSpec
    variance_mm2 : ndarray of shape (N,)
        As of `refit`.
    table : (radius_mm, rgb), optional
        Of a `table` skin.

    Raises
    ------
    InputError
        As `refit`.
    """
    if isinstance(skin, GaussiansSkin) and "fit" not in skin.model_fields_set:
        own = fit_skin(skin, table)
        if np.array_equal(own.gaussians.variance_mm2, variance_mm2):
            return own
    gaussians, profile = refit(skin, variance_mm2, csv=table), profile_of(skin, table)
    wide, scale = variance_mm2 > 0, profile.total_reflectance if skin.normalise == "white" else np.ones(3)
    weight = gaussians.weight_rgb[wide] * scale / max(skin.scatter, 1e-12)  # of all that scatters, in the model's scale
    edges = edge_error(profile.fit_nodes(), variance_mm2[wide], weight)
    return FitReport(replace(gaussians, edge_error_rgb=edges), profile, scattered=skin.scatter)
