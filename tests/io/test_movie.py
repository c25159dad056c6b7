"""Frames as one file, whole or not at all; what is missing for it is told before anything is drawn."""

import os
from importlib.util import find_spec

import imageio.v3 as imageio
import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.io import movie
from skinbake.io.movie import refuse_movie, write_movie

FRAMES = [np.full((31, 45, 3), 40 * k, np.uint8) for k in range(5)]


def test_a_gif_holds_its_frames(tmp_path):
    """In order, each as long as the rate says, for ever; padded to an even size."""
    with write_movie(tmp_path / "a.gif", 25.0) as add:
        for frame in FRAMES:
            add(frame)
    found = imageio.imread(tmp_path / "a.gif", index=None)
    assert found.shape == (5, 32, 46, 3)
    assert np.abs(found.mean(axis=(1, 2, 3)) - [0, 40, 80, 120, 160]).max() < 3
    meta = imageio.immeta(tmp_path / "a.gif")
    assert (meta["duration"], meta["loop"]) == (40, 0)


def test_a_movie_that_is_given_up_leaves_nothing(tmp_path):
    """Neither half a file nor a temporary one."""

    def half():
        with write_movie(tmp_path / "a.gif", 25.0) as add:
            add(FRAMES[0])
            raise KeyError

    with pytest.raises(KeyError):
        half()
    assert os.listdir(tmp_path) == []


def test_what_is_missing_is_told_with_its_remedy(tmp_path, monkeypatch):
    """Another kind of file; no ffmpeg."""
    with pytest.raises(InputError, match=r"a\.avi: expected a name that ends in \.mp4 or \.gif, got \.avi"):
        refuse_movie("a.avi")
    monkeypatch.setattr(movie, "find_spec", lambda name: None if name == "imageio_ffmpeg" else find_spec(name))
    with pytest.raises(InputError, match=r"needs imageio_ffmpeg: pip install 'skinbake\[movie\]'; a \.gif needs no"):
        refuse_movie(tmp_path / "a.mp4")
    refuse_movie(tmp_path / "a.gif")
