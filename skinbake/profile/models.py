"""The analytic models as profiles: dipole, better dipole, layers, normalised diffusion, given Gaussians."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from skinbake.numerics import Float
from skinbake.profile.better_dipole import BetterDipole
from skinbake.profile.burley import burley_disc_mean, burley_hankel, burley_reflectance
from skinbake.profile.diffusion_profile import SpectralProfile, as_radii
from skinbake.profile.dipole import dipole_reflectance, dipole_total
from skinbake.profile.fresnel import BoundaryMethod, boundary_factor
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.profile.hankel import Transform, inverse_hankel
from skinbake.profile.layers import Layer, sharp_stack_transmittance, stack_response, without_empty
from skinbake.profile.medium import Medium
from skinbake.profile.slab import Array, ThinLayers, half_space

ROUND_OFF = 1e-9  # of the flux that entered, spread over r + the shortest length: a negative R(r) this small is 0


@dataclass(frozen=True)
class DipoleProfile(SpectralProfile):
    """A semi-infinite medium by the classic dipole, everything in closed form."""

    medium: Medium
    eta: float
    boundary: BoundaryMethod = "polynomial"
    model: str = "dipole"

    @property
    def factor(self) -> float:
        """Boundary factor A of the face."""
        return boundary_factor(self.eta, self.boundary)

    def reflectance(self, radius_mm: ArrayLike) -> Float:
        """R(r) by theory.md 2.1."""
        return dipole_reflectance(self.medium, self.factor, as_radii(radius_mm)).T

    @property
    def total_reflectance(self) -> Float:
        """R_d by theory.md 2.2."""
        return dipole_total(self.medium, self.factor)

    def hankel(self, s_per_mm: Float) -> Float:
        """R~(s) by theory.md 2.6."""
        return half_space(self.medium, self.factor, s_per_mm[None])[0].T

    @property
    def lengths_mm(self) -> tuple[float, float]:
        """Free path and diffusion length, mm: as `media_lengths`."""
        return media_lengths((self.medium,))


@dataclass(frozen=True)
class BetterDipoleProfile(SpectralProfile):
    """A semi-infinite medium by d'Eon's better dipole: multiple scattering only."""

    dipole: BetterDipole
    model: str = "dipole"

    def reflectance(self, radius_mm: ArrayLike) -> Float:
        """R(r) by theory.md 2.5."""
        return self.dipole.reflectance(as_radii(radius_mm)).T

    def hankel(self, s_per_mm: Float) -> Float:
        """R~(s), whose value at 0 is the total of theory.md 2.5."""
        return self.dipole.hankel(s_per_mm[None]).T

    @property
    def lengths_mm(self) -> tuple[float, float]:
        """Free path and diffusion length, mm: as `media_lengths`."""
        return media_lengths((self.dipole.medium,))


@dataclass(frozen=True)
class LayeredProfile(SpectralProfile):
    """Layers joined by adding, one channel a coefficient; `to_rgb` mixes the channels where they are wavelengths.

    Attributes
    ----------
    layers : tuple of Layer
        Top first.
    to_rgb : ndarray of shape (3, C)
    boundary : {"polynomial", "exact", "better"}
        As `boundary_factor`.
    thin_layers : {"guarded", "ballistic", "continued"}
        As `slab`.
    """

    layers: tuple[Layer, ...]
    to_rgb: Float = field(default_factory=lambda: np.eye(3))
    boundary: BoundaryMethod = "polynomial"
    thin_layers: ThinLayers = "guarded"
    model: str = "multipole"

    def __post_init__(self) -> None:
        object.__setattr__(self, "layers", without_empty(self.layers))

    def _response(self, s_per_mm: Array) -> tuple[Array, Array]:
        """R~ and T~ of the stack, each (C, ...)."""
        return stack_response(self.layers, s_per_mm, self.boundary, self.thin_layers)

    def hankel(self, s_per_mm: Float) -> Float:
        """R~(s) by theory.md 3.5 and 3.7."""
        return (self.to_rgb @ self._response(s_per_mm[None])[0]).T

    @property
    def total_transmittance(self) -> Float:
        """Total transmittance T~(0), shape (3,)."""
        return self.to_rgb @ self._response(np.zeros((1, 1)))[1][:, 0]

    @property
    def sharp_transmittance(self) -> Float:
        """Limit of T~ at infinite frequency, shape (3,): the delta of T(r)."""
        return self.to_rgb @ self._sharp

    @property
    def _sharp(self) -> Float:
        """Delta of T(r) by channel, shape (C,)."""
        channels = len(self.layers[0].medium.albedo)
        return np.broadcast_to(sharp_stack_transmittance(self.layers, self.thin_layers), channels)

    def reflectance(self, radius_mm: ArrayLike) -> Float:
        """R(r) by the inverse Hankel transform."""
        return self._inverse(lambda s: self._response(s)[0], radius_mm)

    def transmittance(self, radius_mm: ArrayLike) -> Float:
        """T(r) without its delta, by the inverse Hankel transform."""
        if np.isinf(self.layers[-1].thickness_mm):
            return super().transmittance(radius_mm)
        sharp = self._sharp[:, None, None]
        return self._inverse(lambda s: self._response(s)[1] - sharp.reshape(sharp.shape[: s.ndim]), radius_mm)

    def _inverse(self, transform: Transform, radius_mm: ArrayLike) -> Float:
        """Inverse Hankel transform of channels (C, ...), mixed to RGB: shape (N, 3)."""
        first = np.min([layer.medium.sigma_tr_per_mm for layer in self.layers], axis=0)
        radius = as_radii(radius_mm)
        shortest, longest = self.lengths_mm
        digits = 13 if len(first) <= 3 else 8  # wavelengths: many, and measured to few digits
        # A few radii at a time keeps many wavelengths within the cache
        parts = np.array_split(radius, max(1, len(radius) * len(first) // 200))
        values = np.concatenate([inverse_hankel(transform, r, first, shortest, longest, digits).T for r in parts])
        # Where nothing is left the integral is round-off of either sign; larger negative values are shown as they are
        round_off = ROUND_OFF / (2 * np.pi * (radius + shortest) ** 2)
        return np.where((values < 0) & (-values < round_off[:, None]), 0.0, values) @ self.to_rgb.T

    @property
    def lengths_mm(self) -> tuple[float, float]:
        """Least distance of a source from a face, and the longest free path or diffusion length, mm."""
        shortest, longest = media_lengths(tuple(layer.medium for layer in self.layers))
        for layer in self.layers:
            if np.isfinite(layer.thickness_mm):
                to_face = np.abs(layer.thickness_mm - layer.medium.free_path_mm)
                near = np.where(to_face > 1e-9 * layer.thickness_mm, to_face, layer.thickness_mm)
                shortest = min(shortest, layer.thickness_mm, float(near.min()))
        return shortest, longest


@dataclass(frozen=True)
class BurleyProfile(SpectralProfile):
    """Normalised diffusion, theory.md 8.1. R rises as 1/r: at r = 0 it is the mean over a disc of radius d/20.

    A fit sees model and Gaussians through a Gaussian of that size.

    Attributes
    ----------
    d_mm, albedo : ndarray of shape (3,)
    """

    d_mm: Float
    albedo: Float
    model: str = "burley"

    @property
    def footprint_mm(self) -> float:  # type: ignore[override]
        """Radius of the disc, d/20 of the narrowest channel, mm."""
        return float(np.min(self.d_mm)) / 20

    def reflectance(self, radius_mm: ArrayLike) -> Float:
        """R(r) by theory.md 8.1."""
        radius = as_radii(radius_mm)
        at_zero = burley_disc_mean(self.d_mm, self.albedo, self.footprint_mm)
        elsewhere = burley_reflectance(self.d_mm, self.albedo, np.where(radius > 0, radius, 1.0)).T
        return np.where((radius == 0)[:, None], at_zero, elsewhere)

    @property
    def total_reflectance(self) -> Float:
        """Total reflectance A, shape (3,)."""
        return self.albedo

    def hankel(self, s_per_mm: Float) -> Float:
        """R~(s) by theory.md 8.1."""
        return burley_hankel(self.d_mm, self.albedo, s_per_mm).T

    @property
    def lengths_mm(self) -> tuple[float, float]:
        """Lengths such that the footprint has damped the highest frequency to exp(-36)."""
        return self.footprint_mm * 45 / 8.5, float(np.max(self.d_mm)) * 3


@dataclass(frozen=True)
class GaussianProfile(SpectralProfile):
    """A given sum of Gaussians seen as a model; a variance of 0 is a delta and stays out of R(r)."""

    gaussians: GaussianSum
    model: str = "gaussians"

    def reflectance(self, radius_mm: ArrayLike) -> Float:
        """Sum of the Gaussians at r, mm^-2, shape (N, 3)."""
        return self.gaussians.evaluate(as_radii(radius_mm))

    def hankel(self, s_per_mm: Float) -> Float:
        """Sum of w exp(-v s^2 / 2), shape (M, 3)."""
        return np.exp(-(s_per_mm[:, None] ** 2) * self.gaussians.variance_mm2 / 2) @ self.gaussians.weight_rgb

    @property
    def lengths_mm(self) -> tuple[float, float]:
        """Lengths such that the narrowest Gaussian, deltas aside, has fallen to exp(-36) at the highest frequency."""
        wide = self.gaussians.variance_mm2[self.gaussians.variance_mm2 > 0]
        if wide.size == 0:
            return 1.0, 1.0
        return float(np.sqrt(wide[0])) * 45 / 8.5, float(np.sqrt(wide[-1]))


def media_lengths(media: tuple[Medium, ...]) -> tuple[float, float]:
    """Shortest free path, and longest free path or diffusion length, mm.

    Where nothing absorbs the diffusion length is infinite; 1e3 free paths stand for it.
    """
    paths = np.concatenate([medium.free_path_mm for medium in media])
    spread = np.concatenate([1 / np.maximum(m.sigma_tr_per_mm, 1e-3 / m.free_path_mm) for m in media])
    return float(paths.min()), float(max(paths.max(), spread.max()))
