"""How much more a medium gives back than its model of diffusion says, from place to place of a skin that varies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skinbake.numerics import Float, safe_div
from skinbake.profile.skin_medium import skin_medium
from skinbake.profile.stack_transport import stack_reflectance
from skinbake.scene.skin import PhysiologySkin

SLANTS = 4  # of Gauss-Legendre quadrature over light from everywhere: 1e-4


def levels(skins: Sequence[PhysiologySkin], total_rgb: Float, mean: PhysiologySkin, mean_total_rgb: Float) -> Float:
    """Factors on the totals of a model, (S, 3), by which they are to that of the mean skin as those of media are.

    Diffusion theory gives back too much, and more so the darker the skin. `incidence` makes up for that by the mean
    skin; this is what it leaves, theory.md 9.5. Totals are of light from everywhere: of lamps, too, that leaves less
    than those of light along the normal would.

    Parameters
    ----------
    skins : sequence of S PhysiologySkin
    total_rgb : ndarray of shape (S, 3)
        Total reflectance by the model.
    mean : PhysiologySkin
        Whose own factor is 1.
    mean_total_rgb : ndarray of shape (3,)
    """
    media = [skin_medium(skin) for skin in (*skins, mean)]
    to_rgb = media[0].to_rgb
    assert to_rgb is not None
    node, weight = np.polynomial.legendre.leggauss(SLANTS)
    cosine = (node + 1) / 2
    reflected = stack_reflectance([medium.layers for medium in media], cosine)
    diffuse = np.einsum("m,smc,rc->sr", weight * cosine, reflected, to_rgb)  # 2 int R(mu) mu dmu
    over_model = safe_div(np.maximum(diffuse, 0), np.concatenate([total_rgb, mean_total_rgb[None]]))
    return safe_div(over_model[:-1], over_model[-1])
