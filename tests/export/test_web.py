"""`skinbake export --web`: one page that needs nothing else and draws what the preview draws."""

from __future__ import annotations

import base64
import io
import json
import re

import numpy as np
import pytest
from PIL import Image

import skinbake
from skinbake.cli import run
from skinbake.cli.preview import shown_with
from skinbake.errors import InputError
from skinbake.export.web import NAME
from skinbake.io.bake_folder import read_bake_folder
from skinbake.io.other_skins import other_skin
from skinbake.io.png import write_png
from skinbake.io.presets import skin_names
from skinbake.io.webp import webp_pixels
from skinbake.page.batch_page import PageLook, batch_page
from skinbake.page.coded_image import coded
from skinbake.page.page_skins import page_skins
from skinbake.preview.camera import view
from skinbake.preview.draw import OffscreenRenderer
from skinbake.preview.mode import parse_mode
from skinbake.preview.other_skin import skin_line
from skinbake.preview.setup_gl import renderer_name
from skinbake.preview.views import tone_map
from tests.export.browser import Browser

pytestmark = pytest.mark.slow  # processes, waits, or many bakes

SIZE = (120, 150)
VIEWS = ("front", "left", "three-quarter-right", "back")
MODES = ("full", "diffuse", "specular", "none", "lobe:1", "lobe:2")


@pytest.fixture(scope="module")
def page(bake, tmp_path_factory):
    """The page of the ball."""
    folder = tmp_path_factory.mktemp("web")
    assert run(["export", str(bake), "--to", str(folder), "--web", "--quiet"]) == 0
    return folder / NAME


@pytest.fixture(scope="module")
def browser(page, tmp_path_factory):
    """A browser that shows it."""
    with Browser(tmp_path_factory.mktemp("browser")) as browser:
        browser.open(page)
        browser.run("await until(() => window.skinbake && skinbake.ready());")
        yield browser


def test_the_page_needs_nothing_else(page, bake, tmp_path):
    """No address of another file in it, the same bytes again, and no name can end its data."""
    text = page.read_text(encoding="utf-8")
    assert not re.search(r"(?:src|href)=|https?://|@import|url\(", text.replace("href: canvas", ""))
    data = re.search(r'<script id="bake" type="application/json">(.*?)</script>', text, re.DOTALL)[1]
    assert "<" not in data
    assert json.loads(data)["lights"] == ["key", "lamp"]
    textures = json.loads(data)["tiles"][0]["textures"]
    assert textures["lobe_1"] == [{"same_as": "lobe_0"}], "lobes too narrow to be blurred are one image"
    assert all("data" in each for each in textures["lobe_2"])
    assert run(["export", str(bake), "--to", str(tmp_path), "--web", "--quiet"]) == 0
    assert (tmp_path / NAME).read_bytes() == page.read_bytes()


@pytest.mark.parametrize("coding", ["sqrt", "linear"])
def test_the_stated_error_of_the_coding_is_the_error(coding):
    """Decoded as the page does it: the range a channel, squared where light is stored."""
    rng = np.random.default_rng(2)
    image = (rng.random((33, 20, 3)) ** 3 * [2.0, 1.0, 0.1]).astype(np.float32)
    found = coded(image, coding, lossless=True)
    share = webp_pixels(base64.b64decode(found.record["data"])) / 255
    low, high = np.array(found.record["low"]), np.array(found.record["high"])
    values = low + (high - low) * (share**2 if coding == "sqrt" else share)
    assert found.rms == pytest.approx(np.sqrt(np.mean((values - image) ** 2)), rel=1e-4)
    assert found.norm == pytest.approx(np.sqrt(np.mean(image**2)), rel=1e-6)
    assert found.rms < 0.004 * found.norm


def test_what_is_the_same_everywhere_is_exact():
    """Black, and a constant."""
    for value in (0.0, 0.3):
        found = coded(np.full((4, 5), value, np.float32), "linear")
        assert found.record["channels"] == 1
        assert found.rms == 0


