"""Keys of stages: what changes them, and what does not."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.baking.inputs import BakeInputs
from skinbake.baking.look_stages import look_stages
from skinbake.baking.memory_store import MemoryStore
from skinbake.baking.session import BakeSession
from skinbake.baking.stage_log import StageLog
from skinbake.io.config import load_look
from skinbake.io.mesh import write_obj
from skinbake.io.png import write_png
from tests.shapes import quad

LOOK = """\
mesh: {path: mesh.obj, unit: mm, any_size: true}
skin: {model: gaussians, variance_mm2: [0.05], weight_rgb: [[1, 1, 1]]}
lights:
  - {name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}
  - {name: sky, type: environment, radiance: [1, 1, 1]}
terms: {energy_conservation: off}
output: {dir: out}
"""


@pytest.fixture
def stages(tmp_path):
    """Stages of a look with some keys set, in memory."""
    write_obj(tmp_path / "mesh.obj", quad())
    (tmp_path / "look.yaml").write_text(LOOK)

    def of(*overrides):
        session, log = BakeSession(), StageLog()
        inputs = BakeInputs(load_look(tmp_path / "look.yaml", overrides), session, log)
        return look_stages(inputs, MemoryStore(), session, log)

    return of


def test_the_tolerance_is_part_of_a_sky_s_key_only(stages):
    """Another tolerance plans the sky anew, and leaves the other lights' files as they are."""
    first, other = (stages(f"diffusion.tolerance={t}").irradiance.light_keys for t in (0.05, 0.04))
    assert first["sky"] != other["sky"]
    assert first["key"] == other["key"]


@pytest.mark.parametrize("samples", ["", ", samples: 9"])
def test_a_rectangle_is_planned_by_the_tolerance_and_the_skin_that_smooths_it(stages, samples):
    """Its error is stored with it, so that both are in its key, and the skin in no other's."""
    box = f"""lights=[{{name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}},
      {{name: box, type: rectangle, position_mm: [0, 0, 90], edge_u_mm: [9, 0, 0], edge_v_mm: [0, -9, 0],
      radiance: [1, 1, 1]{samples}}}]"""
    first = stages(box, "diffusion.tolerance=0.05").irradiance.light_keys
    for change in ("skin.variance_mm2=[0.06]", "diffusion.tolerance=0.04"):
        other = stages(box, "diffusion.tolerance=0.05", change).irradiance.light_keys
        assert first["box"] != other["box"]
        assert first["key"] == other["key"]


@pytest.mark.parametrize("conserved", ["on", "off"])
def test_files_name_every_map_that_their_light_has_read(stages, tmp_path, conserved):
    """Cavities take oil off, and so change the light wherever the oil does: their digest is in the header."""
    for name in ("cavity", "f0"):
        write_png(tmp_path / f"{name}.png", np.full((4, 4, 3), 90, np.uint8))
    maps = f"maps={{cavity: {tmp_path}/cavity.png, f0: {tmp_path}/f0.png}}"
    read = stages(maps, f"terms.energy_conservation={conserved}").irradiance.inputs_read
    assert set(read) == ({"mesh", "cavity", "f0"} if conserved == "on" else {"mesh"})


def test_what_a_light_does_not_read_leaves_its_key(stages):
    """Albedo, lobes and their packing are nothing to the light; the packing of its file is."""
    first = stages().irradiance
    for change in ("maps.albedo_rgb=[0.5, 0.4, 0.3]", "diffusion.separate=false", "texturing.mode=post-scatter"):
        assert stages(change).irradiance.key() == first.key()
    packed = stages("output.compression=piz").irradiance
    assert packed.light_keys == first.light_keys
    assert packed.key() != first.key()


def test_the_order_of_the_lights_is_part_of_what_holds_several(stages):
    """Parts of a file lie in the order of the look; a light's own key does not tell it."""
    first = stages()
    turned = stages(
        "lights=[{name: sky, type: environment, radiance: [1, 1, 1]}, "
        "{name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}]"
    )
    assert first.irradiance.light_keys == turned.irradiance.light_keys
    assert first.irradiance.key() != turned.irradiance.key()
    assert first.diffuse.key() != turned.diffuse.key()


MEDIUM = "skin={model: dipole, sigma_a_per_mm: [0.03, 0.2, 0.5], sigma_sp_per_mm: [0.7, 0.9, 1.0], eta: %s}"


READERS = ("incidence", "beam", "curvature", "diffuse_profile", "transmission")


@pytest.mark.parametrize("term", READERS)
def test_a_medium_is_in_the_key_of_what_is_blurred_where_a_term_reads_it(stages, term):
    """Not in the light's: another skin does not trace it anew."""
    others_off = [f"terms.{other}=off" for other in READERS if other != term]

    def of(eta, word):
        found = stages(MEDIUM % eta, *others_off, f"terms.{term}={word}")
        gaussians = stages().profile.result()  # the same for all
        return found.irradiance.key(), found.diffuse._key(gaussians)

    assert of(1.3, "auto")[0] == of(1.4, "off")[0]
    assert of(1.3, "on")[1] != of(1.4, "on")[1]
    assert of(1.3, "off")[1] == of(1.4, "off")[1]
    assert len({of(1.3, word)[1] for word in ("auto", "on", "off")}) == 3


def test_light_between_skin_reads_the_albedo_and_the_number_of_bounces(stages):
    """With post-scatter texturing nothing else does."""

    def key(*changes):
        found = stages("texturing.mode=post-scatter", "terms.transmission=off", *changes)
        return found.diffuse._key(stages().profile.result())

    red = "maps.albedo_rgb=[0.9, 0.4, 0.3]"
    assert key() != key(red)
    assert key("terms.interreflection=off") == key("terms.interreflection=off", red)
    assert key() != key("terms.bounces=2")
    rough = "specular.roughness=0.5"
    assert key() == key(rough)
    oily = "terms.energy_conservation=on"
    assert key(oily) != key(oily, rough)
