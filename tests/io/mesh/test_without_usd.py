"""Without usd-core a USD file is refused with the way out; time is asked of no other file."""

from __future__ import annotations

import sys

import pytest

from skinbake.errors import InputError
from skinbake.io.mesh import mesh_files, write_obj
from skinbake.io.mesh.raw_file import read_raw
from tests.shapes import quad


def test_the_reader_is_named(tmp_path, monkeypatch):
    """With the command that installs it."""
    monkeypatch.setitem(sys.modules, "pxr", None)
    path = tmp_path / "head.usdc"
    path.write_bytes(b"PXR-USDC")
    with pytest.raises(InputError, match=r"head\.usdc: is a USD file; install its reader with pip install 'ski"):
        read_raw(path)
    assert mesh_files(path) == (path,)


def test_an_obj_knows_no_time(tmp_path):
    """`mesh.time` is refused by name."""
    write_obj(tmp_path / "a.obj", quad())
    with pytest.raises(InputError, match=r"a\.obj: mesh\.time: expected a USD file, which knows time, got \.obj"):
        read_raw(tmp_path / "a.obj", time=1.0)


def test_an_obj_has_no_other_uvs(tmp_path):
    """`uv_set` is refused by the name of its key, the mesh's or an occluder's."""
    write_obj(tmp_path / "a.obj", quad())
    for key in ("mesh", "occluders"):
        with pytest.raises(InputError, match=rf"a\.obj: {key}\.uv_set: expected a glTF or USD file, .* got \.obj"):
            read_raw(tmp_path / "a.obj", uv_set=0, key=key)
