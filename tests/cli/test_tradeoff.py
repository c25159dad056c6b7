"""The trade-off measures what it says, keeps what it measured, and takes up where it stopped."""

import csv
import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skinbake.cli import run
from skinbake.cli.child_process import Child, in_child
from skinbake.cli.exact_values import exact_values
from skinbake.cli.tradeoff import Measurements
from skinbake.errors import InputError, MachineError
from skinbake.io.config import load_look
from skinbake.io.mesh import write_obj
from skinbake.io.tradeoff import append_run, read_runs
from skinbake.preview.image_metrics import image_similarity
from skinbake.tradeoff import Row, Sweep, cheapest, difference, pareto_front, plan_sweep
from tests.conftest import ROOT
from tests.shapes import relief

LOOK = """\
mesh: {path: bump.obj, unit: mm, any_size: true}
texture: {size: [44, 36], gutter: 2}
skin:
  variance_mm2: [0.5, 4.0]
  weight_rgb: [[0.5, 0.6, 0.8], [0.5, 0.4, 0.2]]
lights: [{name: key, type: directional, direction: [0.4, -0.2, -1], irradiance: [1, 0.8, 0.6]}]
output: {dir: out}
"""


SHOWN = {"0.05", "0.01", "texture", "surface"}


def row(seconds, rms, reference="finest", key="k"):
    return Row(key, "s", "l", reference, (), rms, rms, rms, seconds, 1.0, 1, 0.0, 1.0, 1)


points = st.lists(st.tuples(st.floats(0.1, 100), st.floats(1e-4, 1)), min_size=1, max_size=12)


@given(points)
def test_the_front_holds_what_nothing_beats(values):
    """Against every pair: whatever is off the front is matched in time by something as good, to a hundredth."""
    rows = [row(*value) for value in values]
    front = pareto_front(rows)
    for one in rows:
        assert any(other.seconds <= one.seconds and other.rms * 0.99 <= one.rms for other in front)
    for i, one in enumerate(front[1:]):
        assert one.seconds >= front[i].seconds
        assert one.rms < front[i].rms


@given(points, st.floats(1e-4, 1))
def test_the_cheapest_is_the_fastest_within_the_limit(values, limit):
    """None where nothing is within it."""
    rows = [row(*value) for value in values]
    within = [value for value in values if value[1] <= limit]
    found = cheapest(rows, limit)
    assert (found is None) == (not within)
    if found:
        assert found.seconds == min(seconds for seconds, _ in within)


def test_difference_by_hand():
    """rms to the reference's norm, the others to its mean; a black reference is refused."""
    wanted = np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 5.0]])
    rms, p95, most = difference(wanted + np.array([[0, 0, 0], [0, 0, 1.0]]), wanted)
    assert rms == pytest.approx(1 / np.sqrt(50))
    assert most == pytest.approx(0.5)
    assert p95 < most
    with pytest.raises(ValueError, match="some light"):
        difference(wanted, wanted * 0)


@pytest.mark.parametrize("extent", ["quick", "default", "full"])
@pytest.mark.parametrize(
    "skin", ["gpugems3-six-gaussians", "jensen-skin1", "donner-three-layer", "physiology-light", ""]
)
def test_every_setting_of_every_sweep_is_a_look(extent, skin):
    """All overrides are taken by the configuration, each against a reference that exists, no two rows alike."""
    overrides = (f"skin={{preset: {skin}}}",) if skin else ()
    overrides += ("tolerance=0.02",) if extent == "default" else ()  # which is the sweep's own knob
    config = ROOT / "configs" / ("head_plain.yaml" if skin else "head.yaml")  # maps of pigments go with one model
    sweep = plan_sweep(load_look(config, overrides), (256, 128), extent)
    known = {reference.name for reference in sweep.references}
    assert {setting.reference for setting in sweep.settings} <= known
    rows = [(s.sweep, s.label, s.reference) for s in sweep.settings]
    assert len(set(rows)) == len(rows)
    for own in {s.overrides for s in sweep.settings} | {r.overrides for r in sweep.references} | ({sweep.twice} - {()}):
        assert load_look(config, (*overrides, *own)).texture.size[0] <= 512


def test_a_child_answers_fails_and_dies():
    """Results, errors of ours by their kind, others by their name, and a process that is gone."""
    with Child() as child:
        assert child(divmod, 17, 5) == (3, 2)
        with pytest.raises(MachineError, match="ZeroDivisionError"):
            child(divmod, 1, 0)
        with pytest.raises(InputError, match=r"nowhere\.yaml"):
            child(load_look, "nowhere.yaml")
        with pytest.raises(MachineError, match="exit code 7"):
            child(os._exit, 7)


