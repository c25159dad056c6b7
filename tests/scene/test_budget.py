"""The one budget: its parts, and the sum of what is left wrong."""

from __future__ import annotations

from math import hypot, sqrt

import pytest

from skinbake.errors import ConfigError
from skinbake.scene.budget import SKIN_TO_SKIN, budget_of, is_within, left_wrong
from skinbake.scene.decision import Decision
from skinbake.scene.parse import parse
from skinbake.scene.spec import DiffusionSpec, SceneSpec

SUN = {"name": "sun", "type": "directional", "direction": [0, 0, -1], "irradiance": [1, 1, 1]}
SKY = {"name": "sky", "type": "environment", "radiance": [1, 1, 1]}
BOX = {
    "name": "box", "type": "rectangle", "position_mm": [0, 0, 9], "edge_u_mm": [1, 0, 0], "edge_v_mm": [0, -1, 0],
    "radiance": [1, 1, 1],
}  # fmt: skip
FIXED = {"terms": {"beam": "on", "interreflection": "off", "transmission": "off"}}


def look(*lights, **keys):
    """A look at a tolerance of 2 %."""
    mapping = {
        "mesh": {"path": "a.obj", "unit": "mm"},
        "skin": {"model": "gaussians", "variance_mm2": [1.0], "weight_rgb": [[1, 1, 1]]},
        "lights": list(lights) or [SUN, SKY],
        "output": {"dir": "out"},
        "tolerance": 0.02,
    }
    return parse(SceneSpec, mapping | keys, lambda key, text: f"{'.'.join(map(str, key))}: {text}")


def test_a_sky_leaves_room_for_light_from_skin_to_skin():
    """That cannot be had closer than .18 %: where the tolerance is tight a sky's directions leave as much."""
    loose, tight = (budget_of(look(SUN, SKY, tolerance=tolerance)) for tolerance in (0.01, 0.003))
    assert loose.sky_directions == loose.sky
    assert tight.sky_directions < tight.sky
    assert hypot(tight.blur, tight.sky_directions, SKIN_TO_SKIN) == pytest.approx(0.003)


@pytest.mark.parametrize(
    ("spent", "steps"), [(0.0, 0), (0.0025, 0), (0.0027, 1), (0.00285, 3), (0.0029, 3), (0.00295, 0), (0.0031, 0)]
)
def test_the_blur_makes_do_with_what_light_has_left(spent, steps):
    """By steps, lest every look has its own, down to half of its part; not where that is no use."""
    budget = budget_of(look(SUN, SKY, tolerance=0.003))
    given = budget.of_blur(DiffusionSpec(tolerance=0.003), spent).tolerance
    assert given == pytest.approx(budget.blur * 0.8**steps)
    assert hypot(given, spent) <= 0.003 or steps == 0


@pytest.mark.parametrize("lost", [0.0, 0.015])
@pytest.mark.parametrize("lights", [[SUN], [SKY], [BOX], [SUN, SKY, BOX]], ids=["sun", "sky", "box", "all"])
def test_the_parts_of_each_light_fill_the_tolerance(lights, lost):
    """Size, blur, sky and terms, as squares: never more than asked for, and nothing is kept for who is not there."""
    budget = budget_of(look(*lights), lost)
    for light in lights:
        own = budget.sky if light in (SKY, BOX) else 0.0
        parts = lost**2 + budget.blur**2 + own**2 + budget.terms_left(light["name"]) ** 2
        assert sqrt(parts) == pytest.approx(0.02)
    assert budget.terms_left("sun", 1.0) == 0


def test_what_is_given_takes_no_part():
    """With terms and directions given, the blur and the sky are made as the whole tolerance wants them."""
    budget = budget_of(look(SUN, SKY | {"samples": 64}, **FIXED))
    assert budget.blur == budget.sky == pytest.approx(0.02)
    assert budget_of(look(SUN, **FIXED)).blur == pytest.approx(0.02)
    assert budget_of(look(SUN, BOX | {"samples": 64})) == budget_of(look(SUN))


def test_a_given_method_leaves_terms_their_part():
    """Else what they may leave out would be nothing, and light from skin to skin traced as finely as there is."""
    budget = budget_of(look(diffusion={"method": "hybrid"}))
    assert budget == budget_of(look())
    assert budget.terms_left("sun") > budget.terms_left("sky") > 0


