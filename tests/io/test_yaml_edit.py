"""Values of a YAML file change, and nothing else in it."""

import pytest

from skinbake.errors import InputError
from skinbake.io.yaml_edit import edit_yaml, edit_yaml_file
from skinbake.io.yaml_lines import read_yaml

TEXT = """\
# a look
mesh: {path: "head.obj", unit: mm}   # millimetres
lights:
  # the sun
  - {name: key, type: directional,   irradiance: [3.2, 3.0, 2.75]}  # warm
  - name: rim      # cold
    irradiance:
      - 1.0
      - 1.15       # green
      - 1.4
    type: directional

output: {dir: out}
"""


def test_a_value_changes_and_comments_stay():
    """In flow and in block style; the text is the same but for the values."""
    changes = {("lights", 0, "irradiance"): [1.0, 2.5, 1e-7], ("lights", 1, "irradiance"): [2.0, 2, 2]}
    changed = edit_yaml(TEXT, changes)
    assert "irradiance: [1, 2.5, 1.0e-7]}  # warm" in changed
    assert changed.replace("[1, 2.5, 1.0e-7]", "[3.2, 3.0, 2.75]") == TEXT.replace(
        "\n      - 1.0\n      - 1.15       # green\n      - 1.4", "\n      [2, 2, 2]"
    )


def test_a_key_that_is_not_there_is_added():
    """To a flow mapping, a block mapping, and the file."""
    changed = edit_yaml(
        TEXT,
        {("preview",): {"view": "nose", "camera": None}, ("output", "seed"): 3, ("lights", 1, "shadows"): "false"},
    )
    assert changed.endswith("output: {dir: out, seed: 3}\npreview: {view: nose, camera: null}\n")
    assert "  - shadows: false\n    name: rim      # cold\n" in changed
    assert edit_yaml("{}", {("a",): 1.5}) == "{a: 1.5}"
    assert edit_yaml("a: 1", {("b",): 1}) == "a: 1\nb: 1\n"
    assert edit_yaml("---\na: 1\n...\n", {("b",): 1}) == "---\nb: 1\na: 1\n...\n"


def test_what_stands_elsewhere_too_is_not_changed():
    """An alias, a path that leads nowhere: refused by name."""
    text = "a: &red [1, 0, 0]\nb: *red\n"
    for key in (("a",), ("b",)):
        with pytest.raises(InputError, match=r"look: [ab]: cannot be changed, for an alias stands there"):
            edit_yaml(text, {key: 1}, "look")
    with pytest.raises(InputError, match=r"look: a\[7\]: expected it in the file, found none"):
        edit_yaml("a: [1]", {("a", 7): 1}, "look")


def test_a_file_keeps_its_line_ends(tmp_path):
    """And reads as what was asked for."""
    path = tmp_path / "look.yaml"
    path.write_bytes(b"a: 1  # one\r\nb: {c: 2}\r\n")
    edit_yaml_file(path, {("a",): -0.25, ("b", "c"): [1e30, 5.0]})
    assert path.read_bytes() == b"a: -0.25  # one\r\nb: {c: [1.0e+30, 5]}\r\n"
    assert read_yaml(path).value == {"a": -0.25, "b": {"c": [1e30, 5]}}
    with pytest.raises(InputError, match="cannot be read"):
        edit_yaml_file(tmp_path / "none.yaml", {("a",): 1})
