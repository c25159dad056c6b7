"""Advice names a knob that would help."""

import pytest

from skinbake.diffuse.diffuse_map import MeasuredError
from skinbake.diffuse.notices import advice
from skinbake.scene.spec import DiffusionSpec


@pytest.mark.parametrize("precision", ["half", "float"])
def test_advice_does_not_name_the_precision_that_is_set(precision):
    """Nor does a tolerance of a millionth look like none."""
    text = advice(
        DiffusionSpec().model_copy(update={"tolerance": 1e-6}),
        MeasuredError(0.01, 0.02, 0.05, 9, 0.001, 0.0099),
        precision,
    )
    assert "storage is the larger part; raise texture.size" in text
    assert ("output.precision" in text) == (precision == "half")
    assert "rms 1% is above the blur's 0.0001% of the tolerance" in text
