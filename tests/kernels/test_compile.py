"""A kernel's name in the cache follows what is compiled, and nothing else."""

import importlib.util
import os
import shutil
import subprocess
import sys

import pytest
from numba.extending import is_jitted

from skinbake.kernels.compile import fingerprint
from tests.conftest import ROOT

pytestmark = pytest.mark.slow  # processes, waits, or many bakes

LIBRARY = '''
from typing import NamedTuple
import numpy as np
from skinbake.kernels import simd
from skinbake.kernels.compile import kernel

GAIN = 2.0
TABLE = np.arange(4.0)

class Pair(NamedTuple):
    a: float
    b: float

def plain(x):
    return x

@kernel(inline=True)
def inlined(x):
    """Docstring."""
    return x * 3.0

@kernel
def called(x):  # a comment
    return x * GAIN + TABLE[1]

@kernel
def user(x, pair):
    """First line.

    More.
    """
    if x < 0.0:
        return 0.0
    return inlined(x) + called(x) + pair.a

@kernel
def wide(x):
    return simd.gaussian(np.float32(x))

@kernel
def alone(x):
    for k in range(3):
        x += k
    return x
'''
NAMES = ("inlined", "called", "user", "wide", "alone")


def python(code, folder, cache, **environment):
    """What a fresh interpreter prints that has `folder` at the head of its path and its cache in `cache`."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": f"{folder}:{ROOT}"} | environment
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, env=environment, cwd=folder
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def fingerprints(folder, source):
    """Fingerprint of each kernel of a module with this text."""
    file = folder / "library.py"
    file.write_text(source)
    specification = importlib.util.spec_from_file_location("library", file)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return {name: fingerprint(getattr(module, name)) for name in NAMES}


EDITS = {
    "docstrings": ('"""Docstring."""', '"""Another.\n\n    Longer.\n    """', set()),
    "no docstring": ('    """Docstring."""\n', "", set()),
    "a docstring where none was": ("    return x * GAIN", '    """New."""\n    return x * GAIN', set()),
    "comments": ("# a comment", "# other words\n    # and lines", set()),
    "annotations": ("def alone(x):", "def alone(x: float) -> float:", set()),
    "place in the file": ("def plain(x):\n    return x\n", "\n\n\n\n", set()),
    "a function nobody calls": ("def plain(x):\n    return x\n", "def plain(x):\n    return -x\n", set()),
    "an inlined callee": ("x * 3.0", "x * 4.0", {"inlined", "user"}),
    "a called callee": ("x * GAIN +", "x * GAIN -", {"called", "user"}),
    "a callee's options": ("@kernel(inline=True)", "@kernel", {"inlined", "user"}),
    "a global number": ("GAIN = 2.0", "GAIN = 2.5", {"called", "user"}),
    "its type": ("GAIN = 2.0", "GAIN = 2", {"called", "user"}),
    "a global array": ("np.arange(4.0)", "np.arange(5.0)", {"called", "user"}),
    "a loop": ("range(3)", "range(4)", {"alone"}),
}  # fmt: skip


@pytest.fixture(scope="module")
def before(tmp_path_factory):
    return fingerprints(tmp_path_factory.mktemp("before"), LIBRARY)


@pytest.mark.parametrize("what", EDITS)
def test_an_edit_changes_those_kernels_that_see_it(tmp_path, before, what):
    """Docstrings, comments, annotations, line numbers and folders: none; code and constants: itself and its users."""
    old, new, changed = EDITS[what]
    assert old in LIBRARY
    after = fingerprints(tmp_path, LIBRARY.replace(old, new))
    assert {name for name in NAMES if after[name] != before[name]} == changed


@pytest.mark.parametrize(("old", "new", "differs"), [
    ('"""One float32 in every', '"""The same float32 in every', False),
    ("builder.fdiv(a, b)", "builder.fdiv(b, a)", True),
])  # fmt: skip
def test_edited_intrinsics_change_their_users(tmp_path, before, old, new, differs):
    """Also those that come in by an operator, which no name leads to; the module's docstrings do not."""
    copy = tmp_path / "skinbake"
    shutil.copytree(ROOT / "skinbake" / "kernels", copy / "kernels", ignore=shutil.ignore_patterns("__pycache__"))
    for needed in ("errors.py", "interrupt.py", "machine.py"):
        shutil.copy(ROOT / "skinbake" / needed, copy)
    (copy / "__init__.py").write_text("")
    text = (copy / "kernels" / "simd.py").read_text()
    assert old in text
    (copy / "kernels" / "simd.py").write_text(text.replace(old, new))
    (tmp_path / "library.py").write_text(LIBRARY)
    code = (
        "import library; from skinbake.kernels.compile import fingerprint as f; print(f(library.wide), f(library.user))"
    )
    wide, user = python(code, tmp_path, tmp_path)
    assert (wide != before["wide"], user != before["user"]) == (differs, False)


