"""Reading of a tabulated profile."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from skinbake.errors import InputError
from skinbake.numerics import Float

MOST_BYTES = 64 * 2**20
LONGEST = 200  # characters of a line in a message
COLUMNS = ("r_mm", "R", "G", "B")


def read_profile_csv(path: Path | str) -> tuple[Float, Float]:
    """Radii, mm, shape (N,), and R(r), mm^-2, shape (N, 3), of a CSV whose header names r_mm, R, G and B.

    Other columns are ignored, as are empty lines and lines that begin with #.

    Raises
    ------
    InputError
        With file and line: a column that is missing or stands twice, a cell in no column, a value that is no finite
        number, radii that do not ascend, too few rows.
    """
    try:
        with open(path, "rb") as file:
            data = file.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            raise InputError(f"{path}: expected a table of at most {MOST_BYTES:,} bytes, got more")
        text = data.decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not text"
        raise InputError(f"{path}: expected a CSV file with columns {', '.join(COLUMNS)}, {reason}") from error
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    if not lines:
        raise InputError(f"{path}: expected a header {','.join(COLUMNS)}, got an empty file")
    header = [name.strip() for name in _cells(path, *lines[0])]
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        raise InputError(f"{path}:{lines[0][0]}: expected columns {', '.join(COLUMNS)}, missing {', '.join(missing)}")
    twice = [name for name in COLUMNS if header.count(name) > 1]
    if twice:
        raise InputError(f"{path}:{lines[0][0]}: expected columns of different names, {', '.join(twice)} stands twice")
    places = [header.index(name) for name in COLUMNS]
    rows: list[list[float]] = []
    for number, line in lines[1:]:
        cells = _cells(path, number, line)
        if any(map(str.strip, cells[len(header) :])):
            raise InputError(f"{path}:{number}: expected {len(header)} cells as in the header, got {_shown(line)}")
        try:
            row = [float(cells[place]) for place in places]
        except (ValueError, IndexError) as error:
            raise InputError(
                f"{path}:{number}: expected numbers for {', '.join(COLUMNS)}, got {_shown(line)}"
            ) from error
        if not all(map(math.isfinite, row)):
            raise InputError(f"{path}:{number}: expected finite numbers, got {_shown(line)}")
        if row[0] < 0 or (rows and row[0] <= rows[-1][0]):
            raise InputError(f"{path}:{number}: r_mm: expected ascending values >= 0, got {cells[places[0]].strip()}")
        rows.append(row)
    if len(rows) < 2:
        raise InputError(f"{path}: expected at least two rows, got {len(rows)}")
    table = np.array(rows)
    _refuse_negative_totals(path, table, [number for number, _ in lines[1:]])
    return table[:, 0], table[:, 1:]


def _cells(path: Path | str, number: int, line: str) -> list[str]:
    """Cells of one line.

    Raises
    ------
    InputError
        One is longer than the csv module takes.
    """
    try:
        return next(csv.reader([line]))
    except csv.Error as error:
        raise InputError(f"{path}:{number}: expected cells of a table, got: {error}") from error


def _shown(line: str) -> str:
    """A line as it stands, or its beginning."""
    return repr(line) if len(line) <= LONGEST else f"{line[:LONGEST]!r} ..."


def _refuse_negative_totals(path: Path | str, table: Float, numbers: list[int]) -> None:
    """Refuse a profile that reflects less than nothing; it may dip below 0 somewhere."""
    if (table >= 0).all():
        return
    from skinbake.profile.table import TableProfile

    with np.errstate(all="ignore"):
        try:
            total = TableProfile(table[:, 0], table[:, 1:]).total_reflectance
        except ValueError as error:
            raise InputError(f"{path}: expected values that can be interpolated, got: {error}") from error
    channel = int(np.argmin(total))
    if total[channel] < 0:
        lowest = int(np.argmin(table[:, 1 + channel]))
        raise InputError(
            f"{path}:{numbers[lowest]}: {COLUMNS[1 + channel]}: expected a profile whose total is not negative, "
            f"got {total[channel]:.3g}; its lowest value, {table[lowest, 1 + channel]:g}, stands in this line"
        )
