"""Loops over threads do every number once, whoever calls them, and say what went wrong."""

import os
import subprocess
import sys
import threading

import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.kernels.threads import for_slices, on_threads, parallel_for, processors, thread_count
from tests.conftest import ROOT


@pytest.fixture(params=[1, 2, 4])
def threads(request, monkeypatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", str(request.param))
    return request.param


@pytest.mark.parametrize("count", [0, 1, 2, 3, 17, 1000])
def test_every_number_is_done_once(threads, count):
    """In ranges that meet, on any number of threads; where there is nothing, nothing is called."""
    done, ranges = np.zeros(count, np.int64), []

    def work(first, stop, step):
        ranges.append((first, stop))
        done[first:stop] += step

    parallel_for(work, count, 3)
    assert (done == 3).all()
    assert all(first < stop for first, stop in ranges)
    for_slices(lambda part: done.__setitem__(part, done[part] + 1), count, 7)
    assert (done == 4).all()


def test_threads_work_at_once(monkeypatch):
    """Two parts wait for one another: done one after the other, they would wait for ever."""
    monkeypatch.setenv("NUMBA_NUM_THREADS", "2")
    barrier = threading.Barrier(2, timeout=60)
    names = set()

    def work(k):
        barrier.wait()
        names.add(threading.current_thread().name)

    on_threads(work, 2)
    assert len(names) == 2


def test_a_loop_inside_a_loop_ends(threads):
    """Also where every thread is already busy with the outer one."""
    done = np.zeros((16, 16), np.int64)
    on_threads(lambda i: on_threads(lambda j: done.__setitem__((i, j), 1), 16), 16)
    assert done.all()


def test_what_goes_wrong_is_raised(threads):
    """Once, and the threads serve the next loop."""
    done = []

    def work(k):
        if k == 3:
            raise ValueError("three")
        done.append(k)

    with pytest.raises(ValueError, match="three"):
        on_threads(work, 10_000)
    assert len(done) < 10_000
    parallel_for(lambda first, stop: done.extend(range(first, stop)), 5)


@pytest.mark.parametrize(
    ("asked", "threads"), [("1", 1), ("2", 2), (" 2 ", 2), ("", None), ("100000", 4), (None, None)]
)
def test_the_environment_says_how_many(monkeypatch, asked, threads):
    """NUMBA_NUM_THREADS, else the processors; four times these at most."""
    if asked is None:
        monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    else:
        monkeypatch.setenv("NUMBA_NUM_THREADS", asked)
    assert thread_count() == (threads * processors() if asked == "100000" else threads or processors())


@pytest.mark.parametrize("asked", ["0", "-1", "two", "1.5"])
def test_a_number_of_threads_that_cannot_be_is_refused(monkeypatch, asked):
    """By name, on the command line before anything is loaded."""
    monkeypatch.setenv("NUMBA_NUM_THREADS", asked)
    with pytest.raises(InputError, match="NUMBA_NUM_THREADS: expected a whole number from 1 on"):
        thread_count()


def test_a_forked_process_has_threads_of_its_own(monkeypatch):
    """Its parent's are not there: waiting for them would never end."""
    code = """
import os, sys
from skinbake.kernels.threads import parallel_for
done = []
work = lambda first, stop: done.extend(range(first, stop))
parallel_for(work, 100)
if os.fork() == 0:
    parallel_for(work, 100)
    os._exit(sorted(done) != sorted(2 * list(range(100))))
sys.exit(os.waitstatus_to_exitcode(os.wait()[1]))
"""
    environment = os.environ | {"NUMBA_NUM_THREADS": "2", "PYTHONPATH": str(ROOT)}
    assert subprocess.run([sys.executable, "-W", "ignore", "-c", code], env=environment, timeout=120).returncode == 0
