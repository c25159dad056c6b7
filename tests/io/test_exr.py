import hashlib

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest

from skinbake.cli import run
from skinbake.errors import InputError
from skinbake.io.exr import (
    Part,
    files_of,
    read_attributes,
    read_parts,
    require_codec,
    rgb_channels,
    write_part_files,
    write_parts,
)
from skinbake.stored_precision import as_stored, as_stored_with_sum

RNG = np.random.default_rng(7)
IMAGE = RNG.random((37, 53, 3), dtype=np.float32)


def part(image=IMAGE, name="irradiance", **attributes):
    return Part(name, rgb_channels(np.asarray(image, np.float32)), attributes)


def test_float_parts_come_back_as_they_were(tmp_path):
    """Write, read, equal: several parts, odd sizes, attributes included."""
    other = part(IMAGE * 2, "light.key", **{"skinbake:key": "abc"})
    write_parts(tmp_path / "a.exr", [part(), other], {"skinbake:weight_rgb": [1.0, 0.5, 0.25]}, precision="float")
    parts = read_parts(tmp_path / "a.exr")
    assert list(parts) == ["irradiance", "light.key"]
    np.testing.assert_array_equal(parts["irradiance"].rgb, IMAGE)
    np.testing.assert_array_equal(parts["light.key"].rgb, IMAGE * 2)
    assert parts["light.key"].attributes["skinbake:key"] == "abc"
    assert parts["irradiance"].attributes["skinbake:weight_rgb"] == (1.0, 0.5, 0.25)
    assert parts["irradiance"].attributes["oiio:ColorSpace"] == "lin_rec709"
    assert read_attributes(tmp_path / "a.exr")["irradiance"]["size"] == [53, 37]


@pytest.mark.parametrize("compression", ["auto", "none", "rle", "zips", "zip", "piz", "htj2k"])
def test_half_parts_are_what_as_stored_says(tmp_path, compression):
    """`as_stored` is the file without the file, so that a resumed bake cannot differ from an undisturbed one."""
    write_parts(tmp_path / "a.exr", [part()], compression=compression)
    read = read_parts(tmp_path / "a.exr")["irradiance"]
    assert read.channels["R"].dtype == np.float16
    np.testing.assert_array_equal(read.rgb, as_stored(IMAGE, "half"))
    assert np.abs(read.rgb / IMAGE - 1).max() < 2**-11 * 1.01


@pytest.mark.parametrize("compression", ["zip", "htj2k"])
def test_floats_keep_every_digit(tmp_path, compression):
    """Whatever their exponent: of mixed signs and sizes, a channel in a part of its own among them."""
    image = (IMAGE - np.float32(0.5)) * np.float32([1e-30, 1, 1e30])
    write_parts(tmp_path / "a.exr", [part(image), Part("one", {"Y": image[..., 0]})], None, "float", compression)
    read = read_parts(tmp_path / "a.exr")
    np.testing.assert_array_equal(read["irradiance"].rgb, image)
    np.testing.assert_array_equal(read["one"].channels["Y"], image[..., 0])


def test_a_codec_that_this_openexr_lacks_is_refused_before_the_bake(monkeypatch):
    """By name, with what to do; the usual ones are not asked for."""
    require_codec("htj2k")
    monkeypatch.delattr(OpenEXR, "HTJ2K256_COMPRESSION")
    with pytest.raises(InputError, match=r"output\.compression: .*htj2k.*pip install"):
        require_codec("htj2k")
    require_codec("piz")


@pytest.mark.parametrize("top", [70000.0, 1e30, 1e-8, 0.01])
def test_channels_that_half_cannot_hold_are_stored_as_float(tmp_path, top):
    """A sun's 1e5 does not become infinity, and a candle's 1e-8 does not become black."""
    image = IMAGE * np.float32(top)
    write_parts(tmp_path / "a.exr", [part(image)])
    read = read_parts(tmp_path / "a.exr")["irradiance"].rgb
    np.testing.assert_array_equal(read, as_stored(image, "half"))
    np.testing.assert_array_equal(read, image)


@pytest.mark.parametrize("factors", [(1e5, 1, 1), (1, 1, 1e-3)])
def test_an_image_is_of_one_kind(tmp_path, factors):
    """A channel that half cannot hold takes the others along, for programs read no colour of two; not other images."""
    image = IMAGE * np.float32(factors)
    alpha, parts = {"A": np.ones((37, 53), np.float32)}, ("together", "apart", "alpha")
    apart = {c: image[..., i] for i, c in enumerate("RGB")}
    made = [rgb_channels(image), apart, rgb_channels(image) | alpha]
    write_parts(tmp_path / "a.exr", [*(Part(*each) for each in zip(parts, made, strict=True)), part()])
    for name, read in read_parts(tmp_path / "a.exr").items():
        np.testing.assert_array_equal(read.rgb, as_stored(IMAGE, "half") if name == "irradiance" else image)
    kinds = [next(iter(p.channels.values())).pixels.dtype for p in OpenEXR.File(str(tmp_path / "a.exr")).parts]
    assert kinds == [np.float32, np.float32, np.float32, np.float16]
    layers = as_stored(np.stack([IMAGE, image]), "half")
    np.testing.assert_array_equal(layers[1], image)
    np.testing.assert_array_equal(layers[0], as_stored(IMAGE, "half"))


