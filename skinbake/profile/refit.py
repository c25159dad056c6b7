"""Another skin on Gaussians that are there already: only its weights are found, which takes milliseconds."""

from __future__ import annotations

import numpy as np

from skinbake.errors import InputError
from skinbake.numerics import Float
from skinbake.profile.fit import white_weights
from skinbake.profile.fit_table import TableFitter, with_identity
from skinbake.profile.from_skin import profile_of
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.profile.variable_projection import Fitter
from skinbake.profile.varying_skin import Range
from skinbake.profile.weight_table import WeightTable
from skinbake.scene.skin import SkinSpec


def refit(
    skin: SkinSpec, variance_mm2: Float, table: WeightTable | None = None, csv: tuple[Float, Float] | None = None
) -> GaussianSum:
    """Weights of a skin on given variances; its `relative_error_rgb` says how far that is from the skin's profile.

    Parameters
    ----------
    skin : SkinSpec
    variance_mm2 : ndarray of shape (N,)
        Ascending; a first one of 0 is light that does not scatter.
    table : WeightTable, optional
        Of the skin that was there: the new one varies by the same maps.
    csv : (radius_mm, rgb), optional
        Of a `table` skin.

    Returns
    -------
    GaussianSum
        With those variances.

    Raises
    ------
    InputError
        The skin does not know what the maps vary, is dark where it is to be white, or has light that does not scatter
        where the Gaussians have none.
    """
    wide = variance_mm2[variance_mm2 > 0]
    whole = len(wide) == len(variance_mm2)
    if not len(wide) or (whole and skin.scatter < 1):
        raise InputError(f"skin.scatter: expected 1 on Gaussians without one of no width, got {skin.scatter:g}")
    profile = profile_of(skin, csv)
    try:
        if table is not None and table.names:
            gaussians = _varying(skin, wide, table, csv)
        else:
            fitter = Fitter(profile.fit_nodes(), skin.fit.energy == "exact", skin.fit.signed)
            found, energy = fitter.project(wide), profile.total_reflectance
            weight = white_weights(found.weight, energy, skin.normalise)
            gaussians = GaussianSum(wide, weight, found.error, energy, profile.model, skin.normalise)
    except ValueError as error:
        raise InputError(f"skin: {error}") from error
    scatters = table is not None and table.scatters
    return gaussians if whole else with_identity(gaussians, skin.scatter, scatters, skin.scatter)


def _varying(skin: SkinSpec, wide: Float, table: WeightTable, csv: tuple[Float, Float] | None) -> GaussianSum:
    """Weights at every node of a table.

    Parameters
    ----------
    skin, table, csv
        As `refit`.
    wide : ndarray of shape (N,)
        Variances above 0.
    """
    unknown = [name for name in table.names if not hasattr(skin, name)]
    if unknown:
        raise InputError(
            f"skin: expected one that knows {unknown[0]}, which maps vary in this bake, got model {skin.model}"
        )
    over = {
        name: Range(float(nodes[0]), float(nodes[-1]), float(np.median(nodes)))
        for name, nodes in zip(table.names, table.nodes, strict=False)
    }
    constants = {**table.constants, **{name: float(getattr(skin, name)) for name in table.names}}
    found = TableFitter(skin, over, lambda each: profile_of(each, csv)).table(wide, constants)
    middle = {name: each.mean for name, each in over.items()}
    profile = profile_of(skin.model_copy(update=middle), csv)
    worst = found.error_rgb.max(axis=(0, 1))
    weight = found.at(middle)[:, 0]
    return GaussianSum(wide, weight, worst, profile.total_reflectance, profile.model, skin.normalise, found)
