import os
import signal
import subprocess
import sys
import time

import pytest

from skinbake.errors import InputError
from skinbake.io.lock import LOCK, file_lock, folder_lock, holder, release, try_lock
from tests.conftest import ROOT

HOLD = """
import sys, time
from skinbake.io.lock import folder_lock
with folder_lock(sys.argv[1]):
    print("held", flush=True)
    sys.stdin.readline()
"""
# Read, think, write: the sum is short unless one process at a time does it
COUNT = """
import sys, time
from pathlib import Path
from skinbake.io.lock import file_lock
folder = Path(sys.argv[1])
for _ in range(25):
    with file_lock(folder / "lock"):
        count = int((folder / "count").read_text())
        time.sleep(0.0005)
        (folder / "count").write_text(str(count + 1))
"""


def start(code, folder):
    return subprocess.Popen(
        [sys.executable, "-c", code, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT
    )


def test_one_writer_at_a_time(tmp_path):
    """Four processes count to a hundred together, though the lock file is removed and made anew all the time."""
    (tmp_path / "count").write_text("0")
    processes = [start(COUNT, tmp_path) for _ in range(4)]
    for process in processes:
        with process:
            process.communicate(timeout=60)
        assert process.returncode == 0
    assert (tmp_path / "count").read_text() == "100"
    assert not (tmp_path / "lock").exists()


def test_a_killed_holder_leaves_no_stale_lock(tmp_path):
    """After SIGKILL the next one gets in at once, and sweeps away what was half-written."""
    with start(HOLD, tmp_path) as process:
        assert process.stdout.readline() == "held\n"
        assert try_lock(tmp_path / LOCK) is None
        assert holder(tmp_path / LOCK).startswith(f"process {process.pid} on ")
        (tmp_path / ".lobe_0.7.part.exr").write_text("half")
        process.send_signal(signal.SIGKILL)
        process.wait()
    begun = time.monotonic()
    with folder_lock(tmp_path):
        assert not list(tmp_path.glob(".*.part*"))
    assert time.monotonic() - begun < 5
    assert list(tmp_path.iterdir()) == []


def test_the_second_one_waits_and_says_so(tmp_path):
    """It names the one it waits for, then goes on."""
    said = []
    with start(HOLD, tmp_path) as process:
        assert process.stdout.readline() == "held\n"

        def say(text):
            said.append(text)
            process.stdin.write("go\n")
            process.stdin.flush()

        with folder_lock(tmp_path, say):
            assert process.wait(10) == 0
    assert said == [f"{tmp_path}: waiting for process {process.pid} on {os.uname().nodename} to finish with it"]


def test_threads_of_one_process_exclude_each_other_too(tmp_path):
    """The lock belongs to the open file, not to the process."""
    with file_lock(tmp_path / "lock"):
        assert try_lock(tmp_path / "lock") is None
    taken = try_lock(tmp_path / "lock")
    assert taken is not None
    release(tmp_path / "lock", taken)


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    """A file in the way is the user's to move."""
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="expected a folder"), folder_lock(tmp_path / "file" / "out"):
        pass
