"""Every key of a map that makes a difference makes a stage stale, and only the stages that read that map."""

from __future__ import annotations

import pytest

from skinbake.baking.inputs import BakeInputs
from skinbake.baking.look_stages import look_stages
from skinbake.baking.memory_store import MemoryStore
from skinbake.baking.session import BakeSession
from skinbake.baking.stage_log import StageLog
from skinbake.io.mesh import write_obj
from skinbake.scene.spec import SceneSpec
from tests.shapes import quad

MAPS = {
    "albedo": {"path": "a.png"},
    "normal": {"path": "n.png"},
    "roughness": {"path": "r.png"},
    "specular": {"path": "s.png"},
    "cavity": {"path": "c.png"},
    "f0": {"path": "f.png"},
    "height": {"path": "h.png", "scale_mm": 1.0},
    "detail": {"path": "d.png", "repeat": 4},
}
COLOUR = {"color_space": "linear", "layer": "x"}
CHANGES = {
    "albedo": COLOUR | {"channel": "r", "invert": True},
    "normal": COLOUR | {"space": "object", "green": "directx", "encoding": "signed", "strength": 2.0},
    "roughness": COLOUR | {"channel": "r", "invert": True, "kind": "ggx"},
    "specular": COLOUR | {"channel": "r", "invert": True},
    "cavity": COLOUR | {"channel": "r", "invert": True},
    "f0": COLOUR | {"channel": "r", "invert": True, "scale": 0.1},
    "height": COLOUR | {"channel": "r", "invert": True, "scale_mm": 2.0},
    "detail": COLOUR | {"green": "directx", "encoding": "signed", "strength": 2.0, "repeat": 5},
}


@pytest.fixture
def keys(tmp_path):
    """A function of a map's changed keys: keys of a light and of the lobes, as the files are now."""
    write_obj(tmp_path / "m.obj", quad(240, 200))
    for of in MAPS.values():
        (tmp_path / of["path"]).write_text("content")

    def of(role=None, energy_conservation="on", without=(), taken=None, **change):
        maps = {name: dict(of) for name, of in MAPS.items() if name not in without}
        if role:
            maps[role] |= change
        if maps.get("normal", {}).get("space") == "object":
            maps = {name: of for name, of in maps.items() if name not in ("height", "detail")}
        for each in maps.values():
            each["path"] = str(tmp_path / each["path"])
        spec = SceneSpec.model_validate(
            {
                "mesh": {"path": str(tmp_path / "m.obj"), "unit": "mm"},
                "maps": maps | (taken or {}),
                "skin": {"model": "gaussians", "variance_mm2": [1.0], "weight_rgb": [[1.0, 1.0, 1.0]]},
                "lights": [{"name": "key", "type": "directional", "direction": [0, 0, -1], "irradiance": [1, 1, 1]}],
                "terms": {"energy_conservation": energy_conservation, "transmission": "off"},
                "output": {"dir": "out"},
            }
        )
        session, log = BakeSession(), StageLog()
        stages = look_stages(BakeInputs(spec, session, log), MemoryStore(), session, log)
        return stages.irradiance.light_keys["key"], stages.diffuse._albedo_before()

    return of


@pytest.mark.parametrize(("role", "key"), [(role, key) for role, of in CHANGES.items() for key in of])
def test_a_changed_key_is_seen_by_who_reads_the_map(keys, role, key):
    """Light: all but the albedo; lobes: the albedo alone, and light through its own key."""
    before, after = keys(), keys(role, **{key: CHANGES[role][key]})
    assert (after[0] != before[0]) == (role != "albedo")
    assert (after[1] != before[1]) == (role == "albedo")


@pytest.mark.parametrize("role", MAPS)
def test_a_changed_file_is_seen_and_its_place_is_not(keys, tmp_path, role):
    """The content counts."""
    before = keys()
    (tmp_path / "elsewhere.png").write_text("content")
    assert keys(role, path="elsewhere.png") == before
    (tmp_path / MAPS[role]["path"]).write_text("other")
    after = keys()
    assert (after[0] != before[0], after[1] != before[1]) == (role != "albedo", role == "albedo")


def test_what_the_mesh_s_own_file_holds_counts_where_no_map_is_named(keys):
    """`source: file` changes the light by normals and roughness, lobes by the albedo; `vertex_colors` lobes alone."""
    file = {"source": "file"}
    assert keys(taken=file) == keys()  # a map is named for each
    for role, (light, lobes) in {"albedo": (False, True), "normal": (True, False), "roughness": (True, False)}.items():
        before, after = keys(without=[role]), keys(without=[role], taken=file)
        assert (after[0] != before[0], after[1] != before[1]) == (light, lobes)
    before, after = keys(without=["albedo"]), keys(without=["albedo"], taken={"vertex_colors": True})
    assert (after[0] != before[0], after[1] != before[1]) == (False, True)


def test_the_oil_s_maps_count_only_where_they_are_read(keys):
    """Without energy conservation no light depends on roughness."""
    before = keys(energy_conservation="off")
    assert keys("roughness", energy_conservation="off", kind="ggx")[0] == before[0]


def test_who_converts_colours_counts_where_its_names_are_used(keys, tmp_path, monkeypatch):
    """Another OCIO configuration makes what is named after it stale, and nothing else."""
    config = tmp_path / "config.ocio"
    monkeypatch.setenv("OCIO", str(config))
    found = []
    for content in ("one", "two"):
        config.write_text(content)
        found.append((keys(), keys("albedo", color_space="acescg")))
    assert found[0][0] == found[1][0]
    assert found[0][1] != found[1][1]


def test_the_fit_of_maps_in_a_layout_of_its_own_hangs_on_the_layout(tmp_path):
    """Their range is that of the texels that lie on the mesh; without such maps no fit knows of mesh or size."""
    write_obj(tmp_path / "m.obj", quad(240, 200))
    (tmp_path / "r.png").write_text("content")

    def key(size, maps, **texture):
        spec = SceneSpec.model_validate(
            {
                "mesh": {"path": str(tmp_path / "m.obj"), "unit": "mm"},
                "maps": maps,
                "texture": {"size": size} | texture,
                "skin": {"model": "gaussians", "variance_mm2": [1.0], "weight_rgb": [[1.0, 1.0, 1.0]]},
                "lights": [{"name": "key", "type": "directional", "direction": [0, 0, -1], "irradiance": [1, 1, 1]}],
                "output": {"dir": "out"},
            }
        )
        session, log = BakeSession(), StageLog()
        return look_stages(BakeInputs(spec, session, log), MemoryStore(), session, log).profile.key()

    varies = {"radius": str(tmp_path / "r.png")}
    for changed in ({"unwrap": "xatlas"}, {"udim": True}):
        assert key(64, varies, **changed) != key(128, varies, **changed)
        assert key(64, {}, **changed) == key(128, {}, **changed)
    assert key(64, varies) == key(128, varies)
