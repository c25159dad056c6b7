"""What is decided before textures are made."""

from __future__ import annotations

import importlib
import re

import numpy as np
import pytest

import skinbake
from skinbake.diffuse import add_bounces
from skinbake.diffuse.terms.thin_parts import FEW_MM, TEXEL_MM
from skinbake.errors import MachineError
from skinbake.irradiance import sky_points
from skinbake.irradiance.occluder import Occluder
from skinbake.irradiance.sky_directions import DIRECTIONS, sky_directions
from skinbake.relight import open_sky as open_sky_module
from skinbake.relight import scattering, transfer

light_texels = importlib.import_module("skinbake.irradiance.light_texels")  # the package has its function
SUNS = {"suns": [((0.3, -0.2, -0.9), (1.0, 2.0, 3.0)), ((-0.5, 0.5, 0.1), (1.0, 1.0, 1.0))]}
LEFT = (("interreflection", r"worth it from ([\d.]+)%"), ("transmission", r"\(rms ([\d.]+)%\)$"))


def test_textures_have_the_look_s_proportions(baked):
    """1024 texels on the longer side, or as many as the look's texture has, or as the look says."""
    look = baked.folder / "look.yaml"

    def size(*changes):
        return transfer.transfer_size(skinbake.load_look(look, list(changes)))

    assert size() == (60, 48)
    assert size("texture.size=[4096, 2048]") == (1024, 512)
    assert size("texture.size=[2048, 4096]", "relight.size=2000") == (1000, 2000)


def test_what_does_not_fit_is_refused(baked, monkeypatch):
    """With what it needs and what to change."""
    monkeypatch.setattr(transfer, "physical_memory_bytes", lambda: 2**20)
    with pytest.raises(MachineError, match=r"lower relight\.size or relight\.textures"):
        baked("relight.textures=9")


def test_terms_are_prepared_once_and_share_the_tolerance(baked, monkeypatch):
    """Skin looks around once for any number of lights, through thin parts, too; bounces leave these a part."""
    calls = []
    once = scattering.ThinParts.of

    def of(skin, texel_mm=TEXEL_MM):
        calls.append(texel_mm)
        return once(skin, texel_mm)

    monkeypatch.setattr(scattering.ThinParts, "of", of)
    looks, look = [], transfer.seen_skin
    monkeypatch.setattr(transfer, "seen_skin", lambda *args: looks.append(args) or look(*args))
    monkeypatch.setattr(add_bounces, "look_around", lambda *_: pytest.fail("each bake that judges looks around"))
    made = baked("terms.transmission=auto", "terms.interreflection=auto", "diffusion.method=auto", "relight.textures=9")
    assert len(made.plan) > 3
    why = {line.term: line.why for line in made.plan}
    left = [float(re.search(pattern, why[f"relight.{term}"])[1]) for term, pattern in LEFT]
    assert 0 < left[0] < left[1] * 1.0001 < left[0] * 2**0.5  # bounces had half of the square, and leave some of it
    assert "relight.interreflection" in {line.term for line in made.plan if line.enabled}
    assert len(looks) == 1
    # Few texels first; all of them for the textures, and once more for all lights that judge these
    through = "relight.transmission" in {line.term for line in made.plan if line.enabled}
    assert calls == [FEW_MM, *[TEXEL_MM] * 2 * through]


def test_skies_that_judge_trace_nothing_for_their_plans(baked, monkeypatch):
    """They say how many directions they take: the rays that plan a look's own sky are never asked for."""
    planned, plan = [], light_texels.plan_environment
    monkeypatch.setattr(light_texels, "plan_environment", lambda light, *of: planned.append(light) or plan(light, *of))
    monkeypatch.setattr(sky_points, "scattered_origins", lambda *_: pytest.fail("a sky's plan traces rays of its own"))
    baked("relight.textures=4", "terms.energy_conservation=off")
    assert [light.name for light in planned] == ["sky-0", "soft-box-0", "sky-0-again", "soft-box-0-again"]


