"""One medium that stands for layers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skinbake.profile.effective_medium import one_layer
from skinbake.profile.fit import fit_skin
from skinbake.profile.layers import Layer
from skinbake.profile.skin_medium import SkinMedium, skin_medium
from skinbake.scene.skin import DipoleSkin

SKIN1 = DipoleSkin(
    model="dipole", sigma_a_per_mm=(0.032, 0.17, 0.48), sigma_sp_per_mm=(0.74, 0.88, 1.01), eta=1.4, scatter=0.7
)


def test_layers_of_one_medium_are_that_medium_again():
    """By the width and the total of its profile alone, whatever share does not scatter, and to what a fit leaves."""
    medium = skin_medium(SKIN1)
    (layer,) = medium.layers
    cut = SkinMedium((replace(layer, thickness_mm=0.3), layer))
    found = one_layer(cut, fit_skin(SKIN1).gaussians)
    assert isinstance(found, Layer)
    np.testing.assert_allclose(found.medium.free_path_mm, layer.medium.free_path_mm, rtol=0.05)
    np.testing.assert_allclose(found.medium.albedo, layer.medium.albedo, rtol=0.03)
    assert found.eta == 1.4
    assert one_layer(medium, fit_skin(SKIN1).gaussians) is layer
