"""Rows of samples as streams of zlib: what an EXR's ZIP compression makes of blocks of rows, in a part of its time.

Of what deflate has [Deutsch1996], long runs of one byte and codes by frequency alone are used: nothing else repeats in
the noise by which neighbouring texels differ. Low and high bytes of the samples have codes of their own, so streams are
hardly longer than those of a packer that looks for repetitions and has one code for both.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skinbake.kernels.compile import kernel

_CODES, _END = 286, 256  # 256 literals, the end of a block, 29 of lengths of runs
_LONGEST_CODE = 15  # bits
_GROUP, _MOST_GROUPS = 16, 16  # bytes that are looked at together; groups of a run, of which deflate takes 258 bytes
_RUN = 256  # tokens: literals by their value, runs behind them by how many groups; that of none is written by no bit
_TOKENS = _RUN + _MOST_GROUPS + 1
_SAMPLE = 1024  # groups whose literals are counted
_SMALLEST = 1024  # bytes of a half that is worth its codes
_RESERVED = 96  # 32-bit words for what follows tokens: another header of 57, a few literals, the end
# What a block with codes of its own begins with: 286 of literals and lengths, one of distances; 19 that tell how long
# those are, of which three do not occur and the other sixteen have 4 bits
_HEADER, _HEADER_BITS = 2 << 1 | (_CODES - 257) << 3 | 0 << 8 | (19 - 4) << 13, 26
_FOURS, _FOURS_BITS = 0o44444444, 24  # eight of those sixteen
_ADLER, _UNREDUCED = 65521, 4096  # that many bytes are added in 32 bits
_GAPS = (57, 23, 10, 4, 1)  # of Shell's sorting


@kernel
def pack_blocks(first, stop, samples, length, packed, sizes):  # type: ignore[no-untyped-def]
    """Pack blocks of samples.

    Parameters
    ----------
    first, stop : int
        Which blocks.
    samples : ndarray of shape (n,), uint16
        Those of 32 bits are two, the lower half first.
    length : int
        Samples of a block; the last one may have fewer.
    packed : ndarray of shape (blocks, length // 2 + 1), uint32
        The streams, written.
    sizes : ndarray of shape (blocks,), int64
        Bytes of each stream; 0 of one that would not be shorter than the samples. Written.
    """
    content, runs = np.empty(2 * length, np.uint8), np.empty(length // _GROUP, np.uint8)
    tables = np.empty((5, _CODES), np.int64)
    for k in range(first, stop):
        half = min(length, samples.size - length * k)
        _differences(samples[length * k : length * k + half], content)
        sizes[k] = _deflate(content[: 2 * half], runs[: half // _GROUP], tables, packed[k]) if half > _SMALLEST else 0


@kernel(inner=True)
def _differences(samples: NDArray[np.uint16], content: NDArray[np.uint8]) -> None:
    """All low bytes, then all high ones, each as what it has more than the one before, plus 128."""
    n = samples.size
    content[0] = np.uint8(samples[0])
    content[n] = np.uint8((samples[0] >> 8) - samples[n - 1] + 128)
    for i in range(1, n):
        content[i] = np.uint8(np.uint16(np.uint16(samples[i] - samples[i - 1]) + np.uint16(128)))
    for i in range(1, n):
        more = np.uint16(np.uint16(samples[i] >> np.uint16(8)) - np.uint16(samples[i - 1] >> np.uint16(8)))
        content[n + i] = np.uint8(np.uint16(more + np.uint16(128)))


@kernel(inner=True)
def _deflate(content, runs, tables, out):  # type: ignore[no-untyped-def]
    """A stream of zlib of two blocks, one for each half of the content.

    Parameters
    ----------
    content : ndarray of shape (2 n,), uint8
    runs : ndarray of shape (n // 16,), uint8
        For what is written in between, as `tables`.
    tables : ndarray of shape (5, 286), int64
    out : ndarray, uint32
        Written.

    Returns
    -------
    int
        Bytes; 0 if they would not be fewer than those of the content.
    """
    half = content.size // 2
    counts, values, widths, codes, lengths = tables
    state = np.zeros(3, np.int64)  # bits that wait, how many, and words that are written
    _put(0x0178, 16, state, out)  # what a stream of zlib begins with
    for block in range(2):
        part = content[half * block : half * (block + 1)]
        _find_runs(part, runs, counts)
        _code_lengths(counts, lengths)
        _values_of(lengths, codes)
        _put(block | _HEADER, _HEADER_BITS, state, out)  # whether it is the last one
        _put(_FOURS, _FOURS_BITS, state, out)
        _put(_FOURS, _FOURS_BITS, state, out)
        for code in range(_CODES):
            _put(_reversed(lengths[code], 4), 4, state, out)
        _put(_reversed(1, 4), 4, state, out)  # of the distance 1
        for token in range(_TOKENS):
            values[token], widths[token] = _bits_of(token, codes, lengths)
        if not _put_tokens(part, runs, (values, widths), state, out[: half // 2 - _RESERVED]):
            return 0
        _put(codes[_END], lengths[_END], state, out)
    _put(0, -state[1] % 8, state, out)
    for check in _adler(content):
        _put(check >> 8 | (check & 255) << 8, 16, state, out)
    out[state[2]] = np.uint32(state[0])
    return 4 * state[2] + state[1] // 8


@kernel(inner=True)
def _find_runs(content: NDArray[np.uint8], runs: NDArray[np.uint8], counts: NDArray[np.int64]) -> None:
    """Find groups that repeat the byte before them, and how often tokens occur, literals by a sample.

    Parameters
    ----------
    content : ndarray of shape (n,), uint8
    runs : ndarray of shape (n // 16,), uint8
        For each group, how many it is the first of that are one run; 0 for literals. Those within a run stay as they
        were. Written.
    counts : ndarray of shape (286,), int64
        Written; at least 1 of each literal, since any may occur.
    """
    apart = np.zeros((4, 256), np.uint32)  # the same counter twice in turn would be waited for
    for token in range(_TOKENS):
        counts[token] = 0
    step = 1 + runs.size // _SAMPLE
    k = 0
    while k < runs.size:
        stop = k
        while 0 < stop < min(k + _MOST_GROUPS, runs.size) and _repeats(content, _GROUP * stop):
            stop += 1
        runs[k] = stop - k
        counts[_RUN + stop - k] += 1
        if stop == k:
            stop += 1
            if k % step == 0:
                for i in range(_GROUP * k, _GROUP * stop, 4):
                    for j in range(4):
                        apart[j, content[i + j]] += np.uint32(1)
        k = stop
    for value in range(256):
        count = apart[0, value] + apart[1, value] + apart[2, value] + apart[3, value]
        counts[value] = max(step * int(count), 1)
    counts[_RUN] = 0  # groups of literals are none


@kernel(inner=True)
def _repeats(content: NDArray[np.uint8], first: int) -> bool:
    """Whether a group is nothing but the byte before it."""
    before = content[first - 1]
    if content[first + _GROUP - 1] != before:
        return False
    differs = np.uint8(0)
    for i in range(first, first + _GROUP):
        differs |= content[i] ^ before
    return differs == 0


@kernel(inner=True)
def _bits_of(token: int, codes: NDArray[np.int64], lengths: NDArray[np.int64]) -> tuple[int, int]:
    """What is written of a token, and how many bits; behind a run's, one of 0 for the distance 1."""
    if token < _RUN:
        return codes[token], lengths[token]
    if token == _RUN:
        return 0, 0
    code, more, above = _length_code(token)
    return codes[code] | above << lengths[code], lengths[code] + more + 1


@kernel(inner=True)
def _length_code(token: int) -> tuple[int, int, int]:
    """Code of a run, how many more bits tell its length, and what they are."""
    above, more = _GROUP * (token - _RUN) - 3, 0  # a length of 3 has the first code
    while above >> more >= 8:
        more += 1
    return _END + 1 + 4 * more + (above >> more), more, above & ((1 << more) - 1)


@kernel(inner=True)
def _code_lengths(counts: NDArray[np.int64], lengths: NDArray[np.int64]) -> None:
    """Bits of each code, by Huffman's tree in place [Moffat1995], none longer than 15.

    Parameters
    ----------
    counts : ndarray of shape (286,), int64
        How often each token occurs.
    lengths : ndarray of shape (286,), int64
        Written; 0 for a code that is not needed.
    """
    for code in range(_CODES):
        lengths[code] = counts[code] if code < _END else code == _END
    for token in range(_RUN + 1, _TOKENS):
        lengths[_length_code(token)[0]] += counts[token]
    # The codes that occur, the rarest first: how often in the upper bits, which one in the lower ones
    entries, n = np.empty(_CODES, np.int64), 0
    for code in range(_CODES):
        if lengths[code]:
            entries[n] = lengths[code] << 9 | code
            n += 1
    for gap in _GAPS:
        for i in range(gap, n):
            entry, j = entries[i], i
            while j >= gap and entries[j - gap] > entry:
                entries[j] = entries[j - gap]
                j -= gap
            entries[j] = entry
    tree = np.empty(n, np.int64)
    for i in range(n):
        tree[i] = entries[i] >> 9
    _tree_depths(tree)
    # Too deep ones are cut, which the deepest of the others pay for; what they pay too much is given back
    left, paying = 1 << _LONGEST_CODE, 0
    for i in range(n):
        tree[i] = min(tree[i], _LONGEST_CODE)
        left -= 1 << (_LONGEST_CODE - tree[i])
    while left < 0:
        while tree[paying] == _LONGEST_CODE:
            paying += 1
        tree[paying] += 1
        left += 1 << (_LONGEST_CODE - tree[paying])
    for i in range(n):
        while left >= 1 << (_LONGEST_CODE - tree[i]):
            left -= 1 << (_LONGEST_CODE - tree[i])
            tree[i] -= 1
    for i in range(n):
        lengths[entries[i] & 511] = tree[i]


@kernel(inner=True)
def _tree_depths(tree: NDArray[np.int64]) -> None:
    """How often codes occur, ascending, become their depths in Huffman's tree, descending; two codes or more."""
    n = tree.size
    # Nodes in the places of codes that they took: first what is below them, then where their own parent is
    leaf = node = 0
    for parent in range(n - 1):
        weight = 0
        for _ in range(2):
            if leaf >= n or (node < parent and tree[node] < tree[leaf]):
                weight += tree[node]
                tree[node] = parent
                node += 1
            else:
                weight += tree[leaf]
                leaf += 1
        tree[parent] = weight
    tree[n - 2] = 0
    for k in range(n - 3, -1, -1):
        tree[k] = tree[tree[k]] + 1
    # What is no node of a level is a leaf there
    places, depth, at, leaf = 1, 0, n - 2, n - 1
    while places > 0:
        nodes = 0
        while at >= 0 and tree[at] == depth:
            nodes, at = nodes + 1, at - 1
        for _ in range(places - nodes):
            tree[leaf] = depth
            leaf -= 1
        places, depth = 2 * nodes, depth + 1


@kernel(inner=True)
def _values_of(lengths: NDArray[np.int64], codes: NDArray[np.int64]) -> None:
    """The bits of each code, as they are written: those of a length follow each other, behind all shorter ones."""
    value = 0
    for length in range(1, _LONGEST_CODE + 1):
        for code in range(_CODES):
            if lengths[code] == length:
                codes[code] = _reversed(value, length)
                value += 1
        value <<= 1


@kernel(inner=True)
def _reversed(value: int, length: int) -> int:
    """So many bits in the other order."""
    turned = 0
    for _ in range(length):
        turned = turned << 1 | value & 1
        value >>= 1
    return turned


@kernel(inner=True)
def _put(value: int, width: int, state: NDArray[np.int64], out: NDArray[np.uint32]) -> None:
    """Append up to 31 bits."""
    state[0] |= value << state[1]
    state[1] += width
    if state[1] >= 32:
        out[state[2]] = np.uint32(state[0] & 0xFFFFFFFF)
        state[0] >>= 32
        state[1] -= 32
        state[2] += 1


@kernel(inner=True)
def _put_tokens(content, runs, bits, state, out):  # type: ignore[no-untyped-def]
    """Append literals and runs, without a choice for each word that is full: it would be foreseen wrongly at random.

    Parameters
    ----------
    content, runs
        As of `_find_runs`.
    bits : pair of ndarrays of shape (286,), int64
        What is written of each token, and how many bits.
    state, out
        As of `_put`.

    Returns
    -------
    bool
        Whether there was room.
    """
    values, widths = bits
    wait, waiting, at = state[0], state[1], state[2]
    k = 0
    while k < runs.size:
        if at + _GROUP >= out.size:
            return False
        count = np.int64(runs[k])
        first = _GROUP * k
        for i in range(first, first + (2 if count else _GROUP), 2):
            one, two = (_RUN + count, _RUN) if count else (np.int64(content[i]), np.int64(content[i + 1]))
            wait |= (values[one] | values[two] << widths[one]) << waiting
            waiting += widths[one] + widths[two]
            out[at] = np.uint32(wait & 0xFFFFFFFF)
            at += waiting >> 5
            wait >>= waiting & 32
            waiting &= 31
        k += max(count, 1)
    state[0], state[1], state[2] = wait, waiting, at
    for i in range(_GROUP * runs.size, content.size):
        _put(values[content[i]], widths[content[i]], state, out)
    return True


@kernel(inner=True)
def _adler(content: NDArray[np.uint8]) -> tuple[int, int]:
    """The two halves of the checksum of a stream of zlib."""
    plain, weighted = np.int64(1), np.int64(0)
    for begin in range(0, content.size, _UNREDUCED):
        part = content[begin : begin + _UNREDUCED]
        once, more = np.uint32(0), np.uint32(0)
        for i in range(part.size):
            once = np.uint32(once + np.uint32(part[i]))
            more = np.uint32(more + np.uint32(np.uint32(part.size - i) * np.uint32(part[i])))
        weighted = (weighted + part.size * plain + more) % _ADLER
        plain = (plain + once) % _ADLER
    return int(weighted), int(plain)
