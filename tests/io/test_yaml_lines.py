import time

import pytest

from skinbake.errors import ConfigError
from skinbake.io.config import load_look
from skinbake.io.yaml_lines import MOST_BYTES, parse_value, parse_yaml, read_yaml

LOOK = """\
mesh: {path: head.obj, unit: mm}
skin: {model: burley, d_mm: [1, 1, 1]}
lights: [{name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}]
output: {dir: out}
"""


def many(count):
    """Anchors that each stand for ten of the one before, `count` times over."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, count)]
    return "\n".join(lines) + "\n"


def merged(count):
    """The same through merge keys, which are written out as the mapping is built."""
    lines = ["a0: &a0 {x: 1}"]
    lines += [f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 10)}]}}" for i in range(1, count)]
    return "\n".join(lines) + "\n"


def light(i):
    return f"  - {{name: l{i}, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}}\n"


BOMBS = {
    "aliases": (many(9), "look.yaml:1: expected at most 50,000 keys and values, got 1,234,567,9"),
    "merge keys": (merged(9), "look.yaml:1: expected at most 50,000 keys and values, got "),
    "unknown keys": (
        "".join(f"k{i}: 1\n" for i in range(100_000)),
        "look.yaml:24986: expected at most 50,000 keys and values, got more",
    ),
    "bytes": (
        "#" * MOST_BYTES,
        f"look.yaml:1: expected at most 1,048,576 bytes of configuration, got {2**20 + len(LOOK):,}",
    ),
    "depth": ("a: " + "[" * 900 + "]" * 900, "look.yaml:5: expected at most 60 levels, got more"),
    "depth by aliases": (
        "a0: &a0 [x]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}]\n" for i in range(1, 200)),
        "look.yaml:1: expected at most 60 levels, got 201, aliases written out",
    ),
}


@pytest.mark.parametrize("kind", BOMBS)
def test_more_than_a_configuration_holds_is_refused_at_once(tmp_path, kind):
    """By its number and the limit, before it takes memory: a kilobyte of aliases stands for 10^9 values."""
    text, message = BOMBS[kind]
    path = tmp_path / "look.yaml"
    path.write_text(LOOK + text)
    begun = time.process_time()
    with pytest.raises(ConfigError) as caught:
        load_look(path)
    assert time.process_time() - begun < 3
    assert str(caught.value).replace(f"{tmp_path}/", "").startswith(message)


def test_aliases_within_reason_stand_for_what_they_name():
    """A thousand values written as three lines are a thousand values."""
    found = parse_yaml(many(3), "look.yaml")
    assert found.value["a2"] == [[["x"] * 10] * 10] * 10
    assert found.place(("a2", 9, 9, 9)) == "look.yaml:1"


def test_an_override_is_held_to_the_same_limits():
    """`--set` takes aliases too, and duplicate keys, tags and broken YAML are told of it."""
    bomb = (
        "[" + ", ".join(["&a0 [x, x, x, x]", *(f"&a{i} [*a{i - 1}, *a{i - 1}, *a{i - 1}]" for i in range(1, 20))]) + "]"
    )
    for text, message in (
        (bomb, "--set lights: expected at most 50,000 keys and values, got "),
        ("{a: 1, a: 2}", "--set lights: a: key stands twice"),
        ("!!binary aGVsbG8=", "--set lights: expected plain YAML, got the tag tag:yaml.org,2002:binary"),
        ("[1, 2", "--set lights: expected YAML, got: did not find expected"),
    ):
        with pytest.raises(ConfigError) as caught:
            parse_value(text, "--set lights")
        assert str(caught.value).startswith(message)
    assert parse_value("", "--set lights") is None
    assert parse_value("1e-3", "--set lights") == "1e-3"  # YAML 1.1; the schema takes it for a number


@pytest.mark.parametrize("count", [1025, 2000])
def test_lights_without_number_are_refused(tmp_path, count):
    """A part a light is what an EXR can hold and a person can name."""
    lines = LOOK.splitlines(keepends=True)
    (tmp_path / "look.yaml").write_text(
        lines[0] + lines[1] + "lights:\n" + "".join(map(light, range(count))) + lines[3]
    )
    with pytest.raises(ConfigError, match=rf"look.yaml:3: lights: expected a list of at most 1024, got {count}$"):
        load_look(tmp_path / "look.yaml", files=False)


def test_the_first_faults_of_many_are_told(tmp_path):
    """Twenty lines, then how many more there are: in a second, not a suggestion for each."""
    (tmp_path / "look.yaml").write_text(LOOK + "".join(f"k{i}: 1\n" for i in range(20_000)))
    begun = time.process_time()
    with pytest.raises(ConfigError) as caught:
        load_look(tmp_path / "look.yaml", files=False)
    assert time.process_time() - begun < 5
    lines = str(caught.value).splitlines()
    assert lines[19].startswith(f"{tmp_path}/look.yaml:24: k19: unknown key; expected one of mesh, ")
    assert lines[20:] == ["... and 19,980 more faults"]


def test_a_fault_is_no_longer_than_a_person_reads(tmp_path):
    """A key of a hundred thousand letters is told by its beginning."""
    (tmp_path / "look.yaml").write_text(LOOK + "? " + "k" * 100_000 + "\n: 1\n")
    with pytest.raises(ConfigError) as caught:
        load_look(tmp_path / "look.yaml", files=False)
    assert len(str(caught.value)) < 1100


def test_all_keys_that_stand_twice_are_told(tmp_path):
    """Not the first alone, and with foreign tags in the same list."""
    (tmp_path / "look.yaml").write_text("a: 1\na: 2\nb: {c: 1,\n  c: 2}\nd: !!set {x}\n")
    with pytest.raises(ConfigError) as caught:
        read_yaml(tmp_path / "look.yaml")
    assert [fault.split("look.yaml:")[1] for fault in caught.value.faults] == [
        "2: a: key stands twice",
        "4: b.c: key stands twice",
        "5: d: expected plain YAML, got the tag tag:yaml.org,2002:set",
    ]


def test_an_override_is_no_comment():
    """YAML would drop it without a word: a map that is not read, a time that does not change."""
    for text in ("####.png", "####", "5 # five", "[1, 2] # two"):
        with pytest.raises(ConfigError, match="--set x: expected a value, got a comment: quote what begins with #"):
            parse_value(text, "--set x")
    assert parse_value('"####.png"', "--set x") == "####.png"
    assert parse_value("'# a'", "--set x") == "# a"
    assert parse_value("a#b.png", "--set x") == "a#b.png"
    assert parse_value("head.####.obj", "--set x") == "head.####.obj"


@pytest.mark.parametrize(
    ("text", "got"), [("0010", 8), ("[1, -0_12]", -10), ("1:30", 90), ("{a: 1:30.5}", 90.5), ("&a {b: 010}", 8)]
)
def test_numbers_that_yaml_takes_for_others_are_refused(text, got):
    """Octal and of base 60 in YAML 1.1, decimal or text to people and to editors."""
    with pytest.raises(ConfigError, match=rf"expected a plain number, got \S+, which YAML takes for {got}; write it"):
        parse_yaml(f"x: {text}\n", "look.yaml")
    with pytest.raises(ConfigError, match="expected a plain number"):
        parse_value(text, "--set x")


def test_numbers_that_all_read_alike_are_read():
    """Zeros that change nothing, hexadecimal and underscores."""
    text = "[0, 00, 007, 0.50, 08.5, 0x80, 1_000, 1e3, '0010', 10:30:a]"
    wanted = [0, 0, 7, 0.5, 8.5, 128, 1000, "1e3", "0010", "10:30:a"]
    assert parse_yaml(f"x: {text}", "look.yaml").value["x"] == wanted


def test_keys_are_text_as_written():
    """`on`, 1024 and 0010 are names there."""
    assert parse_yaml("{on: 1, 0010: 2, 1024: {~: 3}}", "look.yaml").value == {"on": 1, "0010": 2, "1024": {"~": 3}}


def test_what_is_merged_is_looked_through():
    """Keys that stand twice in it, and foreign tags; what goes before it keeps its line."""
    for text, message in (
        ("{<<: {b: 1, b: 2}}", "look.yaml:1: a.b: key stands twice"),
        ("{<<: [{b: 1}, {b: !!binary aa}]}", "look.yaml:1: a[1].b: expected plain YAML, got the tag "),
        ("{<<: {? [1] : 2}}", "look.yaml:1: expected a plain key, got sequence"),
        ("{<<: {b: 1}, <<: {b: 2}}", "look.yaml:1: a.<<: key stands twice"),
        ("{<<: 3}", "look.yaml:1: expected YAML, got: expected a mapping or list of mappings for merging"),
    ):
        with pytest.raises(ConfigError) as caught:
            parse_yaml(f"a: {text}", "look.yaml")
        assert str(caught.value).startswith(message)
    found = parse_yaml("a: &a {b: 1}\nc:\n  b: 2\n  <<: *a\n", "look.yaml")
    assert found.value["c"] == {"b": 2}
    assert found.place(("c", "b")) == "look.yaml:3"


def test_what_an_alias_stands_for_is_a_copy():
    """A batch that set one of them by a dotted key had set the other, too."""
    text = "{a: &a {b: [1]}, c: *a}"
    for value in (parse_yaml(text, "look.yaml").value, parse_value(text, "--set x")):
        value["a"]["b"][0] = 2
        assert value["c"] == {"b": [1]}


def test_the_first_of_several_that_are_merged_goes_before_later_ones():
    """As YAML has it; PyYAML 6.0.4 lets the last one win where a key is longer than a letter."""
    text = "a: &a {size: 1}\nb: &b {<<: *a, gutter: 2}\nc: {<<: [*b, {size: 3, gutter: 4, on: 5}], tx: 6}\nd: *b\n"
    found = parse_yaml(text, "look.yaml")
    assert found.value["b"] == found.value["d"] == {"size": 1, "gutter": 2}
    assert found.value["c"] == {"size": 1, "gutter": 2, "on": 5, "tx": 6}