@pytest.mark.parametrize("scale", [1, 1e-3, 1e-9, [1, 0, 1], [1e6, 1, 1]])
@pytest.mark.parametrize("precision", ["half", "float"])
def test_lights_and_their_sum_are_what_each_would_be_by_itself(scale, precision):
    """In the same precision, to the last bit: also dark, faint and too bright channels."""
    lights = (RNG.random((3, 41, 29, 3)) * scale).astype(np.float32)
    each, total = as_stored_with_sum(lights, precision)
    for found, want in ((each, lights), (total, lights.sum(axis=0, dtype=np.float32))):
        assert found.dtype == as_stored(want, precision).dtype
        np.testing.assert_array_equal(found, as_stored(want, precision))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_nothing_that_is_not_finite_is_written(tmp_path, value):
    """The message names the texel, and the file that stood there still stands."""
    path = tmp_path / "a.exr"
    write_parts(path, [part()])
    before = path.read_bytes()
    broken = IMAGE.copy()
    broken[5, 11, 1] = value
    with pytest.raises(InputError, match=r"part irradiance, channel G: expected finite values.*column 11, row 5"):
        write_parts(path, [part(broken)])
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]


@pytest.mark.parametrize("compression", ["zip", "piz", "htj2k"])
def test_bytes_are_reproducible(tmp_path, monkeypatch, compression):
    """The same image gives the same file, with no date in it, on any number of threads."""
    digests = set()
    for threads in (1, 1, 2, 5):
        monkeypatch.setenv("NUMBA_NUM_THREADS", str(threads))
        write_parts(
            tmp_path / "a.exr", [part(), part(IMAGE, "light.key")], {"skinbake:version": "x"}, "half", compression
        )
        assert OpenEXR.global_thread_count() == (threads if threads > 1 else 0)
        digests.add(hashlib.sha256((tmp_path / "a.exr").read_bytes()).hexdigest())
    assert len(digests) == 1


def test_a_channel_may_be_a_view_of_anything(tmp_path):
    """Of a colour image, turned, mirrored, already half, negative, or all zero."""
    half = IMAGE.astype(np.float16)
    channels = {"R": IMAGE[..., 1], "G": -IMAGE[::-1, ::-1, 0], "B": half[..., 2], "A": np.zeros((37, 53))}
    write_parts(tmp_path / "a.exr", [Part("", channels)])
    read = read_parts(tmp_path / "a.exr")[""].channels
    for name, values in channels.items():
        assert read[name].dtype == np.float16
        np.testing.assert_array_equal(read[name], np.asarray(values, np.float16))


@pytest.mark.parametrize("keep", [0, 3, 200, 3000, 0.5, 0.9, -1])
def test_a_file_cut_short_is_refused(tmp_path, keep):
    """Wherever it was cut, also in the last byte; never an image with black rows."""
    path = tmp_path / "a.exr"
    write_parts(path, [part(), part(IMAGE, "light.key")])
    whole = path.read_bytes()
    path.write_bytes(whole[: int(keep * len(whole)) if isinstance(keep, float) else keep])
    with pytest.raises(InputError, match=r"a\.exr: expected"):
        read_parts(path)


def test_what_is_no_exr_is_refused(tmp_path):
    """Text, another format, a folder, nothing at all: one clear message."""
    (tmp_path / "text.exr").write_text("not an image")
    for name in ("text.exr", "none.exr", "."):
        with pytest.raises(InputError, match="expected an EXR"):
            read_parts(tmp_path / name)


def test_parts_in_files_of_their_own_come_back_together(tmp_path):
    """A tile's number stays last in a name; those asked for alone are read."""
    path = tmp_path / "lobe_0.1002.exr"
    write_part_files(path, [part(), part(2 * IMAGE, "light.key", **{"skinbake:key": "a"})], precision="float")
    assert files_of(path) == [path, tmp_path / "lobe_0.key.1002.exr"]
    np.testing.assert_array_equal(read_parts(path)["light.key"].rgb, 2 * IMAGE)
    assert list(read_parts(path, ["irradiance"])) == ["irradiance"]
    assert read_attributes(path)["light.key"]["skinbake:key"] == "a"
    assert list(read_parts(tmp_path / "lobe_0.key.1002.exr")) == ["light.key"]


DAMAGED = ["{", "[1]", "null", '{"light.key": "../a.exr"}', '{"light.key": "a.exr"}', '{"b": ".."}']


@pytest.mark.parametrize("named", DAMAGED)
def test_a_damaged_list_of_files_is_said(tmp_path, named):
    """Names that are no names, lead elsewhere, or to the file itself."""
    write_parts(tmp_path / "a.exr", [part(name="", **{"skinbake:part": "irradiance", "skinbake:parts": named})])
    for read in (read_parts, read_attributes):
        with pytest.raises(InputError, match=r"expected (names of files by part|other files|an EXR file)"):
            read(tmp_path / "a.exr")
    assert files_of(tmp_path / "a.exr")[0] == tmp_path / "a.exr"


def test_a_shifted_data_window_is_no_other_image(tmp_path):
    """The same pixels elsewhere: refused by name, not taken for those that lie at the origin."""
    path = tmp_path / "shifted.exr"
    spec = oiio.ImageSpec(6, 4, 3, oiio.FLOAT)
    spec.x, spec.full_width, spec.full_height = 2, 8, 4
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec)
    out.write_image(np.ones((4, 6, 3), np.float32))
    out.close()
    with pytest.raises(InputError, match=r"shifted\.exr: expected a data window equal to .*, got \(2, 0"):
        read_parts(path)
    write_parts(tmp_path / "plain.exr", [Part("", rgb_channels(np.ones((4, 6, 3), np.float32)))], precision="float")
    assert run(["compare", str(path), str(tmp_path / "plain.exr")]) == 2
