import json

import numpy as np
import pytest

from skinbake.cli import run
from skinbake.io.table import read_profile_csv

SKIN1 = "sigma_a_per_mm: [0.032, 0.17, 0.48]\nsigma_sp_per_mm: [0.74, 0.88, 1.01]\nfit: {gaussians: 4}\n"
PRESET = "preset: gpugems3-six-gaussians\n"

pytestmark = pytest.mark.usefixtures("drawn_plots")


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "skin.yaml"

    def write(text):
        path.write_text(text)
        return str(path)

    return write


def test_writes_three_files(config, tmp_path, capsys):
    """--out leaves the fit as JSON, CSV and a picture; the JSON is what --json prints; nothing half-written stays."""
    assert run(["fit", config(SKIN1), "--out", str(tmp_path / "out"), "--json"]) == 0
    printed = capsys.readouterr().out
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == ["profile.csv", "profile.json", "profile.png"]
    assert (tmp_path / "out" / "profile.json").read_text() == printed
    assert (tmp_path / "out" / "profile.png").read_bytes().startswith(b"\x89PNG")
    record = json.loads(printed)
    assert len(record["variance_mm2"]) == 4
    assert np.shape(record["weight_rgb"]) == (4, 3)
    np.testing.assert_allclose(np.sum(record["weight_rgb"], axis=0), 1, rtol=1e-12)
    np.testing.assert_allclose(record["energy_rgb"], [0.4359, 0.2273, 0.1310], atol=1e-4)
    assert max(record["relative_error_rgb"]) < 0.02
    assert record["condition_number"] > 1
    assert record["model"] == "dipole"
    assert record["normalise"] == "white"
    _, model = read_profile_csv(tmp_path / "out" / "profile.csv")
    assert np.isfinite(model).all()


@pytest.mark.parametrize(
    ("look", "overrides", "count"),
    [
        ("", (), 6),
        ("tolerance: 0.05\n", (), 4),
        ("diffusion: {tolerance: 0.2}\n", (), 4),
        ("", ("tolerance=0.05",), 4),
        ("tolerance: 0.05\n", ("skin.fit.gaussians=5",), 5),
        ("tolerance: 0.05\n", ("tolerance=0.04",), 6),
        ("tolerance: loose\n", (), 6),  # the rest of a look may be unfinished
    ],
)
def test_a_draft_is_fitted_as_its_bake_is(config, capsys, look, overrides, count):
    """By four Gaussians, unless the look says how."""
    text = f"{look}skin: {{model: burley, d_mm: 1.0}}\n"
    options = [option for each in overrides for option in ("--set", each)]
    assert run(["fit", config(text), "--json", *options]) == 0
    assert len(json.loads(capsys.readouterr().out)["variance_mm2"]) == count


def test_same_input_same_bytes(config, tmp_path):
    """Two runs write the same bytes, the picture included."""
    for name in ("a", "b"):
        assert run(["fit", config(SKIN1), "--out", str(tmp_path / name), "--quiet"]) == 0
    for kind in ("json", "csv", "png"):
        file = f"profile.{kind}"
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_given_gaussians_pass_and_are_compared(config, tmp_path, capsys):
    """The published table passes unchanged, and --against says how it describes another profile, scale apart."""
    assert run(["fit", config(SKIN1), "--out", str(tmp_path), "--quiet"]) == 0
    table = str(tmp_path / "profile.csv")
    assert run(["fit", config(PRESET), "--against", table, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["variance_mm2"] == [0.0064, 0.0484, 0.187, 0.567, 1.99, 7.41]
    assert record["weight_rgb"][0] == pytest.approx([0.233, 0.455, 0.649])
    assert record["relative_error_rgb"] == [0, 0, 0]
    against = record["against"]
    assert against["path"] == table
    assert (np.array(against["relative_error_at_best_scale_rgb"]) <= against["relative_error_rgb"]).all()
    assert run(["fit", config(SKIN1), "--against", table]) == 0
    assert "against" in capsys.readouterr().out


def test_own_profile_is_described_as_well_as_fitted(config, tmp_path, capsys):
    """Against the CSV of its own fit, the error is the fit's."""
    assert run(["fit", config(SKIN1), "--out", str(tmp_path), "--against", str(tmp_path / "none.csv")]) == 2
    capsys.readouterr()
    assert run(["fit", config(SKIN1), "--out", str(tmp_path), "--quiet"]) == 0
    assert run(["fit", config(SKIN1), "--against", str(tmp_path / "profile.csv"), "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    np.testing.assert_allclose(record["against"]["relative_error_rgb"], record["relative_error_rgb"], rtol=0.1)


@pytest.mark.slow
def test_tolerance(config, tmp_path, capsys):
    """A tolerance that is met ends with 0; one that is not ends with 1, after writing, and says what was reached."""
    assert run(["fit", config(SKIN1.replace("gaussians: 4", "tolerance: 0.02")), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["tolerance_met"]
    out = str(tmp_path / "out")
    assert run(["fit", config(SKIN1.replace("gaussians: 4", "tolerance: 1e-8")), "--out", out, "--quiet"]) == 1
    assert "no sum of up to 12 Gaussians meets 1e-08" in capsys.readouterr().err
    assert (tmp_path / "out" / "profile.json").is_file()


def test_report_for_people(config, capsys):
    """Variances, weights, errors and condition number are listed."""
    assert run(["fit", config(SKIN1)]) == 0
    out = capsys.readouterr().out
    for word in ("variance, mm^2", "sum", "relative error, %", "largest residual", "condition number"):
        assert word in out


def test_dark_skin_is_refused(config, capsys):
    """A channel without light cannot be made white: exit 2, and the way out."""
    text = "sigma_a_per_mm: [1, 1, 1]\nsigma_sp_per_mm: [1, 1, 0]\n"
    assert run(["fit", config(text)]) == 2
    assert "blue reflects 0; use none" in capsys.readouterr().err
