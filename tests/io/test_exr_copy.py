"""A copy of an EXR under another header is the file that the library would write."""

import numpy as np
import pytest

from skinbake.io.exr import Part, rgb_channels, write_parts
from skinbake.io.exr_copy import copy_parts

COMMON = {"skinbake:key": "k", "skinbake:error": "null"}
FIRST = {"skinbake:method": "identity", "skinbake:variance_mm2": 0.25, "skinbake:weight_rgb": [0.1, 0.2, 0.3]}
OTHER = FIRST | {"skinbake:variance_mm2": 4.0, "skinbake:weight_rgb": [1.0, 0.0, 0.5], "skinbake:diffusion": "{}" * 99}


@pytest.mark.parametrize("precision", ["half", "float"])
@pytest.mark.parametrize("names", [["irradiance"], ["irradiance", "light.key", "light.rim"]])
@pytest.mark.parametrize("compression", ["auto", "htj2k"])
def test_a_copy_has_the_bytes_of_what_the_library_writes(tmp_path, names, precision, compression):
    random = np.random.default_rng(1)
    parts = [Part(name, rgb_channels(random.random((70, 33, 3)).astype(np.float32))) for name in names]
    source, wanted, path = (tmp_path / name for name in ("a.exr", "b.exr", "c.exr"))
    write_parts(source, parts, COMMON | FIRST, precision, compression)
    write_parts(wanted, parts, COMMON | OTHER, precision, compression)
    assert copy_parts(source, path, OTHER)
    assert path.read_bytes() == wanted.read_bytes()


def test_what_is_laid_out_otherwise_is_not_copied(tmp_path):
    source = tmp_path / "a.exr"
    write_parts(source, [Part("", rgb_channels(np.ones((40, 8, 3), np.float32)))], COMMON | FIRST)
    for damaged in (source.read_bytes()[:300], source.read_bytes()[:-400], b"\0" * 64):
        source.write_bytes(damaged)
        assert not copy_parts(source, tmp_path / "b.exr", OTHER)
    assert [file.name for file in tmp_path.iterdir()] == ["a.exr"]
