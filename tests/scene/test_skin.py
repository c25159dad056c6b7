import math

import pytest
from pydantic import BaseModel

from skinbake.errors import ConfigError
from skinbake.scene.parse import parse
from skinbake.scene.skin import FitSpec, SkinSpec

LAYER = {"sigma_a_per_mm": [0.2, 0.2, 0.5], "sigma_sp_per_mm": [5, 6, 7], "thickness_mm": 0.25}
BOTTOM = {"sigma_a_per_mm": 0.1, "sigma_sp_per_mm": 1, "thickness_mm": math.inf, "eta": 1.33, "g": 0.8}


def skin(**keys):
    return parse(SkinSpec, keys, lambda key, sentence: f"{'.'.join(map(str, key))}: {sentence}")


@pytest.mark.parametrize(
    ("model", "keys"),
    [
        ("multipole", {"layers": [LAYER, BOTTOM]}),
        ("dipole", {"sigma_a_per_mm": 0.1, "sigma_sp_per_mm": [1, 2, 3]}),
        ("burley", {"d_mm": 0.5}),
        ("burley", {"mean_free_path_mm": [1, 2, 3], "albedo_rgb": [0.8, 0.5, 0.3]}),
        ("gaussians", {"variance_mm2": [1, 2], "weight_rgb": [[0.5, 0.5, 0.5], [0.5, 0.5, 0.5]]}),
        ("table", {"path": "profile.csv"}),
        ("physiology", {"melanin": 0.02}),
    ],
)
def test_keys_tell_the_model(model, keys):
    """A skin without `model` is recognised by its keys, and the same with it."""
    assert skin(**keys) == skin(model=model, **keys)
    assert skin(**keys).model == model
    assert skin(**keys).normalise == "white"
    assert skin(**keys).fit == FitSpec(gaussians=6)


def test_a_dipoles_keys_suit_the_layered_models():
    """Coefficients beside model: transport are one semi-infinite layer, so presets can change their model."""
    keys = {"sigma_a_per_mm": [1, 2, 3], "sigma_sp_per_mm": [4, 5, 6], "eta": 1.3}
    for model in ("transport", "multipole"):
        (layer,) = skin(model=model, **keys).layers
        assert layer.sigma_sp_per_mm == (4, 5, 6)
        assert math.isinf(layer.thickness_mm)
        assert layer.eta == 1.3


def test_one_number_stands_for_three():
    """A scalar coefficient holds for red, green and blue."""
    assert skin(layers=[BOTTOM]).layers[0].sigma_a_per_mm == (0.1, 0.1, 0.1)


def test_fit():
    """Six Gaussians unless said otherwise; a tolerance stands alone."""
    assert skin(d_mm=1, fit={"signed": True}).fit == FitSpec(gaussians=6, signed=True)
    assert skin(d_mm=1, fit={"tolerance": 0.01}).fit.gaussians is None


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({}, "expected a preset, or a model"),
        ({"d_mm": 1, "layers": [BOTTOM]}, "expected a preset, or a model"),
        ({"model": "dipol"}, "did you mean dipole?"),
        ({"layers": [LAYER | {"eta": 0.7}]}, "layers.0.eta: expected a number >= 1, got 0.7"),
        ({"layers": [LAYER | {"eta": 4}]}, "layers.0.eta: expected a number <= 3, got 4"),
        ({"layers": [LAYER | {"thickness_mm": -1}]}, "layers.0.thickness_mm: expected a number >= 0, got -1"),
        ({"layers": [LAYER | {"thickness_mm": math.nan}]}, "layers.0.thickness_mm: expected"),
        ({"layers": [LAYER | {"g": 1}]}, "layers.0.g: expected a number < 1, got 1"),
        (
            {"layers": [LAYER | {"sigma_a_per_mm": [1, math.inf, 1]}]},
            "layers.0.sigma_a_per_mm.1: expected a finite number",
        ),
        (
            {"layers": [LAYER | {"sigma_a_per_mm": [1, -2, 1]}]},
            "layers.0.sigma_a_per_mm.1: expected a number >= 0, got -2",
        ),
        ({"layers": [LAYER | {"sigma_a_per_mm": 0, "sigma_sp_per_mm": 0}]}, "both are 0"),
        (
            {"layers": [LAYER | {"sigma_a_per_cm": 1}]},
            "layers.0.sigma_a_per_cm: unknown key; did you mean sigma_a_per_mm?",
        ),
        ({"layers": [BOTTOM, LAYER]}, "finite thickness_mm in every layer but the last"),
        ({"layers": [LAYER | {"thickness_mm": 0}]}, "at least one layer with thickness_mm > 0"),
        ({"layers": []}, "layers"),
        ({"sigma_a_per_mm": [0, 1, 1], "sigma_sp_per_mm": [0, 1, 1]}, "both are 0"),
        ({"d_mm": 0}, "d_mm: expected a number > 0, got 0"),
        ({"d_mm": 1, "mean_free_path_mm": 1}, "exactly one of d_mm and mean_free_path_mm"),
        ({"mean_free_path_mm": 1}, "expected albedo_rgb beside it"),
        ({"variance_mm2": [1], "weight_rgb": [[1, 1, 1], [1, 1, 1]]}, "one row of weight_rgb for each variance_mm2"),
        ({"variance_mm2": [-1], "weight_rgb": [[1, 1, 1]]}, "variance_mm2.0: expected a number >= 0, got -1"),
        ({"model": "transport", "layers": [BOTTOM], "photons": 0}, "photons: expected a number >= 1, got 0"),
        ({"melanin": 0.6}, "melanin: expected a number <= 0.5, got 0.6"),
        (
            {"d_mm": 1, "fit": {"gaussians": 6, "tolerance": 0.1}},
            "fit: expected either gaussians or tolerance, got both",
        ),
        ({"d_mm": 1, "fit": {"gaussians": 13}}, "fit.gaussians: expected a number <= 12, got 13"),
        ({"d_mm": 1, "fit": {"tolerance": 0}}, "fit.tolerance: expected a number > 0, got 0"),
        ({"d_mm": 1, "normalise": "grey"}, "normalise"),
    ],
)
def test_faults_name_the_key_and_what_was_expected(keys, message):
    """Every fault is one line with the key, the expectation and the value."""
    with pytest.raises(ConfigError) as caught:
        skin(**keys)
    assert message in str(caught.value)


def test_is_a_field_type_and_frozen():
    """SkinSpec serves as a field of another model, and a parsed skin cannot change."""

    class Look(BaseModel):
        skin: SkinSpec

    parsed = Look(skin={"d_mm": 1}).skin
    with pytest.raises(ValueError, match="frozen"):
        parsed.model = "dipole"
