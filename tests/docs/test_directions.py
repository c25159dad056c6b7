"""The picture of axes and directions is the one that its script draws, from the directions that the code has."""

from __future__ import annotations

import importlib.util

from tests.conftest import ROOT


def test_the_drawing_is_that_of_its_script():
    """`python data/draw_directions.py` renews it."""
    spec = importlib.util.spec_from_file_location("draw_directions", ROOT / "data" / "draw_directions.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    assert (ROOT / "skinbake" / "docs" / "directions.svg").read_text(encoding="utf-8") == script.drawing()