def test_light_from_skin_to_skin_has_its_part_where_it_is_switched_on():
    """Else it would be traced as finely as there is: three times the whole bake."""
    on = {"beam": "on", "interreflection": "on", "transmission": "on"}
    assert budget_of(look(SUN, terms=on)) == budget_of(look(SUN))
    assert budget_of(look(SUN, terms=on)).terms_left("sun") > 0


def test_squares_add_up_for_the_light_that_is_worst_off():
    """What all lights share counts for each; what one leaves out is not another's."""
    plan = [
        Decision("texture_size", False, "", 0.03),
        Decision("sun.beam", False, "", 0.04),
        Decision("sky.shadows", True, "", 0.01),
        Decision("sky.interreflection", False, "", 0.02),
    ]
    assert left_wrong(plan, ("sun", "sky"), 0.0) == pytest.approx(0.05)
    assert left_wrong(plan, ("sky",), 0.12) == pytest.approx(hypot(0.12, 0.03, 0.01, 0.02))
    assert left_wrong([*plan, Decision("total.interreflection", True, "", 0.12)], ("sun",), 0.0) == pytest.approx(0.13)
    assert left_wrong([], (), 0.2) == 0.2


def test_what_bake_json_holds_decides():
    """An error that is told as the tolerance is within it."""
    assert is_within(0.02, 0.02)
    assert is_within(0.0200004, 0.02)
    assert not is_within(0.020001, 0.02)


def test_the_tolerance_of_the_look_is_that_of_the_blur_s_section():
    """`tolerance:` is short for `diffusion.tolerance`; both may be given where they say the same."""
    assert look().diffusion.tolerance == 0.02
    assert look().tolerance is None
    assert look(diffusion={"tolerance": 0.02}) == look()
    assert look(diffusion={"probes": 7}).diffusion.tolerance == 0.02
    with pytest.raises(ConfigError, match=r"diffusion: tolerance: expected the same as .* 0\.02, .* got 0\.03"):
        look(diffusion={"tolerance": 0.03})
    with pytest.raises(ConfigError, match=r"tolerance: expected 0\.0001 to 1, .*; got -1"):
        look(tolerance=-1)
    for value in (1e-9, 5, 0):
        with pytest.raises(ConfigError, match=rf"tolerance: expected 0\.0001 to 1, .*; got {value}"):
            look(diffusion={"tolerance": value})
    for end in (1e-4, 1):
        assert look(tolerance=end).diffusion.tolerance == end


@pytest.mark.parametrize(
    ("tolerance", "more", "count", "packing"),
    [
        (0.003, {}, 2000, "auto"),
        (0.01, {}, 1000, "auto"),
        (0.049, {}, 400, "auto"),
        (0.05, {}, 400, "rle"),
        (0.2, {"diffusion": {"probes": 7}, "output": {"dir": "out", "compression": "zip"}}, 7, "zip"),
        (0.2, {"output": {"dir": "out", "precision": "float"}}, 400, "auto"),
    ],
)
def test_a_draft_measures_and_packs_less(tolerance, more, count, packing):
    """Both by its tolerance, unless the look says itself; long floats pack ill by RLE."""
    spec = look(tolerance=tolerance, **more)
    assert (spec.diffusion.probe_count, spec.packing) == (count, packing)


@pytest.mark.parametrize(
    ("tolerance", "skin", "count"),
    [
        (0.05, {"model": "burley", "d_mm": 1.0}, 4),
        (0.049, {"model": "burley", "d_mm": 1.0}, 6),
        (0.05, {"model": "burley", "d_mm": 1.0, "fit": {"gaussians": 7}}, 7),
        (0.05, {"model": "burley", "d_mm": 1.0, "fit": {"signed": True}}, 6),
        (0.05, {"model": "gaussians", "variance_mm2": [1.0], "weight_rgb": [[1, 1, 1]]}, 6),
    ],
)
def test_a_draft_is_fitted_by_fewer_gaussians(tolerance, skin, count):
    """Unless the look says how, or names the Gaussians themselves; what is said of a look is read again as it was."""
    spec = look(tolerance=tolerance, skin=skin)
    assert spec.skin.fit.gaussians == count
    assert SceneSpec.model_validate(spec.model_dump(mode="json")).skin == spec.skin
