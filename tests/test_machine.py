"""What a process takes of the machine."""

import resource
import sys
import threading

import numpy as np
import pytest

from skinbake.cli.measuring import in_child
from skinbake.machine import reuse_freed


def _faults(list_of_counts):
    """Page faults of an array that is made, filled and let go."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    np.empty(1 << 26, np.uint8).fill(1)
    list_of_counts.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)


def counted(reuse):
    """Faults of three arrays of 64 MB, the last one another thread's; for a process of its own."""
    if reuse:
        reuse_freed()
    counts: list[int] = []
    _faults(counts)
    _faults(counts)
    thread = threading.Thread(target=_faults, args=(counts,))
    thread.start()
    thread.join()
    return counts


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other C libraries keep freed memory as they see fit")
def test_freed_memory_serves_the_next_array_of_any_thread():
    """Without it every array of that size is the system's to clear anew."""
    first, *later = in_child(counted, True)
    assert first >= 32  # huge pages at most
    assert max(later) < first / 4
    first, second, _ = in_child(counted, False)
    assert second > first / 2
