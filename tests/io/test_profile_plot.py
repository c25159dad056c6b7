"""The fit's plot is drawn whatever the Gaussians are, and without a warning of matplotlib's."""

import numpy as np

from skinbake.io.image import read_map
from skinbake.profile import fit_skin
from skinbake.scene.parse import parse
from skinbake.scene.skin import SkinSpec
from tests.plots import draw_fit_plot

MANY = [list(row) for row in np.full((10, 3), 0.1)]
SKINS = {
    "light that leaves where it arrives": {"variance_mm2": [0.0, 2.0], "weight_rgb": [[0.5, 0, 0.3], [0.5, 1, 0.7]]},
    "more Gaussians than have names": {"variance_mm2": np.geomspace(0.01, 90, 10).tolist(), "weight_rgb": MANY},
    "negative weights": {"variance_mm2": [1.0, 4.0], "weight_rgb": [[-0.2] * 3, [1.2] * 3], "normalise": "none"},
    "narrower than a beam": {"model": "dipole", "sigma_a_per_mm": [0.1, 0.2, 40], "sigma_sp_per_mm": [1, 2, 300],
                             "fit": {"gaussians": 2}},
}  # fmt: skip


def test_every_kind_of_fit_is_drawn(tmp_path):
    """All of one size, on white, with each channel's colour, and no two alike."""
    found = []
    for number, keys in enumerate(SKINS.values()):
        skin = parse(SkinSpec, {"model": "gaussians", **keys}, lambda key, text: text)
        draw_fit_plot(tmp_path / f"{number}.png", fit_skin(skin))
        found.append(read_map(tmp_path / f"{number}.png", 3, "linear"))
        assert found[-1].shape == (840, 1890, 3)
        assert (found[-1][[0, -1]] == 1).all()
        for name, colour in (("red", (0, 1, 2)), ("green", (1, 0, 2)), ("blue", (2, 1, 0))):
            most, *others = (found[-1][..., channel] for channel in colour)
            assert (most > np.max(others, axis=0) + 0.08).sum() > 100, (number, name)
    assert all((a != b).any() for k, a in enumerate(found) for b in found[:k])
