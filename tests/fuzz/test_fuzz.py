"""Damaged files are refused with a message or read into what was promised; inputs that once were neither stay here."""

from pathlib import Path
from random import Random

import pytest

from tests.fuzz.targets import TARGETS, survives

CORPUS = sorted((Path(__file__).parent / "corpus").iterdir())
INPUTS = {"look": 60, "overrides": 60, "batch": 20}


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.name)
def test_what_fuzzing_found_stays_mended(path, tmp_path):
    """Named after its target; `python -m tests.fuzz` found it."""
    survives(TARGETS[path.name.split("-")[0]], path.suffix, path.read_bytes(), tmp_path)


@pytest.mark.parametrize("name", TARGETS)
def test_seeds_are_read(name, tmp_path):
    """Fuzzing means something only where undamaged files get through; looks name files that are not there."""
    target = TARGETS[name]
    found = [survives(target, suffix, content, _new(tmp_path, i)) for i, (suffix, content) in enumerate(target.seeds())]
    assert set(found) == {"read"} or (name in ("batch", "look") and "read" in found)


@pytest.mark.parametrize("name", TARGETS)
def test_a_little_damage(name, tmp_path, monkeypatch):
    """The same few hundred inputs each time; hours of others are run by hand."""
    target, rng = TARGETS[name], Random(20)
    seeds = target.seeds()
    for i in range(INPUTS.get(name, 200)):
        folder = _new(tmp_path, i)
        monkeypatch.chdir(folder)
        survives(target, *target.damage(seeds, rng), folder)


def _new(folder, i):
    folder = folder / str(i)
    folder.mkdir()
    return folder
