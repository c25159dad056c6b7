"""Layouts by xatlas: in this process or another."""

from __future__ import annotations

import numpy as np
import pytest

from skinbake.errors import MachineError
from skinbake.io.mesh import xatlas_layout
from tests.shapes import relief


def test_another_process_gives_the_same_layout(monkeypatch):
    """What a large mesh gets, a small one would get too."""
    mesh = relief(segments=6)
    given = mesh.positions_mm.astype(np.float32), mesh.faces.astype(np.uint32), 4
    here = xatlas_layout.xatlas_layout(*given)
    monkeypatch.setattr(xatlas_layout, "SMALL_FACES", 0)
    for ours, theirs in zip(here, xatlas_layout.xatlas_layout(*given), strict=True):
        assert np.array_equal(ours, theirs)
        assert ours.dtype == theirs.dtype


def test_a_process_that_dies_is_told(monkeypatch):
    """Not a traceback of the other process."""
    monkeypatch.setattr(xatlas_layout, "SMALL_FACES", 0)
    monkeypatch.setattr(xatlas_layout.sys, "executable", "/bin/false")
    with pytest.raises(MachineError, match="xatlas ended with exit code 1"):
        xatlas_layout.xatlas_layout(np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.uint32), 4)
