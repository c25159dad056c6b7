"""OBJ files in the user's cache."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from skinbake.io.mesh import kept_obj, write_obj
from skinbake.io.mesh.obj import read_obj
from tests.shapes import sphere


def test_a_large_file_is_read_once(tmp_path, monkeypatch):
    """What the cache gives is what the text gives, names and colours too; another text is read anew."""
    monkeypatch.setenv("SKINBAKE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(kept_obj, "WORTH_BYTES", 1)
    path = tmp_path / "a.obj"
    write_obj(path, sphere(20.0, "cube", 4))
    lines = [f"{line} 0.8 0.6 0.5" if line.startswith("v ") else line for line in path.read_text().splitlines()]
    path.write_text("\n".join(["o Skin \u00e9", *lines]) + "\n", encoding="utf-8")
    want = read_obj(path)
    read = []
    monkeypatch.setattr(kept_obj, "read_obj", lambda path: read.append(path) or read_obj(path))
    for _ in range(3):
        got = kept_obj.read_kept_obj(path)
        for field in fields(want):
            a, b = getattr(got, field.name), getattr(want, field.name)
            if isinstance(b, np.ndarray):
                np.testing.assert_array_equal(a, b)
                assert a.dtype == b.dtype
            else:
                assert a == b
    assert len(read) == 1
    path.write_text(path.read_text(encoding="utf-8").replace("0.8", "0.7"), encoding="utf-8")
    assert kept_obj.read_kept_obj(path).corner_rgb.max() < want.corner_rgb.max()
    assert len(read) == 2
