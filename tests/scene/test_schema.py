"""The schema knows every key, says something of each, and agrees with what the validation takes and refuses."""

from __future__ import annotations

import json

import jsonschema
import pytest

from skinbake.cli import run
from skinbake.diffuse.methods import METHODS
from skinbake.errors import ConfigError
from skinbake.io.config import parse_scene
from skinbake.io.yaml_lines import read_yaml
from skinbake.scene.schema import _models, key_docs, look_schema, reference_page
from tests.conftest import ROOT

NAMES = [method.name for method in METHODS.values() if method.asked_for]
LOOK = {
    "mesh": {"path": "me.obj", "unit": "mm"},
    "skin": {"model": "dipole", "sigma_a_per_mm": 0.1, "sigma_sp_per_mm": [1, 1, 1]},
    "lights": [{"name": "sun", "type": "directional", "direction": [0, 0, -1], "irradiance": [1, 1, 1]}],
    "output": {"dir": "out"},
}


def test_every_key_has_a_sentence():
    """Of its own or of the class it stands in: one sentence or more, ended."""
    seen = 0
    for model in _models():
        for key, text in key_docs(model).items():
            assert text.rstrip("`)").endswith((".", "]")), (model.__name__, key, text)
            seen += 1
    assert seen > 120


def test_the_reference_is_the_one_that_the_schema_gives(capsys):
    """`skinbake schema --reference > skinbake/docs/reference.md` renews it."""
    assert (ROOT / "skinbake" / "docs" / "reference.md").read_text() == reference_page(NAMES)
    assert run(["schema", "--reference"]) == 0
    assert capsys.readouterr().out == reference_page(NAMES)


def test_the_verb_prints_the_schema(capsys):
    """As JSON, valid as a schema."""
    assert run(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema == look_schema(NAMES)
    jsonschema.Draft202012Validator.check_schema(schema)


@pytest.mark.parametrize("name", ["head.yaml", "head_plain.yaml", "lee_perry_smith.yaml"])
def test_shipped_looks_keep_to_it(name):
    """As they are written, with presets and shorthands."""
    jsonschema.validate(read_yaml(ROOT / "configs" / name).value, look_schema(NAMES))


SHORT = [
    {"relight": {}, "lights": []},
    {"maps": "file"},
    {
        "maps": {
            "albedo": "a.png",
            "normal": "n.png",
            "roughness": "r.png",
            "specular": {"path": "s.png", "channel": "g"},
        }
    },
    {"texture": {"size": 512, "reduce": False}},
    {"texture": {"size": [512, 256], "udim": True}},
    {"terms": {"incidence": False, "beam": "on"}},
    {"mesh": {"path": "me.glb", "unit": "file", "skin": "Head*", "opacity": "hair.png"}},
    {"maps": {"detail": {"path": "d.png", "repeat": 20}}},
    {"skin": {"model": "burley", "d_mm": 1.0}},
    {"frames": "1-24"},
    {"skin": {"model": "burley", "mean_free_path_mm": 1, "albedo_rgb": 0.5}},
]
WRONG = [
    {"meshes": {}},
    {"texture": {"size": "large"}},
    {"texture": {"sise": 512}},
    {"diffusion": {"tolerance": -1}},
    {"lights": [{"name": "sun", "type": "sun"}]},
    {"lights": []},
    {"texture": {"size": 0}},
    {"texture": {"size": 100000}},
    {"maps": {"detail": {"path": "d.png", "repeat": 0}}},
    {"skin": {"model": "burley", "d_mm": -1}},
    {"diffusion": {"method": "textur"}},
    {"output": {"dir": "out", "precision": "double"}},
]


@pytest.mark.parametrize("change", SHORT, ids=str)
def test_what_may_be_written_shorter_may_be_so_in_an_editor(change):
    """The validation understands it, and so does the schema."""
    parse_scene(LOOK | change, lambda key, text: f"{key}: {text}")
    jsonschema.validate(LOOK | change, look_schema(NAMES))


@pytest.mark.parametrize("change", WRONG, ids=str)
def test_slips_are_found_by_both(change):
    """Unknown keys, wrong kinds, values out of range."""
    with pytest.raises(ConfigError):
        parse_scene(LOOK | change, lambda key, text: f"{key}: {text}")
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(LOOK | change, look_schema(NAMES))
