"""A skin is fitted once: another folder's bake takes the fit, its table and its plot from the user's cache."""

import pytest

from skinbake.baking import inputs, kept_fit
from skinbake.cli import run
from skinbake.io.cache import Cache
from skinbake.io.mesh import write_obj
from skinbake.io.output_names import FIT_FILES
from tests.shapes import sphere

LOOK = """\
mesh: {path: mesh.obj, unit: mm, any_size: true}
texture: {size: 32, gutter: 2}
skin: {model: dipole, sigma_a_per_mm: [0.03, 0.2, 0.5], sigma_sp_per_mm: [0.7, 0.9, 1.0], fit: {gaussians: 2}}
lights:
  - {name: key, type: directional, direction: [0, 0, -1], irradiance: [1, 1, 1]}
terms: {incidence: off, transmission: off, interreflection: off}
diffusion: {probes: 0}
"""


@pytest.fixture
def bake(tmp_path, monkeypatch):
    """Bake into a folder of a name; the files of the fit, and how many fits were made so far."""
    write_obj(tmp_path / "mesh.obj", sphere(30.0, "latlong", 8))
    (tmp_path / "me.yaml").write_text(LOOK)
    monkeypatch.setattr(kept_fit, "user_cache", lambda: Cache(tmp_path / "cache"))
    made, fit = [], inputs.fit_skin
    monkeypatch.setattr(inputs, "fit_skin", lambda *args, **options: made.append(0) or fit(*args, **options))

    def into(name, *more):
        asked = ["bake", str(tmp_path / "me.yaml"), "--out", str(tmp_path / name), "--no-preview", "--quiet", *more]
        assert run(asked) == 0
        return [(tmp_path / name / file).read_bytes() for file in FIT_FILES], len(made)

    return into


def test_another_folder_has_the_same_fit_and_makes_none(bake):
    first, once = bake("one")
    second, still = bake("two", "--force")
    assert (first, once, still) == (second, 1, 1)


def test_another_skin_is_fitted(bake):
    bake("one")
    assert bake("two", "--set", "skin.fit.gaussians=1")[1] == 2


def test_a_damaged_entry_is_fitted_again(bake, tmp_path):
    first, _ = bake("one")
    for entry in (tmp_path / "cache").rglob("*.npz"):
        entry.write_bytes(entry.read_bytes()[:-40])
    assert bake("two") == (first, 2)
