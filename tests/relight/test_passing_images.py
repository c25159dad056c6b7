"""Images that are wanted once, and then take no memory."""

from __future__ import annotations

import os
import sys

import numpy as np
import pytest

from skinbake.relight.passing_images import let_go, passing_zeros

MIB = 1 << 20


def resident_mib():
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / MIB


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems free pages when they see fit")
def test_memory_goes_back_part_by_part():
    """A quarter at a time; images beside it keep what they hold."""
    images = passing_zeros((4, 16 * MIB), np.uint8)
    assert not images.any()
    images += np.arange(1, 5, dtype=np.uint8)[:, None]
    before = resident_mib()
    let_go(images[1:2])
    assert before - resident_mib() > 12
    let_go(images[2:])
    assert before - resident_mib() > 40
    assert (images[0] == 1).all()
    assert not images[1:].any()


def test_neighbours_on_the_same_page_stay():
    """An image that begins and ends within pages leaves these alone, one smaller than a page all of its own."""
    images = passing_zeros((3, 5000), np.float32)
    images += np.float32([[1], [2], [3]])
    let_go(images[1])
    assert (images[[0, 2]] == [[1], [3]]).all()
    let_go(images[0, 10:20])
    assert (images[0] == 1).all()


def test_other_arrays_are_left_alone():
    """Whoever has an array of `np.zeros` loses nothing of it."""
    images = np.ones((2, MIB), np.float32)
    let_go(images[:1])
    assert images.all()
