"""Scattering models, and the sum of Gaussians fitted to them. What leaves this folder is a GaussianSum."""

from skinbake.profile.diffusion_profile import DiffusionProfile, Evaluated, evaluate
from skinbake.profile.fit import fit_report, fit_skin
from skinbake.profile.fit_report import FitReport
from skinbake.profile.from_skin import profile_of
from skinbake.profile.gaussian_sum import GaussianSum

__all__ = [
    "DiffusionProfile",
    "Evaluated",
    "FitReport",
    "GaussianSum",
    "evaluate",
    "fit_report",
    "fit_skin",
    "profile_of",
]