@pytest.mark.skipif(renderer_name() is None, reason="no headless OpenGL here")
def test_it_draws_what_the_preview_draws(browser, bake):
    """In four views and every mode, within 2 of 255 at 99.5 % of the pixels; and says nothing on the console."""
    compare(browser, bake, VIEWS, MODES)


@pytest.mark.skipif(renderer_name() is None, reason="no headless OpenGL here")
def test_skin_that_varies_is_drawn_as_the_preview_does(bake, tmp_path):
    """By the same table of weights, read at the same maps; and bumps that are finer than a pixel."""
    bumps = 128 + 50 * np.sin(np.arange(900) * 1.3)[:, None, None] * np.sin(np.arange(1200) * [[1.1], [0.9]]).T
    write_png(bake.parent / "bumps.png", np.dstack([bumps, np.full(bumps.shape[:2], 230.0)]).astype(np.uint8))
    for name, low in (("radius", 60), ("share", 0)):
        ramp = np.linspace(low, 255, 24).astype(np.uint8)
        write_png(bake.parent / f"{name}.png", np.repeat(np.tile(ramp, (16, 1))[..., None], 3, axis=2))
    maps = [f"maps.radius={bake.parent / 'radius.png'}", f"maps.scatter={bake.parent / 'share.png'}"]
    look = ["bake", str(bake.parent / "me.yaml"), "--set", maps[0], "--set", maps[1]]
    look += ["--set", f"maps.normal={bake.parent / 'bumps.png'}"]
    skin = ["--set", "skin={preset: jensen-skin1, fit: {gaussians: 3}}", "--no-preview", "--quiet"]
    assert run([*look, *skin, "--out", str(tmp_path / "bake")]) == 0
    assert run(["export", str(tmp_path / "bake"), "--to", str(tmp_path / "x"), "--web", "--quiet"]) == 0
    with Browser(tmp_path / "browser") as browser:
        browser.open(tmp_path / "x" / NAME)
        browser.run("await until(() => window.skinbake && skinbake.ready());")
        compare(browser, tmp_path / "bake", ["front", "left"], ["full", "none", "specular"])
        assert browser.run("return document.getElementById('skin-row').checkVisibility();") is False


def compare(browser, bake, views, modes, skin=""):
    """Look at each view in each mode, in the browser and in the preview, also with another skin."""
    read = read_bake_folder(bake)
    compare_scene(
        browser, read, shown_with(read, skin, 0) if skin else read.scene, views, {m: m for m in modes}, skin=skin
    )


def compare_scene(browser, read, scene, views, modes, later=None, **ask):
    """Look at each view in each mode of the page, and in that of the preview which `modes` names, lit by `later`."""
    asked = json.dumps({"views": views, "modes": list(modes), "width": SIZE[0], "height": SIZE[1]} | ask)
    drawn = browser.run(
        f"const asked = {asked}, out = {{}};"
        "for (const view of asked.views) for (const mode of asked.modes)"
        "  out[`${view} ${mode}`] = await skinbake.render({ ...asked, view, mode });"
        "return out;"
    )
    assert browser.problems == []
    aspect = read.spec.preview.size[0] / read.spec.preview.size[1]
    with OffscreenRenderer(scene) as renderer:
        for name in views:
            for mode, shown_as in modes.items():
                camera = view(scene.mesh, name, aspect)
                shown = renderer.draw(camera, SIZE, parse_mode(shown_as, len(scene.lobes)), later=later)
                want = tone_map(shown, read.spec.preview.background_rgb, read.spec.preview.exposure).astype(int)
                data = drawn[f"{name} {mode}"].partition(",")[2]
                got = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")).astype(int)
                near = np.abs(got - want).max(axis=-1) <= 2
                assert near.mean() >= 0.995, (name, mode)
                assert want.max() > 60 or mode == "specular"


