"""A texture that the graphics card does not take is halved until it does."""

import numpy as np
import pytest
from OpenGL import GL

from skinbake.errors import MachineError
from skinbake.preview import textures
from tests.preview.scenes import scene


@pytest.fixture(scope="module", autouse=True)
def context():
    from skinbake.preview.draw import OffscreenRenderer

    try:
        with OffscreenRenderer(scene()):
            yield
    except MachineError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_what_is_too_large_is_halved(monkeypatch, dtype):
    """Twice here; each texel the mean of what it stands for. A driver without any room is an error."""
    room, taken = 7104 * np.dtype(dtype).itemsize, []

    def send(image, _):
        if image.nbytes > room:
            raise GL.GLError(GL.GL_OUT_OF_MEMORY, description=b"out of memory")
        taken.append(image)

    monkeypatch.setattr(textures, "_send", send)
    monkeypatch.setattr(textures, "SMALLEST", 20)
    ramp = np.broadcast_to(np.arange(150.0)[None, :, None, None], (2, 150, 131, 3)).astype(dtype)
    textures.upload(ramp)
    (found,) = taken
    assert found.shape == (2, 37, 32, 3)
    assert found.dtype == dtype
    np.testing.assert_allclose(found[1, :, 5, 2], 4 * np.arange(37) + 1.5)
    room = 10
    with pytest.raises(MachineError, match="took no texture"):
        textures.upload(ramp)


def test_no_more_is_sent_than_was_said(monkeypatch):
    """A picture of a huge bake needs no more; levels begin later."""
    taken = []
    monkeypatch.setattr(textures, "_send", lambda image, *_: taken.append(image))
    ramp = np.broadcast_to(np.arange(200.0, dtype=np.float32)[None, :, None, None], (1, 200, 99, 1))
    textures.upload(ramp, most=100)
    assert taken[0].shape == (1, 100, 49, 1)
    np.testing.assert_allclose(taken[0][0, :, 0, 0], 2 * np.arange(100) + 0.5)
    textures.upload_levels([np.zeros((8, 8, 4), np.float32), np.ones((4, 4, 4), np.float32)], most=4)
    assert taken[1].shape == (1, 4, 4, 4)


def test_one_texel_is_its_own_half():
    """And a row or a column keeps its length's half."""
    one = np.full((1, 1, 1, 3), 7, np.float32)
    np.testing.assert_array_equal(textures._halved(one), one)
    assert textures._halved(np.zeros((1, 1, 9, 1), np.float32)).shape == (1, 1, 4, 1)