RUN = """
import library as l
x = {x}
print(l.alone(x), l.user(x, l.Pair(1.0, 5.0)), *(sum(k.stats.cache_misses.values()) for k in (l.alone, l.user)))
"""


def entries(cache):
    return sorted(cache.glob("*-*"))


def test_two_copies_of_the_code_share_the_machine_code(tmp_path):
    """Whichever folder they lie in; types of arguments have entries of their own."""
    cache = tmp_path / "cache"
    for copy in "ab":
        (tmp_path / copy).mkdir()
        (tmp_path / copy / "library.py").write_text("# moved\n" * (copy == "b") + LIBRARY)
    assert python(RUN.format(x=1.0), tmp_path / "a", cache) == ["4.0", "7.0", "1", "1"]
    kept = entries(cache)
    assert len(kept) == 3  # alone, user and called; the inlined one is never compiled by itself
    assert python(RUN.format(x=1.0), tmp_path / "b", cache) == ["4.0", "7.0", "0", "0"]
    assert entries(cache) == kept
    assert python(RUN.format(x=1), tmp_path / "b", cache)[2:] == ["1", "1"]


def test_a_kernel_is_compiled_from_stored_ones(tmp_path):
    """What it calls was loaded before, and is taken in by its bitcode."""
    (tmp_path / "library.py").write_text(LIBRARY)
    cache = tmp_path / "cache"
    python(RUN.format(x=1.0), tmp_path, cache)
    (entry,) = (each for each in entries(cache) if each.name.startswith("library.user-"))
    entry.unlink()
    called = RUN.format(x=1.0) + "print(l.called(1.0), *(sum(k.values()) for k in l.called.stats[1:]))"
    assert python(called, tmp_path, cache) == ["4.0", "7.0", "0", "1", "3.0", "1", "0"]


def test_stored_kernels_load_no_compiler(tmp_path):
    """numba's lists of what can be called in kernels take a quarter of a second."""
    (tmp_path / "library.py").write_text(LIBRARY)
    loaded = "; import sys; print('numba.cpython.randomimpl' in sys.modules)"
    for at, fills in enumerate(("True", "False")):
        found = python(RUN.format(x=1.0).strip() + loaded, tmp_path, tmp_path / "cache")
        assert found[2:] == [str(1 - at)] * 2 + [fills]


def test_fields_of_named_tuples_are_told_apart(tmp_path):
    """The kernel reads `pair.a`: the same types in another order are other machine code."""
    cache = tmp_path / "cache"
    for order in ("a: float\n    b: float", "b: float\n    a: float"):
        (tmp_path / "library.py").write_text(LIBRARY.replace("a: float\n    b: float", order))
        assert python(RUN.format(x=1.0).replace("1.0, 5.0", "a=1.0, b=5.0"), tmp_path, cache)[1] == "7.0"


