"""What our packer makes, zlib takes apart again."""

import zlib

import numpy as np
import pytest

from skinbake.kernels.deflate import pack_blocks

RNG = np.random.default_rng(3)


def streams(rows, height=16):
    """Each block's stream; nothing for one that would not be shorter."""
    count = -(-len(rows) // height)
    packed = np.full((count, height * rows.shape[1] // 2 + 1), 0xFFFFFFFF, np.uint32)  # what was there does not matter
    sizes = np.full(count, -1, np.int64)
    pack_blocks(0, count, rows.reshape(-1), height * rows.shape[1], packed, sizes)
    return [row.view(np.uint8)[:size].tobytes() for row, size in zip(packed, sizes, strict=True)]


def as_openexr_predicts(rows):
    """The bytes that ZIP compression packs, as the format describes them: even ones, odd ones, then differences."""
    split = rows.astype("<u2").reshape(-1).view(np.uint8)
    apart = np.concatenate([split[0::2], split[1::2]])
    return np.concatenate([apart[:1], np.diff(apart) + np.uint8(128)]).tobytes()


def rare_codes():
    """Bytes whose frequencies are Fibonacci's numbers: without a limit, codes of 24 bits."""
    counts = [1, 1]
    while len(counts) < 25:
        counts.append(counts[-1] + counts[-2])
    steps = np.repeat(np.arange(25), counts)
    values = np.cumsum(RNG.permutation(steps)) % 256
    return values[: len(values) // 16 * 16].reshape(16, -1).astype(np.uint16)


BLOCKS = {
    "nothing": np.zeros((37, 211), np.uint16),
    "light with noise": (RNG.random((33, 300)) * np.linspace(0.1, 2, 300)).astype(np.float16).view(np.uint16),
    "smooth": np.linspace(0, 9, 40 * 999).astype(np.float16).view(np.uint16).reshape(40, 999),
    "half of it dark": np.where(np.arange(512) < 200, 0, RNG.integers(15000, 15100, (48, 512))).astype(np.uint16),
    "codes that are too long": rare_codes(),
}


@pytest.mark.parametrize("name", BLOCKS)
def test_a_block_comes_back_as_it_was(name):
    """Of any size, the last one of fewer rows, its checksum right; and shorter than the samples."""
    rows = BLOCKS[name]
    for k, stream in enumerate(streams(rows)):
        block = rows[16 * k : 16 * (k + 1)]
        if stream or block.size >= 4096:
            assert zlib.decompress(stream) == as_openexr_predicts(block)
            assert len(stream) < block.nbytes


def test_what_would_not_be_shorter_is_left():
    """Noise of all bits, and blocks so small that their codes would take more."""
    assert streams(RNG.integers(0, 65536, (32, 999)).astype(np.uint16)) == [b"", b""]
    assert streams(np.zeros((17, 3), np.uint16)) == [b"", b""]


@pytest.mark.parametrize("name", ["nothing", "light with noise", "half of it dark"])
def test_streams_are_hardly_longer_than_those_of_zlib(name):
    """Within a tenth and the codes' own length: no repetitions are looked for, but there are two codes."""
    rows = BLOCKS[name][:32]
    for k, stream in enumerate(streams(rows)):
        wanted = len(zlib.compress(as_openexr_predicts(rows[16 * k : 16 * (k + 1)]), 6))
        assert len(stream) < 1.1 * wanted + 400
