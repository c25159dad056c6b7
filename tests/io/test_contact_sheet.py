import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from skinbake.io.contact_sheet import Cell, write_contact_sheet
from skinbake.io.figures import png_figure
from skinbake.io.pictures import false_colour_sheet
from skinbake.io.png import write_png
from tests.conftest import ROOT

NAMES = ["US$_{price$", "$\\frac{$", "a\x1b[31m b", "50 % of $", "\\alpha_1^{2", "Zoë"]


def pixels(path):
    return np.asarray(Image.open(path).convert("RGB")).astype(int)


def test_names_and_notes_are_drawn_as_they_are(tmp_path):
    """No formula is made of a `$`: the sheet has a cell a look, whatever it is called, with something in it."""
    write_png(tmp_path / "a.png", np.full((50, 40, 3), 200, np.uint8))
    cells = [Cell(name, tmp_path / "a.png" if i % 2 else None, name, i % 3 == 0) for i, name in enumerate(NAMES)]
    write_contact_sheet(tmp_path / "sheet.png", cells, columns=3)
    sheet = pixels(tmp_path / "sheet.png")
    rows, columns = sheet.shape[0] // 2, sheet.shape[1] // 3
    for i in range(6):
        cell = sheet[(i // 3) * rows : (i // 3 + 1) * rows, (i % 3) * columns : (i % 3 + 1) * columns]
        caption = cell[-50:-20]
        assert (caption.max(axis=2) > 150).sum() > 20, NAMES[i]
    assert (sheet == 200).all(axis=2).sum() > 50_000  # three pictures


def test_the_difference_sheet_takes_any_part_s_name(tmp_path):
    """Names of parts are those of lights, which may come from any file."""
    image = np.random.default_rng(0).random((9, 7, 3)).astype(np.float32)
    false_colour_sheet(tmp_path / "d.png", {name: (image, image) for name in NAMES})
    assert pixels(tmp_path / "d.png").std() > 10


@pytest.mark.parametrize("backend", ["nope", "TkAgg", "module://nowhere"])
def test_no_backend_is_asked_for(tmp_path, backend):
    """MPLBACKEND names a window toolkit, or nothing that there is: pictures are drawn all the same, and it is left."""
    code = (
        "import os, sys\nfrom skinbake.io.figures import png_figure\n"
        "with png_figure(sys.argv[1], 50, figsize=(2, 1)) as figure: figure.text(0.1, 0.5, 'x')\n"
        "print(os.environ['MPLBACKEND'], 'matplotlib.pyplot' in sys.modules)\n"
    )
    environment = os.environ | {"MPLBACKEND": backend, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-W", "error", "-c", code, str(tmp_path / "x.png")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{backend} False\n"
    assert pixels(tmp_path / "x.png").shape == (50, 100, 3)


def test_a_fault_while_drawing_leaves_no_file(tmp_path):
    """Nor half of one."""
    with pytest.raises(ZeroDivisionError), png_figure(tmp_path / "x.png", 50):
        raise ZeroDivisionError
    assert not list(tmp_path.iterdir())
