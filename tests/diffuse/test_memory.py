"""A bake that would not fit is refused before it begins."""

import pytest

from skinbake.diffuse.memory import check_memory, memory_needed_bytes
from skinbake.errors import MachineError


def test_too_much_memory_is_refused_with_the_amount():
    """16384^2 of four lights on any machine here; 8192^2 of one light fits 24 GiB."""
    assert memory_needed_bytes((8192, 8192), 1) < 24 * 2**30
    with pytest.raises(MachineError, match=r"needs about \d+ GiB"):
        check_memory((1 << 17, 1 << 17), 4, 1, 6, "auto")


def test_light_that_is_shifted_is_held_twice():
    """The source itself at least, light by light."""
    more = memory_needed_bytes((1024, 1024), 3, beam=True) - memory_needed_bytes((1024, 1024), 3)
    assert 3 * 12 * 2**20 < more < 3 * 60 * 2**20
