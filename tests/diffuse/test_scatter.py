"""What of a look's light is looked for, and what is left alone."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.atlas import rasterize
from skinbake.diffuse.scatter import ThinParts, scatter
from skinbake.diffuse.terms.thin_parts import FEW_MM, TEXEL_MM
from skinbake.irradiance.decide import decide
from skinbake.irradiance.light_skin import light_skin
from skinbake.irradiance.scene_data import SceneData
from skinbake.profile import GaussianSum
from skinbake.profile.entered_skin import EnteredSkin
from skinbake.scene.maps import SkinMaps
from skinbake.scene.spec import SceneSpec
from tests.diffuse.test_light_entering import MEDIUM, OFF, SKIN
from tests.diffuse.test_transmission import slab_mesh

SUN = {"name": "sun", "type": "directional", "direction": [0.3, 0, 1], "irradiance": [1, 1, 1]}


@pytest.mark.parametrize(
    ("thickness_mm", "switch", "looks"),
    [(39.0, "auto", [FEW_MM]), (2.0, "auto", [FEW_MM, TEXEL_MM]), (39.0, "on", [FEW_MM, TEXEL_MM]), (2.0, "off", [])],
)
def test_thin_parts_are_looked_for_in_full_only_where_a_few_texels_find_some(monkeypatch, thickness_mm, switch, looks):
    """A slab lit from below: thick and dark, it is looked through at a few texels; thin, at all of them, too."""
    asked, whole = [], ThinParts.of

    def of(skin, texel_mm=TEXEL_MM, **rays):
        asked.append(texel_mm)
        return whole(skin, texel_mm, **rays)

    monkeypatch.setattr(ThinParts, "of", of)
    mesh, size = slab_mesh(thickness_mm), (66, 30)
    look = {
        "mesh": {"path": "m.obj", "unit": "mm"}, "skin": SKIN, "lights": [SUN], "output": {"dir": "out"},
        "texture": {"size": list(size)}, "terms": OFF | {"transmission": switch, "curvature": "off"},
    }  # fmt: skip
    spec = SceneSpec.model_validate(look)
    scene, atlas, decisions = SceneData(mesh, SkinMaps(), {}), rasterize(mesh, size, 2), decide(spec)
    arrived = light_skin(spec, decisions, scene, atlas)
    skin = GaussianSum(np.array([0.5, 4.0]), np.full((2, 3), 0.3), np.zeros(3), np.full(3, 0.6))
    made = scatter(spec, decisions, scene, atlas, arrived, EnteredSkin(skin, MEDIUM))
    assert asked == looks
    (line,) = (line for line in made.plan if line.term == "transmission")
    assert line.enabled == (looks[-1:] == [TEXEL_MM])
    assert len(made.lobes) == 2 + line.enabled