@pytest.mark.parametrize(
    "damage", [lambda b: b"", lambda b: b[: len(b) // 2], lambda b: b[:99] + bytes([b[99] ^ 1]) + b[100:]]
)
def test_a_damaged_entry_is_compiled_anew(tmp_path, damage):
    """Empty, cut short or altered: as if missing; the next process finds a whole one again."""
    (tmp_path / "library.py").write_text(LIBRARY)
    cache = tmp_path / "cache"
    python(RUN.format(x=1.0), tmp_path, cache)
    for entry in entries(cache):
        entry.write_bytes(damage(entry.read_bytes()))
    assert python(RUN.format(x=1.0), tmp_path, cache) == ["4.0", "7.0", "1", "1"]
    assert python(RUN.format(x=1.0), tmp_path, cache) == ["4.0", "7.0", "0", "0"]


def test_processes_at_once_leave_whole_entries(tmp_path):
    """Each compiles what it does not find, and what the last one wrote serves everybody."""
    (tmp_path / "library.py").write_text(LIBRARY)
    cache = tmp_path / "cache"
    code = RUN.format(x=1.0)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": f"{tmp_path}:{ROOT}"}
    many = [subprocess.Popen([sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE) for _ in range(3)]
    assert {process.communicate()[0].split()[1] for process in many} == {b"7.0"}
    assert [p for p in cache.iterdir() if p.name.startswith(".")] == []
    assert python(code, tmp_path, cache) == ["4.0", "7.0", "0", "0"]


def test_the_folder_follows_the_environment(tmp_path):
    """NUMBA_CACHE_DIR, XDG_CACHE_HOME, ~/.cache; where none can be written, one of this user's for temporary files."""
    code = "from skinbake.kernels.compile import cache_folders as f; print(*f())"

    def folders(**environment):
        temporary = tmp_path / "tmp"
        temporary.mkdir(exist_ok=True)
        return python(code, ROOT, "", TMPDIR=str(temporary), **environment)

    (tmp_path / "file").write_text("")
    alone = [f"{tmp_path}/tmp/skinbake-kernels-{os.getuid()}"]
    assert folders(NUMBA_CACHE_DIR=f"{tmp_path}/n", XDG_CACHE_HOME=f"{tmp_path}/x") == [f"{tmp_path}/n"]
    assert folders(XDG_CACHE_HOME=f"{tmp_path}/x") == [f"{tmp_path}/x/skinbake/kernels"]
    assert folders(XDG_CACHE_HOME="", HOME=f"{tmp_path}/h") == [f"{tmp_path}/h/.cache/skinbake/kernels"]
    assert folders(XDG_CACHE_HOME=f"{tmp_path}/file") == alone
    assert folders(XDG_CACHE_HOME="relative") == alone
    (tmp_path / "tmp" / f"skinbake-kernels-{os.getuid()}").chmod(0o777)
    assert folders(XDG_CACHE_HOME=f"{tmp_path}/file") == []  # anybody's machine code is not run


def test_without_any_folder_kernels_still_run(tmp_path):
    """Compiled for this process alone."""
    (tmp_path / "library.py").write_text(LIBRARY)
    (tmp_path / "file").write_text("")
    for _ in range(2):
        found = python(RUN.format(x=1.0), tmp_path, tmp_path / "file", TMPDIR=str(tmp_path), HOME="/nowhere")
        assert found[1] == "7.0"
        (tmp_path / f"skinbake-kernels-{os.getuid()}").chmod(0o777)


def test_unused_entries_go_after_a_month(tmp_path):
    """Swept by the first process that adds one; what was read lately stays."""
    cache = tmp_path / "cache"
    cache.mkdir()
    for name, days in (("old-0", 31), ("new-0", 29), (".part-old", 2), (".part-new", 0)):
        (cache / name).write_bytes(b"")
        then = os.stat(cache / name).st_mtime - days * 86400
        os.utime(cache / name, (then, then))
    (tmp_path / "library.py").write_text(LIBRARY)
    python(RUN.format(x=1.0), tmp_path, cache)
    assert {"old-0", "new-0", ".part-old", ".part-new"} & {p.name for p in cache.iterdir()} == {"new-0", ".part-new"}


def test_a_global_that_cannot_be_described_is_refused(tmp_path):
    """Rather than keep machine code whose change nobody would see."""
    (tmp_path / "library.py").write_text(LIBRARY.replace("GAIN = 2.0", "GAIN = {}"))
    code = "import library as l\ntry: l.called(1.0)\nexcept TypeError as e: print(e)"
    assert " ".join(python(code, tmp_path, tmp_path)) == "a kernel cannot read a global of type dict: {}"


def test_every_kernel_of_the_package_has_a_fingerprint():
    """Nothing that one of them reads is of a kind the cache cannot see; two of them never share one."""
    found = {}
    for file in (ROOT / "skinbake").rglob("*.py"):
        if "import kernel\n" in file.read_text():
            module = importlib.import_module(".".join(file.relative_to(ROOT).with_suffix("").parts))
            found |= {value: fingerprint(value) for value in vars(module).values() if is_jitted(value)}
    assert len(found) > 80
    assert len(set(found.values())) == len(found)
