"""Modes are read as they are written, and others refused with the ones that exist."""

import pytest

from skinbake.errors import InputError
from skinbake.preview.mode import Mode, parse_mode


@pytest.mark.parametrize("text", ["full", "diffuse", "specular", "none", "lobe:0", "lobe:5"])
def test_a_mode_is_written_as_it_is_read(text):
    assert str(parse_mode(text, 6)) == text


def test_only_what_is_shown_is_on():
    assert (Mode("full").diffuse, Mode("full").specular) == (True, True)
    assert (Mode("specular").diffuse, Mode("specular").specular) == (False, True)
    assert (Mode("none").diffuse, Mode("none").specular) == (True, True)
    assert (Mode("lobe", 2).diffuse, Mode("lobe", 2).specular) == (True, False)


@pytest.mark.parametrize("text", ["", "lobe", "lobe:6", "lobe:-1", "lobe:x", "full:1", "blur"])
def test_other_modes_are_refused(text):
    with pytest.raises(InputError, match=r"lobe:0 \.\.\. lobe:5, got"):
        parse_mode(text, 6)
