"""PNGs hold exactly the bytes given, the same file each time, whole or not at all."""

import cv2
import numpy as np
import pytest

from skinbake.errors import InputError
from skinbake.io.image import read_map
from skinbake.io.png import has_one_colour, write_png


def test_pixels_come_back_exactly_and_bytes_repeat(tmp_path):
    rgb = np.random.default_rng(0).integers(0, 256, (13, 29, 3), dtype=np.uint8)
    write_png(tmp_path / "a.png", rgb)
    write_png(tmp_path / "b.png", rgb[:, ::-1][:, ::-1])
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "a.png"))[..., ::-1], rgb)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.png", "b.png"]


def test_what_is_written_is_read_as_a_map(tmp_path):
    rgb = np.arange(30, dtype=np.uint8).reshape(2, 5, 3) * 8
    write_png(tmp_path / "deep" / "x.png", rgb)
    np.testing.assert_allclose(read_map(tmp_path / "deep" / "x.png", 3, "linear"), rgb / 255, atol=1e-7)


def test_another_suffix_and_other_pixels_are_refused(tmp_path):
    rgb = np.zeros((4, 4, 3), np.uint8)
    with pytest.raises(InputError, match=r"ends in \.png"):
        write_png(tmp_path / "a.jpg", rgb)
    with pytest.raises(ValueError, match="uint8 of shape"):
        write_png(tmp_path / "a.png", rgb.astype(np.float32))
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="expected a folder"):
        write_png(tmp_path / "file" / "a.png", rgb)


@pytest.mark.parametrize("shape", [(1, 1), (60, 80), (768, 960)])
def test_a_picture_of_one_colour_is_known(tmp_path, shape):
    """One other pixel is enough; a file that is none shows nothing of anything."""
    path, pixels = tmp_path / "a.png", np.full((*shape, 3), 40, np.uint8)
    write_png(path, pixels)
    assert has_one_colour(path)
    assert not has_one_colour(tmp_path / "none.png")
    if pixels.size > 3:
        pixels[shape[0] // 2, 3, 1] = 41
        write_png(path, pixels)
        assert not has_one_colour(path)
