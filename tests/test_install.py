"""Where pip is follows from what it says; where it fails, it is heard."""

import subprocess
import sys

from skinbake.install import follow
from skinbake.progress import Task
from tests.conftest import ROOT

SAID = """\
Obtaining file:///home/artist/skinbake
  Installing build dependencies: started
Collecting numpy>=2.0 (from skinbake==0.1.0)
  Downloading numpy-2.3.1-cp311-manylinux_x86_64.whl (16.9 MB)
Collecting pyrender-maintained==1.0.1 (from skinbake==0.1.0)
  Using cached pyrender_maintained-1.0.1-py3-none-any.whl (98 kB)
Installing collected packages: numpy, pyrender-maintained, skinbake
Successfully installed numpy-2.3.1
"""


def test_pip_is_followed_by_its_lines():
    """Packages as they come, then how many are unpacked."""
    task, notes = Task("installing"), []

    def lines():
        for line in SAID.splitlines(keepends=True):
            yield line
            notes.append(task.note)

    assert follow(lines(), task) == SAID.splitlines(keepends=True)
    assert notes[1] == "what builds them"
    assert notes[2] == "numpy, 1 so far"
    assert notes[4] == "pyrender-maintained, 2 so far"
    assert notes[-1] == "unpacking 3 packages"


def test_a_failure_is_pip_s_own(tmp_path):
    """Its words on stderr, its exit code; without any package but Python's own."""
    bare = [sys.executable, "-S", "-c", "import skinbake.install, sys; print('rich' in sys.modules)"]
    done = subprocess.run(bare, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
    command = [sys.executable, "-m", "skinbake.install", "--no-index", str(tmp_path / "nothing")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "nothing" in done.stderr
    assert "Traceback" not in done.stderr