@pytest.mark.skipif(renderer_name() is None, reason="no headless OpenGL here")
def test_another_skin_is_drawn_as_the_preview_does(browser, bake):
    """With the weights that `preview --skin` finds; it is another picture than that of the bake's own skin."""
    compare(browser, bake, ["front", "left"], ["full", "diffuse", "none"], "jensen-skin2")
    found = browser.run("""
        const ask = { view: "front", mode: "diffuse", width: 60, height: 75 };
        return await skinbake.render(ask) !== await skinbake.render({ ...ask, skin: "jensen-skin2" });
    """)
    assert found


def test_a_skin_is_chosen_by_name_with_the_error_of_its_fit(browser, bake):
    """The box has a label, the line that the preview prints, and the link the choice; a link without it is as baked."""
    found = browser.run("""
        const at = (id) => document.getElementById(id), picture = () => at("picture").toDataURL();
        const moment = () => new Promise((r) => setTimeout(r, 100));
        const settled = async () => { await moment(); await until(() => skinbake.still()); };
        const choose = async (name) => { at("skin").value = name; at("skin").onchange(); await settled(); };
        await choose("");
        const before = picture();
        await choose("jensen-skin2");
        const other = picture();
        at("link").click();
        const link = location.hash, line = at("skin-line").textContent;
        await choose("");
        const back = picture(), silent = at("skin-line").textContent;
        location.hash = link;
        await until(() => at("skin").value === "jensen-skin2");
        await settled();
        const again = picture();
        location.hash = link.replace("skin=jensen-skin2", "skin=nobody");
        await settled();
        const unknown = at("skin").value;
        await choose("");
        return { link, line, silent, unknown, label: at("skin").labels[0].textContent.startsWith("Skin "),
                 option: [...at("skin").options].find((o) => o.value === "jensen-skin2").textContent,
                 pictures: [before === back, before !== other, other === again] };
    """)
    assert "skin=jensen-skin2" in found["link"]
    fit = other_skin(read_bake_folder(bake), "jensen-skin2").fit()
    assert found["line"] == skin_line("jensen-skin2", fit)
    assert "bake again for this one" in found["line"]
    assert found["option"] == "jensen-skin2 (bake again for this one)"
    assert (found["silent"], found["unknown"], found["label"]) == ("", "jensen-skin2", True)
    assert found["pictures"] == [True, True, True]


def test_the_skin_that_was_baked_needs_no_other_bake(bake, tmp_path):
    """A page marks the skins whose fit is off by more than 3 %, and only those."""
    skin = ["--set", "skin={preset: jensen-skin1, fit: {gaussians: 4}}", "--no-preview", "--quiet"]
    assert run(["bake", str(bake.parent / "me.yaml"), *skin, "--out", str(tmp_path)]) == 0
    read = read_bake_folder(tmp_path)
    skins = page_skins(read)
    assert [skin["name"] for skin in skins if not skin["again"]] == ["jensen-skin1"]
    assert len(skins) == len(skin_names())
    own = [lobe.weight_rgb for lobe in read.scene.lobes]
    np.testing.assert_allclose(skins[0]["weights"], own, atol=1e-3)  # the bake's own fit, found again
    np.testing.assert_allclose(skins[0]["total_weight"], read.scene.total_weight_rgb, rtol=1e-6)


def test_controls_change_the_picture_and_a_link_brings_it_back(browser):
    """A light's slider, the exposure, the split and the view are in the link; opening it restores them."""
    found = browser.run("""
        const at = (id) => document.getElementById(id), picture = () => at("picture").toDataURL();
        const moment = () => new Promise((r) => setTimeout(r, 100));
        const settled = async () => { await moment(); await until(() => skinbake.still()); };
        await settled();
        const before = picture();
        at("gain-0").value = 0.5; at("gain-0").oninput();
        at("exposure").value = 1; at("exposure").oninput();
        at("split").click();
        at("view").value = "left"; at("view").onchange();
        await settled();
        const changed = picture();
        at("link").click();
        await settled();
        const link = location.hash;
        at("gain-0").value = 2; at("gain-0").oninput(); at("split").click();
        await settled();
        const other = picture();
        location.hash = "";
        location.hash = link;
        await until(() => at("gain-value-0").textContent === "0.50");
        await settled();
        return { link, changes: before !== changed, differs: changed !== other, returns: picture() === changed,
                 gain: at("gain-value-0").textContent, divider: at("divider").hidden };
    """)
    assert "gains=0.5%2C1" in found["link"]
    assert "mode=full" in found["link"]
    assert {key: found[key] for key in ("changes", "differs", "returns", "gain", "divider")} == {
        "changes": True, "differs": True, "returns": True, "gain": "0.50", "divider": False,
    }  # fmt: skip


