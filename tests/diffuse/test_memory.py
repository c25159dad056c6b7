"""A bake that would not fit is refused before it begins."""

import pytest

from skinbake.diffuse import memory, scatter
from skinbake.diffuse.memory import LOADED_BYTES, check_memory, disk_needed_bytes, memory_needed_bytes
from skinbake.diffuse.scatter import other_lights, refuse_too_large
from skinbake.errors import MachineError
from skinbake.irradiance.decide import decide
from skinbake.scene.spec import SceneSpec


def test_too_much_memory_is_refused_with_the_amount():
    """16384^2 of four lights on any machine here; 8192^2 of one light fits 24 GiB."""
    assert memory_needed_bytes((8192, 8192), 1) < 24 * 2**30
    with pytest.raises(MachineError, match=r"needs about \d+ GiB"):
        check_memory((1 << 17, 1 << 17), 4, 1, 6, "auto")


def test_temporary_files_take_the_place_of_memory():
    """8192^2 of three lights within 8 GiB; what is read at a time does not grow with the texture."""
    sizes = [memory_needed_bytes((n, n), 3, on_disk=True) for n in (1024, 2048, 4096, 8192)]
    assert sizes[-1] < 8 * 2**30 - LOADED_BYTES
    assert sizes[-1] < 0.2 * memory_needed_bytes((8192, 8192), 3)
    assert sizes[3] - sizes[2] < 4 * sizes[2] < 16 * sizes[1] < 64 * sizes[0]
    assert memory_needed_bytes((8192, 8192), 6, on_disk=True) > sizes[-1]


def test_a_disk_without_room_is_refused_where_memory_would_not_do(tmp_path, monkeypatch):
    """A look that memory holds is baked there."""
    look = {
        "mesh": {"path": "m.obj", "unit": "mm"},
        "skin": {"model": "gaussians", "variance_mm2": [1.0], "weight_rgb": [[1.0, 1.0, 1.0]]},
        "lights": [{"name": "key", "type": "directional", "direction": [0, 0, -1], "irradiance": [1, 1, 1]}],
        "output": {"dir": str(tmp_path / "not" / "yet")},
    }
    small, large = (SceneSpec.model_validate(look | {"texture": {"size": size}}) for size in (512, 16384))
    monkeypatch.setattr(scatter, "free_disk_bytes", lambda folder: 1 << 30)
    refuse_too_large(small, decide(small), 1)
    with pytest.raises(MachineError, match=r"or make room for 50 GiB of temporary files in .*not/yet \(1 free\)"):
        refuse_too_large(large, decide(large), 1)
    monkeypatch.setattr(scatter, "free_disk_bytes", lambda folder: 1 << 40)
    monkeypatch.setattr(memory, "physical_memory_bytes", lambda: 12 << 30)
    refuse_too_large(large, decide(large), 1)
    with pytest.raises(MachineError, match=r"needs about \d+ GiB of memory, this machine has 12 GiB"):
        refuse_too_large(large, decide(large), 1, on_disk=False)


def test_light_that_is_shifted_is_held_twice():
    """The source itself at least, light by light."""
    more = memory_needed_bytes((1024, 1024), 3, others=1) - memory_needed_bytes((1024, 1024), 3)
    assert 3 * 12 * 2**20 < more < 3 * 60 * 2**20
    assert memory_needed_bytes((1024, 1024), 3, others=2) - memory_needed_bytes((1024, 1024), 3) == 2 * more


def test_lights_of_single_lobes_are_foreseen_where_they_are_asked_for():
    """Of a skin that has a medium; temporary files of the default look were 3.6 GB with them."""
    plain = {
        "mesh": {"path": "m.obj", "unit": "mm"}, "output": {"dir": "out"},
        "lights": [{"name": "sky", "type": "environment", "radiance": [1, 1, 1]}],
    }  # fmt: skip

    def look(**keys):
        return SceneSpec.model_validate(plain | keys)

    skin = {"model": "dipole", "sigma_a_per_mm": [0.03, 0.2, 0.5], "sigma_sp_per_mm": [0.7, 0.9, 1.0]}
    of = {word: other_lights(look(skin=skin, terms={"diffuse_profile": word})) for word in ("off", "auto", "on")}
    assert of == {"off": 1, "auto": 1, "on": 4}
    assert disk_needed_bytes((2048, 2048), 3, others=of["on"]) > 3.6e9
    assert other_lights(look(skin={"model": "gaussians", "variance_mm2": [1.0], "weight_rgb": [[1, 1, 1]]})) == 0


def test_texels_that_look_for_skin_are_counted():
    """A million of them holds a few hundred MiB, in files or not."""
    for on_disk in (False, True):
        more = memory_needed_bytes((1024, 1024), 3, on_disk=on_disk, looking=1 << 20)
        more -= memory_needed_bytes((1024, 1024), 3, on_disk=on_disk)
        assert 200 * 2**20 < more < 400 * 2**20
