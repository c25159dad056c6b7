"""Three lights in a texture: what is put in comes out again, by files, too."""

from __future__ import annotations

import json

import numpy as np
import pytest

from skinbake.io.exr import read_parts
from skinbake.io.relight import USE, transfer_of, write_transfer
from skinbake.relight.basis import LightBasis
from skinbake.relight.grey_lights import keep_light, lights_in, summed
from skinbake.relight.relit import relit
from skinbake.relight.transfer import Transfer

BASIS = LightBasis("fitted", np.random.default_rng(5).standard_normal((8, 9)), np.zeros((9, 0)), 6)


def filled(images):
    """Textures of `BASIS` that hold these images of its lights."""
    textures = np.zeros((BASIS.textures, *images.shape[1:]), np.float32)
    for k, image in enumerate(images):
        keep_light(textures, BASIS, k, image)
    return textures


@pytest.fixture(scope="module")
def images():
    """What 8 lights leave on skin whose colour differs from place to place; all but the second leave that colour."""
    rng = np.random.default_rng(4)
    colour = rng.uniform(0.2, 1, (5, 7, 3))
    bright = rng.standard_normal((8, 5, 7, 1))
    bright[0] = 1 + bright[0] ** 2
    found = (bright * colour).astype(np.float32)
    found[1] = rng.standard_normal((5, 7, 3))
    return found


def test_one_texture_in_four_is_in_colour():
    """So many lights have a texture each, the others share one by three."""
    assert [lights_in(count) for count in (1, 4, 9, 32)] == [(1, 0), (1, 9), (3, 18), (8, 72)]
    assert (BASIS.in_colour, BASIS.textures, len(BASIS)) == (2, 4, 8)


def test_light_of_the_skin_s_colour_comes_out_as_it_went_in(images):
    """A sum of lights by channel is that of their images; `relit` has no light below 0."""
    amount = np.random.default_rng(6).standard_normal((8, 3))
    exact = np.einsum("khwc,kc->hwc", images, amount)
    found = summed(filled(images), BASIS, amount)
    np.testing.assert_allclose(found, exact, atol=1e-5)
    np.testing.assert_allclose(relit(filled(images), BASIS, amount), np.maximum(exact, 0), atol=1e-5)


def test_of_another_colour_the_nearest_is_kept(images):
    """What is lost of a light is at right angles to the first one's colour; where that is black, all of it."""
    changed = images.copy()
    changed[5] = images[1]
    changed[0, 0, 0] = 0
    alone = np.zeros((8, 3))
    alone[5] = 1
    found = summed(filled(changed), BASIS, alone)
    along = ((found - images[1]) * changed[0]).sum(axis=2)
    np.testing.assert_allclose(along, 0, atol=1e-5)
    assert not found[0, 0].any()


def test_files_say_which_lights_a_part_holds(images, tmp_path):
    """Parts in colour, then grey ones; a file of an older version has a light a part, all in colour."""
    textures = filled(images).astype(np.float16)
    seen = {1001: np.ones((3, 2, 4, 3), np.float16)}
    write_transfer(tmp_path, Transfer(BASIS, {1001: textures}, seen, {}, (7, 5), ()), "a", {}, "half", "zip", False)
    use = json.loads((tmp_path / USE).read_text())
    parts = {"basis.00": [0], "basis.01": [1], "grey.02": [2, 3, 4], "grey.05": [5, 6, 7]}
    assert use["parts"] == parts
    assert list(read_parts(tmp_path / "relight.exr")) == list(parts)
    found = transfer_of(tmp_path)
    assert found.basis.grey == 6
    amount = np.ones((8, 3))
    assert (summed(found.textures[1001], found.basis, amount) == summed(textures, BASIS, amount)).all()

    old = Transfer(
        LightBasis("fitted", BASIS.of_harmonics[:4], np.zeros((9, 0))), {1001: textures}, seen, {}, (7, 5), ()
    )
    write_transfer(tmp_path, old, "a", {}, "half", "zip", False)
    use = json.loads((tmp_path / USE).read_text())
    (tmp_path / USE).write_text(json.dumps({name: use[name] for name in use if name not in ("in_colour", "parts")}))
    assert transfer_of(tmp_path).basis.in_colour == 4
