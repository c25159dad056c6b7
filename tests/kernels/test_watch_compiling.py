"""Whoever waits for kernels to be compiled is told so, and nobody else."""

import os
import pty
import subprocess
import sys

import pytest

from tests.conftest import ROOT

pytestmark = pytest.mark.slow  # processes, waits, or many bakes

LIBRARY = """
from skinbake.kernels.compile import kernel

@kernel
def half(x):
    return x / 2

@kernel
def quarter(x):
    return half(half(x))
"""
RUN = """
import sys
from skinbake.baking.stage_log import StageLog
log = StageLog(int(sys.argv[1]))
with log.telling_of_compiling():
    import library
    print(library.quarter(8.0), library.quarter(16.0))
    log.say("  a stage")
"""


@pytest.fixture
def python(tmp_path):
    """What a fresh interpreter says on stderr that bakes with this library; the cache is kept between calls."""
    (tmp_path / "library.py").write_text(LIBRARY)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": f"{tmp_path}:{ROOT}"}

    def run(*command, stderr=subprocess.PIPE):
        done = subprocess.run(
            [sys.executable, "-c", *command], cwd=tmp_path, env=environment, stdout=subprocess.PIPE, stderr=stderr
        )
        assert (done.returncode, done.stdout) == (0, b"2.0 4.0\n"), done.stderr
        return (done.stderr or b"").decode()

    return run


def test_a_line_tells_what_compiling_took_the_first_time(python):
    """Where stderr is no terminal, and it took no five seconds; nothing once the machine code is on the disk."""
    said = python(RUN, "1").splitlines()
    assert said[0] == "  a stage"
    assert said[1].startswith("  compiled 1 kernel in ")  # `half` is part of it
    assert python(RUN, "1").splitlines() == ["  a stage"]


def test_quiet_says_nothing(python):
    """Also while it compiles."""
    assert python(RUN, "0") == ""


def _piece(descriptor):
    """What is there to be read."""
    try:
        return os.read(descriptor, 1 << 16)
    except BlockingIOError:
        return b""


def test_a_bar_on_a_terminal(python):
    """Drawn while a kernel is compiled; lines of stages stand whole above it."""
    soon = "from skinbake import progress; progress.SHORT_S, progress.DRAW_S = 0.001, 0.01\n"
    ours, theirs = pty.openpty()
    try:
        python(soon + RUN, "1", stderr=theirs)
        os.set_blocking(ours, False)
        said = b""
        while piece := _piece(ours):
            said += piece
        said = said.decode()
    finally:
        os.close(ours)
        os.close(theirs)
    assert "compiling kernels, once" in said
    assert "━" in said
    assert "  a stage\r\n" in said
    assert "compiled 1 kernel" in said


def test_programs_are_told_through_logging(python):
    """At level INFO, once a process; with each name at level DEBUG."""
    code = "import logging; logging.basicConfig(level={0}, format='%(message)s')\nimport library\n" + (
        "logging.getLogger('numba').setLevel(30)\nprint(library.quarter(8.0), library.quarter(16.0))"
    )
    assert python(code.format("'DEBUG'")) == "compiling kernels, once ...\ncompiled library.quarter\n"
    assert python(code.format("'DEBUG'")) == ""


def test_the_collector_of_cycles_rests_while_kernels_are_compiled(python):
    """And is as it was before: at work, or switched off by somebody else; also after an error of the compiler."""
    code = """
import gc, sys, library
from skinbake.kernels.watch_compiling import watch_compiling
{0}
seen = []
with watch_compiling(lambda name, begun: seen.append((name, begun, gc.isenabled()))):
    try:
        library.half("text")
    except Exception as error:
        seen.append(type(error).__name__)
    print(library.quarter(8.0), library.quarter(16.0))
print(seen, gc.isenabled(), file=sys.stderr)
"""
    failed = [("library.half", True, False), ("library.half", False, True), "TypingError"]
    compiled = [("library.quarter", True, False), ("library.quarter", False, True)]
    assert python(code.format("")).strip() == f"{failed + compiled} True"
    off = [("library.half", True, False), ("library.half", False, False), "TypingError"]
    assert python(code.format("gc.disable()")).strip() == f"{off} False"