def test_runs_survive_a_line_cut_short(tmp_path):
    """What a kill leaves of the last line is ignored."""
    append_run(tmp_path, {"key": "a", "seconds": 1.0})
    append_run(tmp_path, {"key": "a", "seconds": 2.0})
    with open(tmp_path / "tradeoff.runs.jsonl", "a") as file:
        file.write('{"key": "b", "sec')
    assert [r["seconds"] for r in read_runs(tmp_path)["a"]] == [1.0, 2.0]
    assert "b" not in read_runs(tmp_path)


def test_equal_pictures_look_equal():
    """FLIP 0 and SSIM 1 for a picture and itself, worse for more noise."""
    rng = np.random.default_rng(0)
    picture = rng.random((64, 48, 3), dtype=np.float32)
    flip, ssim = image_similarity(picture, picture)
    assert flip == pytest.approx(0, abs=1e-6)
    assert ssim == pytest.approx(1)
    found = [
        image_similarity(picture + np.float32(s) * rng.random(picture.shape, dtype=np.float32), picture)
        for s in (0.05, 0.3)
    ]
    assert 0 < found[0][0] < found[1][0]
    assert 1 > found[0][1] > found[1][1]


@pytest.fixture
def look(tmp_path):
    write_obj(tmp_path / "bump.obj", relief(segments=24))
    (tmp_path / "look.yaml").write_text(LOOK)
    return tmp_path / "look.yaml"


def test_the_exact_values_know_no_seed_of_the_bake_but_its_own(look):
    """The same probes and light each time; constant light gives the sum of the weights."""
    spec = load_look(look, ["lights.key.shadows=false"])
    first, at = exact_values(spec, 40)
    again, _ = exact_values(spec, 40, at)
    np.testing.assert_allclose(again, first, rtol=1e-12)
    assert len(np.unique(at.place, axis=0)) > 30


@pytest.mark.slow
def test_measures_continues_and_advises(look, tmp_path, monkeypatch, capsys):
    """Two methods and two tolerances, each in a process of its own; again, it adds runs and measures no error anew."""

    def two(spec, size, extent):
        whole = plan_sweep(spec, size, "quick")
        return Sweep(whole.references[:2], tuple(s for s in whole.settings if s.label in SHOWN))

    monkeypatch.setattr("skinbake.tradeoff.plan_sweep", two)
    command = ["tradeoff", str(look), "--quick", "--no-picture", "--points", "200", "--out", str(tmp_path / "t")]
    assert run(command) == 0
    said = capsys.readouterr()
    assert "reference finest" in said.err
    assert "[100%]" in said.err
    assert "within 5.0%:" in said.out
    assert said.out.startswith("tolerance 0.05: ")
    with open(tmp_path / "t" / "tradeoff.csv", newline="") as file:
        rows = {r["setting"]: r for r in csv.DictReader(file)}
    assert set(rows) == SHOWN
    assert all(float(rows[label]["rms"]) <= float(label) for label in ("0.05", "0.01"))
    assert rows["0.05"]["reference"] == "every term"
    assert 0 < float(rows["surface"]["rms"]) < 0.03
    assert float(rows["surface"]["rms"]) < float(rows["texture"]["rms"])
    assert float(rows["surface"]["peak_mib"]) > 50
    assert all(int(r["bytes"]) > 1000 and float(r["seconds"]) > 0 and r["runs"] == "1" for r in rows.values())
    assert (tmp_path / "t" / "tradeoff.png").stat().st_size > 10_000
    assert "**front**" in (tmp_path / "t" / "tradeoff.md").read_text()

    assert run(command) == 0
    assert "texture:" not in capsys.readouterr().err

    # Ctrl-C in the middle of the third run: what was there stays, exit code as for any stopped program
    def interrupted(self, *_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Child, "__call__", interrupted)
    assert run([*command, "--repeats", "3"]) == 130
    with open(tmp_path / "t" / "tradeoff.csv", newline="") as file:
        assert {r["setting"] for r in csv.DictReader(file)} == SHOWN

    # Before the first: no table, and none is named
    capsys.readouterr()
    monkeypatch.setattr(Measurements, "_make_reference", interrupted)
    assert run([part if part != str(tmp_path / "t") else str(tmp_path / "none") for part in command]) == 130
    told = capsys.readouterr()
    assert (told.out, told.err.splitlines()[-1]) == ("", "stopped")
    assert not (tmp_path / "none").exists()


def test_a_folder_that_cannot_be_written_to_is_told_before_anything_is_measured(look, tmp_path, monkeypatch, capsys):
    """Seconds, not hours; and while another one writes there it is waited for."""
    monkeypatch.setattr(Measurements, "measure", lambda *_: pytest.fail("measured"))
    (tmp_path / "t").mkdir()
    (tmp_path / "t" / ".lock").symlink_to("elsewhere")
    assert run(["tradeoff", str(tmp_path / "look.yaml"), "--quick", "--out", str(tmp_path / "t")]) == 2
    assert "expected a lock file, got a symbolic link" in capsys.readouterr().err


def test_one_task_a_process():
    """Two calls are two processes."""
    assert in_child(os.getpid) != in_child(os.getpid)
