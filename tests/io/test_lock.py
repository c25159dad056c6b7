import errno
import fcntl
import os
import signal
import subprocess
import sys
import time

import pytest

from skinbake.errors import InputError
from skinbake.io.lock import LOCK, Lock, file_lock, folder_lock, remove_leftovers
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
        assert not Lock(tmp_path / LOCK).acquire()
        assert Lock(tmp_path / LOCK).holder().startswith(f"process {process.pid} on ")
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
        assert not Lock(tmp_path / "lock").acquire()
    taken = Lock(tmp_path / "lock")
    assert taken.acquire()
    taken.release()
    assert list(tmp_path.iterdir()) == []


def test_a_stopped_holder_is_told_as_such(tmp_path):
    """Who waits for a process that was stopped learns what lets it go on."""
    with start(HOLD, tmp_path) as process:
        assert process.stdout.readline() == "held\n"
        process.send_signal(signal.SIGSTOP)
        deadline = time.monotonic() + 10
        while "stopped" not in Lock(tmp_path / LOCK).holder():
            assert time.monotonic() < deadline
        assert Lock(tmp_path / LOCK).holder().endswith(f"which is stopped (kill -CONT {process.pid} lets it go on)")
        process.send_signal(signal.SIGCONT)
        process.communicate("go\n", timeout=30)


@pytest.mark.parametrize("target", ["there", "gone"])
def test_a_lock_that_is_a_symbolic_link_is_not_followed(tmp_path, target):
    """Its target keeps its bytes and is not made; the message says what to do."""
    (tmp_path / "there").write_text("precious")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / LOCK).symlink_to(tmp_path / target)
    with pytest.raises(InputError, match=r"\.lock: expected a lock file, got a symbolic link"):
        folder_lock(tmp_path / "out").__enter__()
    assert (tmp_path / "there").read_text() == "precious"
    assert not (tmp_path / "gone").exists()
    assert Lock(tmp_path / "out" / LOCK).holder() == "another process"


def test_a_lock_that_another_one_was_put_in_place_of_is_left(tmp_path):
    """Only the file that was locked is removed at the end."""
    with file_lock(tmp_path / "lock"):
        (tmp_path / "lock").unlink()
        (tmp_path / "lock").write_text("somebody else's")
    assert (tmp_path / "lock").read_text() == "somebody else's"


def test_only_half_written_files_are_swept_away(tmp_path):
    """A file whose name is merely like one of ours is somebody's."""
    ours = [".lobe_0.7.part.exr", ".bake.4711.part.json", ".a.b.12.part"]
    theirs = [".holiday.parts", ".my.part.txt", ".x.7.part.tar.gz", "lobe_0.7.part.exr", ".7.part.exr"]
    for name in (*ours, *theirs):
        (tmp_path / name).touch()
    with folder_lock(tmp_path):
        assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*theirs, LOCK])


def test_a_file_system_without_locks_is_worked_on_without(tmp_path, monkeypatch):
    """Some network disks know none; the lock file goes all the same."""

    def refuse(descriptor, operation):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", refuse)
    with folder_lock(tmp_path):
        assert (tmp_path / LOCK).exists()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    """A file in the way is the user's to move."""
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="expected a folder"), folder_lock(tmp_path / "file" / "out"):
        pass


def test_what_a_killed_writer_left_is_removed_unless_somebody_writes(tmp_path):
    """Its lock file and what it had not finished; nothing of one that lives, and no file of others."""
    for name in (".lock", ".lobe_0.77.part.exr", "lobe_1.exr", ".mine"):
        (tmp_path / name).write_text("left")
    with folder_lock(tmp_path):
        (tmp_path / ".lobe_2.78.part.exr").write_text("at work")
        remove_leftovers(tmp_path)
        assert (tmp_path / ".lobe_2.78.part.exr").exists()
        assert (tmp_path / ".lock").exists()
    (tmp_path / ".lock").write_text("left")
    remove_leftovers(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [".mine", "lobe_1.exr"]
    remove_leftovers(tmp_path / "nowhere")