def test_a_lost_context_comes_back(browser):
    """The driver may take the context away: the page says so, and draws the same again."""
    found = browser.run("""
        const ask = { view: "front", mode: "full", width: 60, height: 60 };
        const before = await skinbake.render(ask);
        const loss = document.getElementById("picture").getContext("webgl2").getExtension("WEBGL_lose_context");
        loss.loseContext();
        await until(() => !skinbake.ready());
        const told = document.getElementById("note").textContent;
        loss.restoreContext();
        await until(() => skinbake.ready());
        return { told, same: before === await skinbake.render(ask) };
    """)
    assert found == {"told": "The graphics driver was reset ...", "same": True}


def test_a_batch_s_looks_turn_together_and_a_cell_shows_the_page(browser, page, bake, tmp_path):
    """In frames: one that is turned turns the others; a notebook's viewer draws in its own."""
    for name in ("a", "b"):
        (tmp_path / f"{name}.html").write_bytes(page.read_bytes())
    looks = [PageLook(name, f"{name}.html", "<note>") for name in ("a", "b")]
    (tmp_path / "batch.html").write_text(batch_page("two", looks), encoding="utf-8")
    browser.open(tmp_path / "batch.html")
    found = browser.run("""
        await until(() => document.readyState === "complete");
        const [one, two] = [...document.querySelectorAll("iframe")].map((frame) => frame.contentWindow);
        await until(() => one.skinbake?.ready() && two.skinbake?.ready());
        const shown = (of) => of.document.getElementById("picture").toDataURL();
        const still = () => one.skinbake.still() && two.skinbake.still();
        const settled = async () => { await new Promise((r) => setTimeout(r, 300)); await until(still); };
        const picture = one.document.getElementById("picture");
        const press = (key) => picture.dispatchEvent(new KeyboardEvent("keydown", { key }));
        await settled();
        const before = shown(two);
        press("ArrowLeft"); press("2");
        await until(() => still() && shown(two) !== before && shown(two) === shown(one));
        document.getElementById("together").click();
        const alone = shown(two);
        press("ArrowLeft");
        await settled();
        return { folded: two.document.getElementById("controls").hidden,
                 alone: shown(two) === alone && shown(one) !== alone };
    """)
    assert found == {"folded": True, "alone": True}
    assert "&lt;note&gt;" in (tmp_path / "batch.html").read_text()
    shown = skinbake.open_bake(bake).viewer(height=300)._repr_html_()
    (tmp_path / "cell.html").write_text(f"<!doctype html><p>A cell</p>{shown}", encoding="utf-8")
    browser.open(tmp_path / "cell.html")
    found = browser.run("""
        await until(() => document.querySelector("iframe")?.contentWindow.skinbake?.ready());
        const frame = document.querySelector("iframe"), inner = frame.contentWindow;
        const data = await inner.skinbake.render({ view: "front", mode: "full", width: 60, height: 60 });
        inner.document.getElementById("link").click();
        await until(() => inner.document.getElementById("note").textContent);
        return { data, height: frame.clientHeight, hash: inner.location.hash };
    """)
    assert (found["height"], found["hash"]) == (300, "")
    drawn = np.asarray(Image.open(io.BytesIO(base64.b64decode(found["data"].partition(",")[2]))).convert("L"))
    assert drawn.max() > 60
    assert browser.problems == []
    with pytest.raises(InputError, match="expected a bake in a folder, got one in memory"):
        skinbake.bake(bake.parent / "me.yaml").viewer()
