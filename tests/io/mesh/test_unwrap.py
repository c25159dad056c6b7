"""Layouts are made once, and who waits for one is told."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest

from skinbake.io.mesh import unwrap, xatlas_layout
from tests.shapes import relief

pytestmark = pytest.mark.slow  # processes, waits, or many bakes


@pytest.fixture
def large(monkeypatch, tmp_path):
    """A mesh that counts as large, and an empty cache."""
    monkeypatch.setattr(unwrap, "SMALL_FACES", 0)
    monkeypatch.setattr(xatlas_layout, "SMALL_FACES", 0)
    monkeypatch.setattr(xatlas_layout, "TICK_S", 0.02)
    monkeypatch.setenv("SKINBAKE_CACHE", str(tmp_path / "cache"))
    return relief(segments=6)


class Waits(list):
    """What was said, and how often it ticked."""

    ticks = 0

    @contextmanager
    def __call__(self, what, seconds):
        self.append((what, seconds))

        def tick():
            self.ticks += 1

        yield tick


def test_a_layout_is_made_once(large):
    """The second time the same comes from the cache, and nobody waits."""
    waits = Waits()
    first = unwrap.unwrap_mesh(large, waiting=waits)
    assert waits == [(f"xatlas unwraps {len(large.faces)} triangles", unwrap.unwrap_seconds(len(large.faces)))]
    assert waits.ticks
    second = unwrap.unwrap_mesh(large, waiting=waits)
    np.testing.assert_array_equal(first.corner_uv, second.corner_uv)
    assert len(waits) == 1


def test_a_damaged_layout_is_made_again(large, tmp_path):
    """As if it were not there."""
    first = unwrap.unwrap_mesh(large)
    (entry,) = (tmp_path / "cache").rglob("*.npz")
    entry.chmod(0o600)
    entry.write_bytes(entry.read_bytes()[:100])
    np.testing.assert_array_equal(unwrap.unwrap_mesh(large).corner_uv, first.corner_uv)


def test_a_long_wait_is_told(large, monkeypatch):
    """What for, and for about how long; the layout that is kept is not waited for."""
    told = []

    @contextmanager
    def waiting(what, seconds):
        told.append((what, seconds))
        yield lambda: None

    for _ in range(2):
        unwrap.unwrap_mesh(large, waiting=waiting)
    assert told == [(f"xatlas unwraps {len(large.faces)} triangles", unwrap.unwrap_seconds(len(large.faces)))]


def test_a_process_that_starts_slowly_gets_the_whole_mesh(large, monkeypatch):
    """More than a pipe holds, and a first look at the process long before it reads."""
    monkeypatch.setattr(xatlas_layout, "TICK_S", 1e-4)
    mesh = relief(segments=60)
    assert mesh.faces.nbytes > 1 << 16
    _, corner, _ = xatlas_layout.xatlas_layout(mesh.positions_mm.astype(np.float32), mesh.faces.astype(np.uint32), 4)
    assert corner.shape == mesh.faces.shape
