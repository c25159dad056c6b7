"""A skin's profile as a sum of Gaussians, and how good that is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from skinbake.errors import InputError
from skinbake.numerics import Float, safe_div
from skinbake.profile.diffusion_profile import DiffusionProfile
from skinbake.profile.edge_error import edge_error
from skinbake.profile.fit_report import FitReport
from skinbake.profile.fit_table import TableFitter, with_identity
from skinbake.profile.from_skin import given_gaussians, profile_of
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.profile.models import GaussianProfile
from skinbake.profile.scaled import scaled_gaussians
from skinbake.profile.variable_projection import Fitter, Projection
from skinbake.profile.varying_skin import Range, mean_skin
from skinbake.scene.skin import FitSpec, GaussiansSkin, SkinSpec

MAX_GAUSSIANS = 12
CHANNELS = ("red", "green", "blue")


def fit_skin(
    skin: SkinSpec,
    table: tuple[Float, Float] | None = None,
    photons: int | None = None,
    seed: int | None = None,
    over: Mapping[str, Range] | None = None,
) -> FitReport:
    """Gaussians for a skin, with the profile that they stand for. Given ones pass unchanged unless `fit` is asked for.

    Parameters
    ----------
    skin : SkinSpec
    table, photons, seed
        As `profile_of`.
    over : mapping of str to Range, optional
        What maps vary, and between which values: the Gaussians are then shared by all of these skins, and have a
        `WeightTable`.

    Raises
    ------
    InputError
        If the profile is dark: in any channel where it is to be normalised to white, else in all of them.
    """
    over = over or {}
    mean = mean_skin(skin, over)
    varied = {name: each for name, each in over.items() if each.low < each.high}
    profiles = {name: each for name, each in varied.items() if name != "scatter"}
    if profiles:
        constants = {name: float(getattr(skin, name)) for name in (*profiles, "scatter")}
        report = _over_range(mean, profiles, constants, lambda each: profile_of(each, table, photons, seed))
    else:
        report = _of_one(mean, table, photons, seed)
    if mean.scatter == 1 and "scatter" not in varied:
        return report
    gaussians = with_identity(report.gaussians, mean.scatter, "scatter" in varied, float(skin.scatter))
    return replace(report, gaussians=gaussians, scattered=mean.scatter)


def _of_one(skin: SkinSpec, table: tuple[Float, Float] | None, photons: int | None, seed: int | None) -> FitReport:
    """The fit of a skin that is the same everywhere.

    Parameters
    ----------
    skin, table, photons, seed
        As `fit_skin`.
    """
    profile = profile_of(skin, table, photons, seed)
    if isinstance(skin, GaussiansSkin) and "fit" not in skin.model_fields_set:
        given = scaled_gaussians(given_gaussians(skin), skin.radius)
        weight = white_weights(given.weight_rgb, given.energy_rgb, skin.normalise)
        gaussians = GaussianSum(
            given.variance_mm2, weight, np.zeros(3), given.energy_rgb, profile.model, skin.normalise
        )
        return FitReport(gaussians, profile)
    return fit_report(profile, skin.fit, skin.normalise)


def _over_range(
    mean: SkinSpec,
    over: Mapping[str, Range],
    constants: Mapping[str, float],
    profile_of: Callable[[SkinSpec], DiffusionProfile],
) -> FitReport:
    """Gaussians that skins of a range share, with their table of weights.

    Parameters
    ----------
    mean : SkinSpec
    over : mapping of str to Range
    constants : mapping of str to float
        As of a `WeightTable`.
    profile_of : callable
        The profile of a skin.
    """
    profile, fit = profile_of(mean), mean.fit
    try:
        fitter = TableFitter(mean, over, profile_of)
    except ValueError as error:
        raise InputError(str(error)) from error
    counts = [fit.gaussians or 6] if fit.tolerance is None else range(1, MAX_GAUSSIANS + 1)
    for count in counts:
        variance = fitter.variances(count)
        table = fitter.table(variance, constants)
        worst = table.error_rgb.max(axis=(0, 1))
        met = fit.tolerance is None or bool(worst.max() <= fit.tolerance)
        if met:
            break
    weight = table.at({name: each.mean for name, each in over.items()})[:, 0]
    gaussians = GaussianSum(variance, weight, worst, profile.total_reflectance, profile.model, mean.normalise, table)
    return FitReport(gaussians, profile, fit.tolerance, met)


def more_gaussians(gaussians: GaussianSum, fit: FitSpec) -> int | None:
    """How many Gaussians would come visibly nearer; None where those that there are come near enough, or are the most.

    Parameters
    ----------
    gaussians : GaussianSum
    fit : FitSpec
        Whose tolerance is asked, where it has one.
    """
    count = int(np.count_nonzero(gaussians.variance_mm2))
    if count >= MAX_GAUSSIANS or not gaussians.too_far_off(fit.tolerance):
        return None
    return min(count + 2, MAX_GAUSSIANS)


def fit_report(profile: DiffusionProfile, fit: FitSpec, normalise: str = "white") -> FitReport:
    """Fit Gaussians of shared variances by the r-weighted relative error, theory.md 4.2.

    Parameters
    ----------
    profile : DiffusionProfile
    fit : FitSpec
        A number of Gaussians, or the tolerance that the worst channel must meet with as few as possible.
    normalise : {"white", "none"}
        "white" scales each channel's weights to sum to 1.

    Raises
    ------
    InputError
        If the profile is dark (in any channel, with "white"), not finite, or has a delta.

    References
    ----------
    [dEon2007]
    """
    if isinstance(profile, GaussianProfile) and profile.gaussians.variance_mm2[0] == 0:
        raise InputError("variance_mm2: expected values > 0 to fit again, a Gaussian of variance 0 is a delta")
    try:
        nodes = profile.fit_nodes()
        fitter = Fitter(nodes, exact_energy=fit.energy == "exact", signed=fit.signed)
    except ValueError as error:
        raise InputError(str(error)) from error
    energy = profile.total_reflectance
    white_weights(energy[None], energy, normalise)  # refuse before the work
    if fit.tolerance is None:
        found, met = fitter.fit(fit.gaussians or 6), True
    else:
        found, met = _fewest(fitter, fit.tolerance)
    weight = white_weights(found.weight, energy, normalise)
    edges = edge_error(nodes, found.variance_mm2, found.weight)
    gaussians = GaussianSum(
        found.variance_mm2, weight, found.error, energy, profile.model, normalise, edge_error_rgb=edges
    )
    return FitReport(gaussians, profile, fit.tolerance, met)


def _fewest(fitter: Fitter, tolerance: float) -> tuple[Projection, bool]:
    """Fewest Gaussians whose worst channel meets the tolerance, or the best found and False."""
    best: Projection | None = None
    starts: list[Float] = []
    for count in range(1, MAX_GAUSSIANS + 1):
        found = fitter.fit(count, starts)
        if best is None or found.error.max() < best.error.max():
            best = found
        if found.error.max() <= tolerance:
            return found, True
        # The next one starts from this one, with its widest gap filled
        log_v = np.log(found.variance_mm2)
        gap = int(np.argmax(np.diff(log_v))) if count > 1 else 0
        middle = log_v[gap : gap + 2].mean() if count > 1 else log_v[0] + 1.5
        starts = [np.exp(np.append(log_v, middle))]
    assert best is not None
    return best, False


def white_weights(weight: Float, energy: Float, normalise: str) -> Float:
    """Weights (N, 3) scaled so that each channel sums to 1 ("white"), or as they are ("none").

    Parameters
    ----------
    weight : ndarray of shape (N, 3)
    energy : ndarray of shape (3,)
        Total reflectance of the model.
    normalise : {"white", "none"}

    Raises
    ------
    InputError
        If a channel to be made white has no light.
    """
    if normalise == "none":
        return weight
    total = weight.sum(axis=0)
    for channel, light, kept in zip(CHANNELS, energy, total, strict=True):
        if light <= 0 or kept <= 0:
            raise InputError(
                f"skin.normalise: white needs light in every channel, {channel} reflects {light:.3g}; use none"
            )
    return safe_div(weight, total)
