"""The better dipole: Grosjean's diffusion, with an exitance from both flux and fluence. Multiple scattering only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skinbake.numerics import Float
from skinbake.profile.fresnel import boundary_factor, fresnel_moments
from skinbake.profile.medium import Medium
from skinbake.profile.slab import Array, per_channel


@dataclass(frozen=True)
class BetterDipole:
    """Reflectance of a semi-infinite medium by theory.md 2.5; channel by channel, arrays of shape (C,).

    Attributes
    ----------
    medium : Medium
    eta : float
        Index inside over index outside, from 1/3 to 3.

    References
    ----------
    [dEon2012]
    """

    medium: Medium
    eta: float

    @property
    def diffusion_mm(self) -> Float:
        """Grosjean's diffusion coefficient D_G, mm, shape (C,)."""
        return (2 * self.medium.sigma_a_per_mm + self.medium.sigma_sp_per_mm) / (3 * self.medium.sigma_tp_per_mm**2)

    @property
    def sigma_tr_per_mm(self) -> Float:
        """Effective transport coefficient sqrt(sigma_a / D_G), 1/mm, shape (C,)."""
        return np.sqrt(self.medium.sigma_a_per_mm / self.diffusion_mm)

    @property
    def mirror_gap_mm(self) -> Float:
        """Distance 4 A D_G between the real source's mirror image and the virtual source, mm, shape (C,)."""
        return 4 * boundary_factor(self.eta, "better") * self.diffusion_mm

    @property
    def exitance(self) -> tuple[float, float]:
        """Shares C_phi of the fluence and C_E of the flux that leave through the face."""
        first, second = fresnel_moments(self.eta)
        return (1 - first) / 4, (1 - second) / 2

    def reflectance(self, radius_mm: Float) -> Float:
        """R(r), mm^-2, shape (C, N), for radii of shape (N,)."""
        c_phi, c_flux = self.exitance
        sigma_tr, diffusion = self.sigma_tr_per_mm[:, None], self.diffusion_mm[:, None]
        real = self.medium.free_path_mm[:, None]
        total = np.zeros((len(real), len(radius_mm)))
        # f(z_r) - f(z_v), theory.md 2.5
        for z in (real, -real - self.mirror_gap_mm[:, None]):
            distance = np.hypot(radius_mm[None, :], z)
            source = c_flux * z / distance * (1 / distance + sigma_tr) + c_phi / diffusion
            total += np.sign(z) * source * np.exp(-sigma_tr * distance) / distance
        return self.medium.albedo[:, None] ** 2 / (4 * np.pi) * total

    def hankel(self, s_per_mm: Array) -> Array:
        """R~(s), shape (C, ...), for frequencies (1/mm) of shape (1 or C, ...).

        The difference of the fluence terms is an expm1, finite at g = 0.
        """
        c_phi, c_flux = self.exitance
        real, gap = per_channel(self.medium.free_path_mm, s_per_mm), per_channel(self.mirror_gap_mm, s_per_mm)
        g = np.sqrt(per_channel(self.sigma_tr_per_mm**2, s_per_mm) + s_per_mm * s_per_mm)
        still = g == 0
        fluence = np.where(still, gap, -np.expm1(-g * gap) / np.where(still, 1, g))
        flux = c_flux * (1 + np.exp(-g * gap))
        albedo = per_channel(self.medium.albedo, g)
        return albedo**2 / 2 * np.exp(-g * real) * (c_phi / per_channel(self.diffusion_mm, g) * fluence + flux)
