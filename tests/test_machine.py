"""What a process takes of the machine."""

import resource
import subprocess
import sys
import threading

import numpy as np
import pytest

from skinbake.cli.child_process import in_child
from skinbake.errors import MachineError
from skinbake.irradiance.occluder import Occluder
from skinbake.machine import free_disk_bytes, require_memory, reuse_freed
from tests.conftest import ROOT
from tests.shapes import quad


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


@pytest.mark.parametrize(("option", "limit"), [("v", resource.RLIMIT_AS), ("d", resource.RLIMIT_DATA)])
def test_a_limit_that_leaves_too_little_is_told(monkeypatch, option, limit):
    """By its option and its number, before a library that cannot tell crashes; where there is none, nothing is."""
    require_memory(2**60, "all")
    unlimited = resource.RLIM_INFINITY, resource.RLIM_INFINITY
    # Far above what this process holds, whatever other tests have left in it
    monkeypatch.setattr(resource, "getrlimit", lambda of: (2**45, 2**45) if of == limit else unlimited)
    told = rf"a bake needs {2**26} MiB, .*\(ulimit -{option} {2**35}\) leaves \d+: raise it"
    with pytest.raises(MachineError, match=told):
        require_memory(2**46, "a bake")
    require_memory(2**10, "little")
    mesh = quad()
    monkeypatch.setattr(resource, "getrlimit", lambda of: (2**20, 2**20) if of == limit else unlimited)
    with pytest.raises(MachineError, match="tracing of rays needs 256 MiB"):
        Occluder(mesh)


def test_a_kernel_for_which_there_is_no_room_is_told():
    """LLVM would end the process: exit code 134 and its own words."""

    script = (
        "import resource, numpy as np; from pathlib import Path; from skinbake.kernels.half import as_half; "
        "values = np.zeros(7, np.float32); "
        "used = int(Path('/proc/self/statm').read_text().split()[0]) * resource.getpagesize(); "
        "resource.setrlimit(resource.RLIMIT_AS, (used + 40 * 2**20,) * 2); as_half(values)"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert "MachineError: loading of kernels needs 48 MiB" in done.stderr


def test_a_verb_says_what_its_libraries_need():
    """Rather than the traceback, or the hang, of one that finds no memory."""
    command = [sys.executable, "-m", "skinbake", "bake", "configs/head.yaml"]

    def limit():
        resource.setrlimit(resource.RLIMIT_DATA, (150 * 2**20, 150 * 2**20))

    done = subprocess.run(command, cwd=ROOT, preexec_fn=limit, capture_output=True, text=True, timeout=60)
    assert done.returncode == 3
    assert done.stderr.startswith("skinbake: loading its libraries needs 350 MiB, and the limit of this process")


def test_free_disk_is_that_of_where_a_folder_will_be(tmp_path):
    """Also before it is made."""
    free = free_disk_bytes(tmp_path)
    assert free > 0
    assert abs(free_disk_bytes(tmp_path / "not" / "yet") - free) < 1 << 33