@pytest.mark.parametrize("mesh", ["mesh.obj", "tiles.obj"])
def test_what_the_plan_of_a_sky_traces_is_traced_once(baked, monkeypatch, mesh):
    """A look with a sky and textures traces what either alone does, less the rays of the plan; and bakes the same."""
    asked, unhindered = [], Occluder.unhindered
    monkeypatch.setattr(
        Occluder, "unhindered", lambda self, *rays: asked.append(len(rays[0])) or unhindered(self, *rays)
    )
    texels, once = [], open_sky_module.open_sky
    monkeypatch.setattr(transfer, "open_sky", lambda spec, scene, of: texels.append(of) or once(spec, scene, of))
    lights = "lights=[{name: sky, type: environment, radiance: [1, 0.9, 0.8], shadows: true}]"
    size = "[40, 48]" if mesh == "tiles.obj" else "[60, 48]"
    more = (f"mesh.path={baked.folder / mesh}", "texture.udim=true", f"texture.size={size}", "relight.textures=4",
            "specular.strength=0.1")  # fmt: skip
    both, traced = baked(*more, lights), {"both": sum(asked)}
    for name, changes in {"sky": (*more, lights, "relight=null"), "relight": more}.items():
        asked.clear()
        made = baked(*changes)
        traced[name] = sum(asked)
        for tile in made.tiles:
            if name == "sky":
                assert made.radiant_exitance(tile=tile).tobytes() == both.radiant_exitance(tile=tile).tobytes()
                assert made.irradiance("sky", tile=tile).tobytes() == both.irradiance("sky", tile=tile).tobytes()
            else:
                assert made.relight(tile=tile, **SUNS).tobytes() == both.relight(tile=tile, **SUNS).tobytes()
    assert any(line.term == "sky.shadows" and line.enabled for line in both.plan)
    of_plan = np.concatenate([each.normal for each in texels[0].seen.values()])
    facing = np.count_nonzero(np.einsum("ni,di->nd", of_plan, sky_directions()) > 0)
    assert traced["sky"] + traced["relight"] - traced["both"] == facing
    assert facing > 100 * DIRECTIONS


def test_each_light_s_memory_goes_back_once_its_texture_is_made(baked, monkeypatch):
    """Irradiance of all lights is the most that a transfer holds: no part of it outlasts its use."""
    let, once = [], transfer.let_go
    monkeypatch.setattr(transfer, "let_go", lambda images: let.append(len(images)) or once(images))
    made = baked("relight.textures=9", "terms.energy_conservation=off")
    assert _textures(made) == 9
    assert sum(let) == 2 * (9 + 1)  # with even light, at the textures' size and at the judging one


@pytest.mark.parametrize(("of_look", "of_relight", "said"), [(0.01, 0.02, "10.0%"), (0.05, 0.02, "25.0%")])
def test_light_through_thin_parts_goes_by_the_larger_tolerance(baked, of_look, of_relight, said):
    changes = f"diffusion.tolerance={of_look}", f"relight.tolerance={of_relight}", "relight.textures=4"
    made = baked("terms.transmission=auto", "diffusion.method=auto", *changes)
    (line,) = [line for line in made.plan if line.term == "relight.transmission"]
    assert f"worth it from {said}" in line.why


@pytest.mark.parametrize(("basis", "textures"), [("fitted", 6), ("harmonics", 4)])
def test_as_many_textures_as_asked_for(baked, basis, textures):
    """Though fewer keep the tolerance, which one or four do; harmonics go by whole orders."""
    changes = f"relight.basis={basis}", "relight.textures=6", "relight.tolerance=0.9"
    assert _textures(baked(*changes)) <= 4
    assert _textures(baked(*changes, "relight.fewer=false")) == textures


def _textures(made):
    """How many textures a bake has, by the plan's line on the basis."""
    (line,) = [line for line in made.plan if line.term in ("relight.fitted", "relight.harmonics")]
    return int(re.search(r"(\d+) (fitted|harmonics)", line.why)[1])
