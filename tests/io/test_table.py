import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.io.table import read_profile_csv
from skinbake.profile.table import MOST_ANNULI, TableProfile


def test_reads_by_header(tmp_path):
    """Columns are found by name in any order; others, comments, blanks and a byte-order mark are passed over."""
    file = tmp_path / "p.csv"
    file.write_text("\ufeff# measured\nG, R ,r_mm,B,note\n\n2,1,0,3,x, \n5,4,0.5,6,y\n", encoding="utf-8")
    radius, rgb = read_profile_csv(file)
    assert radius.tolist() == [0, 0.5]
    assert rgb.tolist() == [[1, 2, 3], [4, 5, 6]]


def test_a_dip_below_zero_passes(tmp_path):
    """Models have them far out; only a total below 0 is none."""
    (tmp_path / "p.csv").write_text("r_mm,R,G,B\n0,1,1,1\n1,1,-1e-6,0\n2,0,0,0\n")
    assert read_profile_csv(tmp_path / "p.csv")[1].min() == -1e-6


def test_a_table_of_many_rows_is_read_and_fitted_in_some_memory(tmp_path):
    """Its annuli are taken together, their light with them: what a fit sees is that of a table with fewer rows."""
    radius = np.linspace(0, 20, 30_001)
    rows = "".join(f"{r:.6f},{np.exp(-r):.6g},{np.exp(-2 * r):.6g},{np.exp(-4 * r):.6g}\n" for r in radius)
    (tmp_path / "p.csv").write_text("r_mm,R,G,B\n" + rows)
    nodes = TableProfile(*read_profile_csv(tmp_path / "p.csv")).fit_nodes()
    assert len(nodes.target) <= MOST_ANNULI
    np.testing.assert_allclose(nodes.root_weight**2 @ nodes.target * 2 * np.pi, nodes.total, rtol=1e-12)
    np.testing.assert_allclose(nodes.total, 2 * np.pi / np.array([1, 2, 4]) ** 2, rtol=1e-5)
    sparse = TableProfile(radius[::30], np.exp(-radius[::30, None] * [1, 2, 4])).fit_nodes()
    variance = np.geomspace(0.01, 10, 7)
    np.testing.assert_allclose(nodes.window_share(variance), sparse.window_share(variance), rtol=2e-4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty file"),
        ("r_mm,R,G,B,n\n0,1,1,1," + "x" * 140_000, r"p\.csv:2: expected cells of a table, got: field larger than"),
        ("r_mm,R,G,B," + "x" * 140_000, r"p\.csv:1: expected cells of a table, got: field larger than"),
        (
            "r_mm,R,G,B,n\n0,1,x,1," + "x" * 100_000,
            r"p\.csv:2: expected numbers for r_mm, R, G, B, got '0,.{1,200}' \.{3}$",
        ),
        ("#" * (64 * 2**20 + 1), r"p\.csv: expected a table of at most 67,108,864 bytes, got more"),
        ("r_mm,R,G\n1,2,3\n", r"p\.csv:1: expected columns r_mm, R, G, B, missing B"),
        ("R,r_mm,R,G,B\n1,2,3,4,5\n", r"p\.csv:1: expected columns of different names, R stands twice"),
        ("r_mm,R,G,B,,\n0,1,1,1\n1,0,5,1,1,1,7\n", r"p\.csv:3: expected 6 cells as in the header, got '1,0,5,1,1,1,7'"),
        ("r_mm,R,G,B\n0,1,1,1,\n", "at least two rows, got 1"),
        ("r_mm,R,G,B\n1,2,3,4\n2,x,3,4\n", r"p\.csv:3: expected numbers"),
        ("r_mm,R,G,B\n1,2,3\n", r"p\.csv:2: expected numbers"),
        ("r_mm,R,G,B\n1,2,3,nan\n", r"p\.csv:2: expected finite"),
        ("r_mm,R,G,B\n2,2,3,4\n1,2,3,4\n", r"p\.csv:3: r_mm: expected ascending values >= 0, got 1"),
        ("r_mm,R,G,B\n-1,2,3,4\n", "got -1"),
        ("r_mm,R,G,B\n1,2,3,4\n", "at least two rows, got 1"),
        ("# x\nr_mm,R,G,B\n0,1,1,1\n\n1,1,-9,0\n", r"p\.csv:5: G: expected a profile whose total is not negative"),
    ],
)
def test_faults_name_file_and_line(tmp_path, text, message):
    """What is wrong with a table is said with its file and line."""
    file = tmp_path / "p.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        read_profile_csv(file)


def test_missing_file_and_binary(tmp_path):
    """No file, and a file that is no text."""
    with pytest.raises(InputError, match="No such file"):
        read_profile_csv(tmp_path / "none.csv")
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(InputError, match="not text"):
        read_profile_csv(tmp_path / "b.csv")
