"""Text over the picture: as large as its words, tabs in columns."""

import numpy as np

from skinbake.preview.controls import HELP
from skinbake.preview.text_overlay import COLUMN_PIXELS, LINE_PIXELS, MARGIN_PIXELS, overlay_text


def first_ink(picture, row, after=0):
    """Column of the first ink of a line of text."""
    line = picture[MARGIN_PIXELS + row * LINE_PIXELS : MARGIN_PIXELS + (row + 1) * LINE_PIXELS, after:, 0]
    return after + int(np.flatnonzero(line.max(axis=0) > 60)[0])


def test_tabs_stand_in_columns_whatever_stands_before_them():
    """The second cells begin at one place, to a pixel of their letters' own margins; a line without tabs is free."""
    picture = overlay_text(["a line that has no tab at all", "i\tH", "wwww\tH", "l\tH\tH"])
    starts = [first_ink(picture, row, after=MARGIN_PIXELS + 4 * 9) for row in (1, 2, 3)]
    assert max(starts) - min(starts) <= 1 or starts[1] < starts[0]
    at = [first_ink(picture, row, first_ink(picture, row) + 6) for row in (1, 3)]
    assert at[0] == at[1]
    assert at[0] > MARGIN_PIXELS + COLUMN_PIXELS


def test_the_help_has_its_keys_in_columns():
    """Each row pairs of a key and what it does."""
    assert all(len(row.split("\t")) % 2 == 0 for row in HELP)
    picture = overlay_text(HELP)
    starts = {first_ink(picture, row) for row in range(len(HELP))}
    assert max(starts) - min(starts) <= 2
    assert picture.shape[0] == 2 * MARGIN_PIXELS + LINE_PIXELS * len(HELP)


def test_no_text_is_no_fault():
    """A plate of its margins."""
    assert overlay_text([]).shape[2] == 2
