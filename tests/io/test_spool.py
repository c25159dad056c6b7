"""Arrays in temporary files: the same values, no memory, nothing left behind."""

import os
import time
from pathlib import Path

import numpy as np
import pytest

from skinbake.io.spool import Spool

LARGE = np.arange(1 << 20, dtype=np.float32).reshape(512, 2048)


def resident_bytes() -> int:
    """Memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_values_stay_and_the_folder_is_empty(tmp_path):
    """Of every type and shape that is kept; also once their memory was freed, and when they were changed."""
    spool = Spool(tmp_path)
    for values in (LARGE, (LARGE % 999).astype(np.float16)[None], LARGE.T, LARGE[:0]):
        kept = spool.keep(values)
        spool.rest()
        assert kept.dtype == values.dtype
        np.testing.assert_array_equal(kept, values)
    kept = spool.keep_all({1001: LARGE})[1001]
    kept[3] = 7
    spool.rest()
    assert (kept[3] == 7).all()
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="tells no resident size")
def test_what_is_kept_takes_no_memory_until_it_is_read(tmp_path):
    """And none any more after `rest`."""
    spool, values = Spool(tmp_path), np.full((64, 1 << 20), 1, np.uint8)
    kept = spool.keep(values)
    before = resident_bytes()
    assert kept.sum() == values.size
    read = resident_bytes() - before
    spool.rest()
    assert read > 0.9 * values.nbytes
    assert resident_bytes() - before < 0.1 * values.nbytes


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="tells no resident size")
def test_no_more_than_was_said_is_in_memory(tmp_path):
    """However much is read: a thread frees it meanwhile. What was written stays."""
    spool = Spool(tmp_path, most_read=1 << 22)
    kept = spool.zeros((64, 1 << 20), np.uint8)
    before = resident_bytes()
    for number, row in enumerate(kept):
        row[:] = number
        deadline = time.monotonic() + 5
        while resident_bytes() - before > 1 << 23 and time.monotonic() < deadline:
            time.sleep(0.001)
        assert resident_bytes() - before < 1 << 24
    assert (kept == np.arange(64)[:, None]).all()


def test_arrays_are_made_in_files_and_kept_as_they_are(tmp_path):
    """Nothing is copied twice."""
    spool = Spool(tmp_path)
    made = spool.zeros(LARGE.shape, np.float16)
    assert made.shape == LARGE.shape
    assert made.dtype == np.float16
    assert not made.any()
    assert spool.keep(made) is made
    assert spool.keep(made[1:]).base is not None
    assert Spool().zeros((3, 2), np.int32).tolist() == [[0, 0]] * 3


def test_a_system_that_reserves_no_room_writes_zeros(tmp_path, monkeypatch):
    """In pieces."""
    monkeypatch.delattr(os, "posix_fallocate")
    monkeypatch.setattr("skinbake.io.spool._AT_ONCE", 1 << 20)
    made = Spool(tmp_path).zeros((3, 1000, 777), np.float16)
    assert not made.any()
    made[:] = 7
    assert (Spool(tmp_path).keep(LARGE) == LARGE).all()


def test_a_full_disk_leaves_arrays_in_memory(tmp_path, monkeypatch):
    """Found before the first value is written, which would end the process."""

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    made = Spool(tmp_path).zeros(LARGE.shape, np.float32)
    made[:] = LARGE
    np.testing.assert_array_equal(made, LARGE)
    assert Spool(tmp_path).keep(LARGE) is LARGE


def test_without_a_folder_the_arrays_themselves_are_kept(tmp_path):
    """Also where no file can be made; small ones always."""
    assert Spool().keep(LARGE) is LARGE
    assert Spool(tmp_path / "none").keep(LARGE) is LARGE
    small = LARGE[:1]
    assert Spool(tmp_path).keep(small) is small


def test_the_file_of_an_array_that_is_gone_serves_the_next_one(tmp_path):
    """Cleared, also for one that is a little smaller; not while a view of it is left, and not for a far smaller one."""
    spool = Spool(tmp_path)
    made = spool.zeros((1024, 2048), np.float32)
    made[:] = 7
    address, view = made.ctypes.data, made[5:7, ::3].view(np.int32)
    del made
    other = spool.zeros((1024, 2048), np.float32)
    assert other.ctypes.data != address
    assert (view.view(np.float32) == 7).all()
    del view
    small = spool.zeros((512, 1024), np.float32)
    again = spool.zeros((1023, 2047), np.float32)
    assert small.ctypes.data != address
    assert again.ctypes.data == address
    assert not again.any()
    del again
    kept = spool.keep(LARGE.repeat(2, axis=0))
    assert kept.ctypes.data == address
    np.testing.assert_array_equal(kept, LARGE.repeat(2, axis=0))
    assert spool.empty((3, 4)).shape == (3, 4)


def test_idle_files_are_few_and_go_where_the_disk_is_full(tmp_path, monkeypatch):
    """Of no more bytes than was said; a file that finds no room beside them takes theirs."""
    monkeypatch.setattr("skinbake.io.spool.MOST_IDLE", 5 << 20)
    spool = Spool(tmp_path)
    arrays = [spool.zeros((n, 1 << 20), np.uint8) for n in (3, 3, 2)]
    del arrays
    assert sorted(len(content) >> 20 for content in spool._idle) == [2, 3]
    reserve, asked = os.posix_fallocate, []

    def full_once(*arguments):
        asked.append(len(spool._idle))
        if asked[-1]:
            raise OSError(28, "No space left on device")
        reserve(*arguments)

    monkeypatch.setattr(os, "posix_fallocate", full_once)
    assert spool.zeros((20, 1 << 20), np.uint8).shape == (20, 1 << 20)
    assert asked == [2, 0]
