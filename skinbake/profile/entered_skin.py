"""EnteredSkin: what of a skin the light that enters it knows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skinbake.numerics import Float
from skinbake.profile.gaussian_sum import GaussianSum
from skinbake.profile.incidence import Incidence
from skinbake.profile.skin_medium import SkinMedium


class EnteredSkin(NamedTuple):
    """A skin as light enters it.

    Attributes
    ----------
    gaussians : GaussianSum
        Its total is what comes back of light along the normal.
    medium : SkinMedium
        The skin's, or why nothing is known of it or of the directions of light.
    incidence : Incidence, optional
        Of the medium, unless it is not asked for or there is no medium.
    """

    gaussians: GaussianSum
    medium: SkinMedium
    incidence: Incidence | None = None

    @property
    def reference_rgb(self) -> Float:
        """Share of light that a factor of 1 on slanted light stands for, (3,).

        A white profile is that of light from everywhere: a constant sky stays what it was. Else the profile is of a
        beam along the normal: of its own medium by what it says itself, so that the light is the medium's, of a medium
        that is only named by what comes back there.
        """
        assert self.incidence is not None
        if self.gaussians.normalise == "white":
            return self.incidence.diffuse_rgb
        if self.medium.named:
            return self.incidence.reflectance_rgb[-1]
        return self.gaussians.weight_rgb.sum(axis=0).astype(np.float32).astype(np.float64)
