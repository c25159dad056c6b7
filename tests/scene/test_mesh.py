"""What is made of a mesh once."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.shapes import quad


def test_threads_that_ask_at_once_share_what_is_made():
    """The second one waits for the first."""
    mesh, made, asked = quad(10.0), [], threading.Event()

    def make(of):
        made.append(of)
        asked.wait(5)
        return object()

    with ThreadPoolExecutor(2) as pool:
        first, second = pool.submit(mesh.derived, make), pool.submit(mesh.derived, make)
        asked.set()
        assert first.result() is second.result() is mesh.derived(make)
    assert made == [mesh]


def test_what_fails_is_tried_again():
    def make(of):
        tries.append(of)
        if len(tries) == 1:
            raise ValueError("once")
        return "made"

    mesh, tries = quad(10.0), []
    with pytest.raises(ValueError, match="once"):
        mesh.derived(make)
    assert mesh.derived(make) == "made"
