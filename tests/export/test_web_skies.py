"""Skies in the page of a bake with `relight`: what `preview --environment` shows of the light from inside the skin."""

from __future__ import annotations

import json
import re

import pytest

from skinbake.cli import run
from skinbake.export.web import NAME
from skinbake.io.bake_folder import read_bake_folder, read_relit_folder
from skinbake.page import bake_page, page_skies
from skinbake.preview.relit import LaterLight
from skinbake.preview.setup_gl import renderer_name
from skinbake.preview.shader_light import shader_lights
from skinbake.relight import transfer
from skinbake.relight.skies import made_sky
from tests.export.browser import Browser
from tests.export.test_web import compare_scene
from tests.relight.conftest import few_lights

pytestmark = pytest.mark.slow  # processes, and a bake


@pytest.fixture(scope="module")
def relit(bake, tmp_path_factory):
    """Folder of a bake of the ball, the oil's share kept back, with textures of a fitted basis."""
    folder = tmp_path_factory.mktemp("relit")
    sets = ["relight={textures: 9, basis: fitted}", "terms={energy_conservation: on, transmission: on}"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(transfer, "unseen_lights", few_lights)
        verb = ["bake", str(bake.parent / "me.yaml"), "--out", str(folder / "out"), "--no-preview", "--quiet"]
        assert run([*verb, *(word for each in sets for word in ("--set", each))]) == 0
    return folder / "out"


@pytest.fixture(scope="module")
def browser(relit, tmp_path_factory):
    """A browser that shows its page."""
    target = tmp_path_factory.mktemp("page")
    assert run(["export", str(relit), "--to", str(target), "--web", "--quiet"]) == 0
    with Browser(tmp_path_factory.mktemp("browser")) as browser:
        browser.open(target / NAME)
        browser.run("await until(() => window.skinbake && skinbake.ready());")
        yield browser


@pytest.mark.skipif(renderer_name() is None, reason="no headless OpenGL here")
@pytest.mark.parametrize(("sky", "turn"), [("studio", 0), ("studio", 130), ("sunset", 275)])
def test_a_sky_is_drawn_as_the_preview_does(browser, relit, sky, turn):
    """`preview --environment SKY --rotate TURN --mode diffuse`, within 2 of 255 at 99.5 % of the pixels."""
    read = read_relit_folder(relit)
    later = LaterLight(made_sky(sky), rotate_deg=turn)
    compare_scene(browser, read, read.scene, ["front", "left", "back"], {f"sky:{sky}": "diffuse"}, later, turn=turn)


def test_the_turn_is_in_the_link_and_a_lost_context_brings_the_sky_back(browser):
    """The slider turns the light; the page says what it leaves out; after the driver's reset the same is drawn."""
    found = browser.run("""
        const at = (id) => document.getElementById(id), picture = () => at("picture").toDataURL();
        const moment = () => new Promise((r) => setTimeout(r, 100));
        const settled = async () => { await moment(); await until(() => skinbake.still()); };
        const before = at("sky-line").textContent;
        at("mode").value = "sky:studio"; at("mode").onchange();
        await settled();
        const first = picture();
        at("turn").value = 90; at("turn").oninput();
        await settled();
        const turned = picture(), link = location.hash, value = at("turn-value").textContent;
        const loss = at("picture").getContext("webgl2").getExtension("WEBGL_lose_context");
        loss.loseContext();
        await until(() => !skinbake.ready());
        loss.restoreContext();
        await until(() => skinbake.ready());
        await settled();
        const again = picture();
        at("turn").value = 0; at("turn").oninput();
        await settled();
        return { before, link, value, line: at("sky-line").textContent, label: at("turn").labels[0].textContent,
                 pictures: [first !== turned, turned === again, first === picture()] };
    """)
    assert found["before"] == ""
    assert "not in this page" in found["line"]
    assert found["label"].startswith("Turn the sky")
    assert found["value"] == "90\u00b0"
    assert "mode=sky%3Astudio" in found["link"]
    assert "turn=90" in found["link"]
    assert found["pictures"] == [True, True, True]
    assert browser.problems == []


def test_skies_are_left_out_where_the_page_gets_too_large(relit, monkeypatch):
    """A page without room for them is that of the lights, and says why."""
    bake = read_bake_folder(relit)
    lights = shader_lights(bake.scene.lights)
    whole = page_skies.page_skies(bake, lights, 0)
    needed = sum(len(image["data"]) for image in whole.tiles[1001]["textures"])
    most = page_skies.LARGEST_BYTES - page_skies._REST_BYTES - needed
    assert page_skies.page_skies(bake, lights, most) == whole
    assert page_skies.page_skies(bake, lights, most + 1) is None
    assert 0 < bake_page(relit)[1]["skies"] == whole.rms < 0.01
    monkeypatch.setattr(page_skies, "LARGEST_BYTES", 0)
    text, coding = bake_page(relit)
    assert "skies" not in coding
    data = json.loads(re.search(r'<script id="bake" type="application/json">(.*?)</script>', text, re.DOTALL)[1])
    assert data["skies"] == []
    assert not any(mode["name"].startswith("sky") for mode in data["modes"])
    assert ["Skies", ["left out: with them this page would have more than 20 MB"]] in data["about"]
