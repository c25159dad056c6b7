import time
from types import SimpleNamespace

import numpy as np
import OpenImageIO as oiio
import pytest

from skinbake.errors import InputError, MachineError
from skinbake.io.exr import Part, read_parts, rgb_channels, write_parts
from skinbake.io.tx import HEADER_BYTES, is_current, tx_path, write_tx

HEIGHT, WIDTH = 37, 53


@pytest.fixture
def exr(tmp_path):
    """Two lights on a chart that covers the left half but for its top rows."""
    rng = np.random.default_rng(3)
    rgb = rng.uniform(0.5, 1.5, (HEIGHT, WIDTH, 3)).astype(np.float32)
    rgb[:, WIDTH // 2 :] = 0
    rgb[:7] = 0
    parts = [Part(n, rgb_channels(rgb * k), {"skinbake:key": n}) for n, k in (("irradiance", 3), ("light.key", 1))]
    write_parts(tmp_path / "lobe_0.exr", parts, {"skinbake:inputs": '{"mesh": "ab"}'})
    return tmp_path / "lobe_0.exr"


def levels(path):
    source = oiio.ImageInput.open(str(path))
    found = []
    while source.seek_subimage(0, len(found)):
        spec = source.spec()
        found.append((spec.width, spec.height, spec.tile_width, source.read_image(0, len(found), 0, 3, "float")))
    return found


@pytest.mark.parametrize("missing", [0, 1])
def test_a_disk_that_may_fill_up_is_refused(exr, monkeypatch, missing):
    """The library would wait for ever. 37 x 53 texels are one tile at each of six levels."""
    free = 6 * 64**2 * 3 * 2 + HEADER_BYTES - missing
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=free))
    if missing:
        with pytest.raises(MachineError, match="the disk is full"):
            write_tx(exr)
        assert sorted(path.name for path in exr.parent.iterdir()) == ["lobe_0.exr"]
    else:
        assert len(write_tx(exr)) == 2


def test_tiles_and_mip_levels_hold_the_same_light(exr):
    """Level 0 is the EXR to the last bit where charts are; the last level is one texel of about their mean."""
    written = write_tx(exr)
    assert [path.name for path in written] == ["lobe_0.tx", "lobe_0.key.tx"]
    rgb = read_parts(exr)["irradiance"].rgb
    found = levels(written[0])
    assert [level[:2] for level in found] == [(53, 37), (26, 18), (13, 9), (6, 4), (3, 2), (1, 1)]
    assert found[0][2] == 64
    known = rgb.any(axis=-1)
    np.testing.assert_array_equal(found[0][3][known], rgb[known])
    np.testing.assert_allclose(found[-1][3][0, 0], rgb[known].mean(axis=0), rtol=0.1)
    np.testing.assert_allclose(levels(written[1])[0][3][known], read_parts(exr)["light.key"].rgb[known])


def test_mip_levels_know_no_black_border(exr):
    """Off the chart the closest light goes on: no texel of any level is darker than the darkest of the chart."""
    assert min(level[3].min() for level in levels(write_tx(exr)[0])) >= 0.5 * 3 * 0.99


def test_black_skin_stays_black_where_the_atlas_says_it_is_skin(exr):
    """A shadow is no hole: with coverage given, what is dark on a chart is left dark."""
    coverage = np.zeros((2 * HEIGHT, 2 * WIDTH), np.float32)
    coverage[: 2 * HEIGHT, : 2 * (WIDTH // 2)] = 1
    top = levels(write_tx(exr, coverage)[0])[0][3]
    assert (top[:7, : WIDTH // 2] == 0).all()
    assert (top[20:, WIDTH // 2 + 2 :] > 0.5).all()


def test_the_same_file_gives_the_same_bytes(exr):
    """No date and no name of a temporary file in them."""
    first = [path.read_bytes() for path in write_tx(exr)]
    time.sleep(1.1)
    assert [path.read_bytes() for path in write_tx(exr)] == first


def test_a_texture_knows_what_it_was_made_from(exr):
    """Another bake makes it stale."""
    assert not is_current(exr)
    write_tx(exr)
    assert is_current(exr)
    parts = read_parts(exr)
    write_parts(exr, [Part(n, p.channels, {"skinbake:key": "new"}) for n, p in parts.items()])
    assert not is_current(exr)


def test_names_keep_the_tile_last(tmp_path):
    """Renderers look for the number before the suffix."""
    assert tx_path(tmp_path / "lobe_0.1002.exr", "key").name == "lobe_0.key.1002.tx"
    assert tx_path(tmp_path / "irradiance.exr").name == "irradiance.tx"


def test_a_foreign_file_is_refused(tmp_path):
    """Only parts of a bake have names that tell what to do with them."""
    write_parts(tmp_path / "a.exr", [Part("beauty", {"R": np.zeros((3, 3), np.float32)})])
    with pytest.raises(InputError, match="expected parts irradiance"):
        write_tx(tmp_path / "a.exr")
