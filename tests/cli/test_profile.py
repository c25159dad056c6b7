import json

import numpy as np
import pytest

from skinbake.cli import run
from skinbake.profile.dipole import dipole_reflectance, dipole_total
from skinbake.profile.fresnel import boundary_factor
from skinbake.profile.medium import Medium

SKIN1 = "model: dipole\nsigma_a_per_mm: [0.032, 0.17, 0.48]\nsigma_sp_per_mm: [0.74, 0.88, 1.01]\neta: 1.3\n"
LAYERS = """
skin:
  layers:
    - {sigma_a_per_mm: [0.1, 0.2, 0.3], sigma_sp_per_mm: 4, thickness_mm: 0.5, eta: 1.4}
"""
LOOK = "mesh: {path: nothing.obj, unit: mm}\noutput: {dir: out}\nlights: []\nskin: {preset: jensen-skin1}\n"


@pytest.fixture
def config(tmp_path):
    def write(text, name="skin.yaml"):
        path = tmp_path / name
        path.write_text(text)
        return str(path)

    return write


def test_json(config, capsys):
    """--json gives R, T and totals at the asked radii, under the names of the contract."""
    assert run(["profile", config(SKIN1), "--radii", "0.01,0.1,1,10", "--json"]) == 0
    out = json.loads(capsys.readouterr().out)
    medium = Medium(np.array([0.032, 0.17, 0.48]), np.array([0.74, 0.88, 1.01]))
    expected = dipole_reflectance(medium, boundary_factor(1.3), np.array([0.01, 0.1, 1, 10])).T
    np.testing.assert_allclose(out["reflectance_per_mm2"], expected, rtol=1e-14)
    np.testing.assert_allclose(out["total_reflectance"], dipole_total(medium, boundary_factor(1.3)), rtol=1e-14)
    assert out["radius_mm"] == [0.01, 0.1, 1, 10]
    assert np.shape(out["transmittance_per_mm2"]) == (4, 3)
    assert out["total_transmittance"] == [0, 0, 0]
    assert "stderr_per_mm2" not in out


def test_csv_can_be_read_as_a_table(config, tmp_path, capsys):
    """What --csv prints is a table skin that evaluates to the same values."""
    assert run(["profile", config(LAYERS), "--radii", "0.1,0.2,0.4,1,3", "--csv"]) == 0
    printed = capsys.readouterr().out
    (tmp_path / "p.csv").write_text(printed)
    assert run(["profile", config("path: p.csv", "table.yaml"), "--radii", "0.2,1", "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    rows = [[float(x) for x in line.split(",")] for line in printed.splitlines()[1:]]
    np.testing.assert_allclose(table["reflectance_per_mm2"], [rows[1][1:4], rows[3][1:4]], rtol=1e-9)
    assert any(row[4] > 0 for row in rows)  # a slab in air lets light through


def test_transport_has_errors_and_takes_photons(config, capsys):
    """A dipole's file evaluated by transport: standard errors present, totals near the dipole's; the seed decides."""
    path = config(SKIN1)
    arguments = ["profile", path, "--set", "model=transport", "--photons", "4000", "--radii", "1,3", "--json"]
    assert run(arguments) == 0
    first = capsys.readouterr().out
    assert run(arguments) == 0
    assert capsys.readouterr().out == first
    out = json.loads(first)
    assert np.shape(out["stderr_per_mm2"]) == (2, 3)
    assert (np.array(out["stderr_per_mm2"]) > 0).all()
    np.testing.assert_allclose(out["total_reflectance"], [0.439, 0.227, 0.131], atol=0.03)


def test_table_for_people(config, capsys):
    """Without a format a person reads model, radii and totals."""
    assert run(["profile", config(LAYERS)]) == 0
    out = capsys.readouterr().out
    assert "model multipole" in out
    assert "total" in out


def test_preset_inside_a_look(config, capsys):
    """CONFIG may be a whole look; only its skin counts."""
    assert run(["profile", config(LOOK), "--radii", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["model"] == "dipole"


@pytest.mark.parametrize(
    ("text", "arguments", "message"),
    [
        (SKIN1, ["--radii", "1,x"], "--radii: expected finite numbers >= 0 between commas, got 'x'"),
        (SKIN1, ["--radii", "-1"], "--radii"),
        (SKIN1, ["--json", "--csv"], "expected one of them"),
        (SKIN1, ["--photons", "10"], "expected a skin with model transport, got dipole"),
        (SKIN1.replace("1.3", "0.7"), [], "skin.yaml:4: skin.eta: expected a number >= 1, got 0.7"),
        ("path: none.csv", [], "skin.yaml:1: skin.path: expected a file, there is none at"),
        ("foo: 3\n" + LOOK, [], "skin.yaml:1: foo: unknown key"),
        (LOOK, ["--set", ".=5"], "--set .: expected a key such as texture.size, got '.'"),
    ],
)
def test_bad_input_is_said_in_a_line(config, capsys, text, arguments, message):
    """Bad radii, options and files end with exit code 2 and a message, never a traceback."""
    assert run(["profile", config(text), *arguments]) == 2
    assert message in capsys.readouterr().err
