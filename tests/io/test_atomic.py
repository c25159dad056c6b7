import errno
import os
import subprocess
import sys

import pytest

from skinbake.errors import InputError, MachineError
from skinbake.io.atomic import atomic_write, system_error, temporary_files, write_text


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path):
    """Whole or not at all: an error half way through changes nothing."""
    path = tmp_path / "a.json"
    write_text(path, "old")

    def fail():
        with atomic_write(path) as beside:
            beside.write_text("ne")
            raise RuntimeError("half way")

    with pytest.raises(RuntimeError, match="half way"):
        fail()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.json"]


@pytest.mark.parametrize("name", ["a" * 251 + ".png", "\u00e9" * 125 + ".png"])
def test_a_name_may_be_as_long_as_names_may_be(tmp_path, name):
    """Its temporary one is no longer, and is known as such."""
    with atomic_write(tmp_path / name) as temporary:
        temporary.write_text("half")
        assert temporary_files(tmp_path) == [temporary]
        temporary.write_text("whole")
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "whole"


def test_folders_are_made(tmp_path):
    """A bake folder need not exist before."""
    write_text(tmp_path / "a" / "b" / "c.txt", "text")
    assert (tmp_path / "a" / "b" / "c.txt").read_text() == "text"


@pytest.mark.parametrize(
    ("number", "kind", "says"),
    [
        (errno.ENOSPC, MachineError, "disk is full"),
        (errno.EFBIG, MachineError, "file is larger than"),
        (errno.EIO, MachineError, "a.txt: cannot be written"),
        (errno.EACCES, InputError, "can be written to"),
        (errno.EROFS, InputError, "can be written to"),
        (errno.ENOTDIR, InputError, "file in the way"),
        (errno.ELOOP, InputError, "links that lead in a circle"),
    ],
)
def test_the_systems_errors_say_what_to_do(tmp_path, number, kind, says):
    """Exit code 3 where the machine failed, 2 where the choice of folder did."""
    with pytest.raises(kind, match=says), atomic_write(tmp_path / "a.txt"):
        raise OSError(number, os.strerror(number))


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG])
def test_a_library_s_words_are_understood(tmp_path, number):
    """It gives the system's text, and no number."""
    found = system_error(tmp_path / "a.exr", f"Failed to write pixel data. {os.strerror(number)}.")
    assert found.errno == number


@pytest.mark.parametrize("name", ["a.exr", "a.png", "a.gif"])
def test_files_that_may_not_grow_are_told_by_name(tmp_path, name):
    """Really done, in a process of its own: also where lobes are packed beside any file of ours."""
    script = f"""
import resource, numpy as np
from pathlib import Path
from skinbake.io.exr import Part, pack_parts, rgb_channels
from skinbake.io.movie import write_movie
from skinbake.io.png import write_png
pixels = np.random.default_rng(0).integers(0, 255, (256, 256, 3)).astype(np.uint8)
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
path = Path({str(tmp_path / name)!r})
if path.suffix == ".png":
    write_png(path, pixels)
elif path.suffix == ".gif":
    with write_movie(path, 10) as add:
        add(pixels)
else:
    pack_parts(path, [Part("", rgb_channels(pixels.astype(np.float32)))], None)
"""
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert f"MachineError: {tmp_path / name}: the file is larger than the disk's format or `ulimit -f` " in found.stderr
    assert "Exception ignored" not in found.stderr
    assert name == "a.exr" or list(tmp_path.iterdir()) == []  # lobes are packed into what is no result yet


def test_a_file_where_a_folder_should_be_is_told(tmp_path):
    """Really done, not simulated."""
    (tmp_path / "out").write_text("a file")
    with pytest.raises(InputError, match="expected a folder"):
        write_text(tmp_path / "out" / "a.txt", "text")


def test_names_of_our_own_making_are_told_from_others(tmp_path):
    """Also the file that OpenImageIO writes beside a `.tx` while it makes it; other people's files are left alone."""
    ours = {".lobe_1.exr.77.part", ".lobe_1.77.part.exr", ".lobe_1.key.6632.part.a87d17ba.temp.tx"}
    others = {".parts", ".a.part.exr", ".a.77.parts", "a.77.part.exr", ".a.77.part.tx.bak.old", "b.a87d17ba.temp.tx"}
    for name in ours | others:
        (tmp_path / name).touch()
    assert {path.name for path in temporary_files(tmp_path)} == ours
