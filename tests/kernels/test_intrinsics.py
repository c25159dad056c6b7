"""Every piece of LLVM code of ours is compiled and run: an upgrade of numba that breaks one is seen here."""

import ctypes

import numpy as np
import pytest
from numba.core.extending import _Intrinsic

from skinbake.kernels import c_call, simd
from skinbake.kernels.c_call import call_with_pointers
from skinbake.kernels.compile import kernel
from skinbake.kernels.simd import (
    LANES,
    bits_below,
    broadcast,
    greatest_lane,
    least_lane,
    load,
    load_scalar,
    lowest_bit,
    mul_add,
    prefetch,
    same,
    square_root,
    store,
    sum_of_lanes,
)

RNG = np.random.default_rng(7)
A, B = (RNG.normal(size=LANES).astype(np.float32) for _ in range(2))
B[5] = A[5]
TWO = np.float32(2)


@kernel
def k_broadcast(a, b, out):
    store(out, 0, broadcast(a[3]))


@kernel
def k_load(a, b, out):
    prefetch(a, 1000)  # need not be there
    store(out, 0, load(a, 0))


@kernel
def k_load_scalar(a, b, out):
    for k in range(LANES):
        out[k] = load_scalar(a, LANES - 1 - k)


@kernel
def k_same(a, b, out):
    store(out, 0, same(load(a, 0), load(b, 0)))


@kernel
def k_square_root(a, b, out):
    store(out, 0, square_root(load(a, 0) * load(a, 0)))


@kernel
def k_across(a, b, out):
    out[0], out[1], out[2] = least_lane(load(a, 0)), greatest_lane(load(a, 0)), sum_of_lanes(load(a, 0))


@kernel
def k_bits(a, b, out):
    bits = bits_below(load(a, 0), load(b, 0))
    while bits != 0:
        out[lowest_bit(bits)] = 1
        bits &= bits - 1


@kernel
def k_bits_of_scalar(a, b, out):
    out[0] = bits_below(load(a, 0), TWO)


@kernel
def k_mul_add(a, b, out):
    store(out, 0, mul_add(load(a, 0), TWO, load(b, 0)))


@kernel
def k_mul_add_of_scalars(a, b, out):
    for k in range(LANES):
        out[k] = mul_add(a[k], TWO, b[k])


@kernel
def k_lanes_with_lanes(a, b, out):
    x, y = load(a, 0), load(b, 0)
    store(out, 0, min(x + y, x - y) * max(x * y, x / y))


@kernel
def k_lanes_with_scalars(a, b, out):
    x = load(a, 0)
    store(out, 0, min((x + TWO) * (x - TWO), (x * TWO) / TWO) + max(max(x, TWO) / TWO, x))


@kernel
def k_scalars_with_lanes(a, b, out):
    x = load(a, 0)
    store(out, 0, max(TWO + x, TWO * x) - min(TWO - x, TWO / x))


@kernel
def k_in_place(a, b, out):
    x, y = load(a, 0), load(b, 0)
    x += y
    x *= y
    x += TWO
    x *= TWO
    store(out, 0, x)


@kernel
def k_gaussian(a, b, out):
    store(out, 0, simd.gaussian(load(a, 0) * load(a, 0) * (np.float32(-1) / np.float32(64))))


def halved(values):
    """Their sum in the order of `sum_of_lanes`."""
    while len(values) > 1:
        values = values[: len(values) // 2] + values[len(values) // 2 :]
    return values[0]


def in_first(*values):
    """These values, and zeros after them."""
    return np.array([*values, *[0] * (LANES - len(values))], np.float32)


CASES = {
    k_broadcast: np.full(LANES, A[3]),
    k_load: A,
    k_load_scalar: A[::-1],
    k_same: (A == B).astype(np.float32),
    k_square_root: np.sqrt(A * A),
    k_across: in_first(A.min(), A.max(), halved(A)),
    k_bits: (A < B).astype(np.float32),
    k_bits_of_scalar: in_first(sum(1 << int(k) for k in np.flatnonzero(A < 2))),
    k_mul_add: A * 2 + B,  # 2 a is exact: fused or not
    k_mul_add_of_scalars: A * 2 + B,
    k_lanes_with_lanes: np.minimum(A + B, A - B) * np.maximum(A * B, A / B),
    k_lanes_with_scalars: np.minimum((A + 2) * (A - 2), A) + np.maximum(np.maximum(A, 2) / 2, A),
    k_scalars_with_lanes: np.maximum(2 + A, 2 * A) - np.minimum(2 - A, 2 / A),
    k_in_place: ((A + B) * B + 2) * 2,
}


@pytest.mark.parametrize("compiled", CASES, ids=lambda compiled: compiled.py_func.__name__)
def test_lanes_do_what_numpy_does(compiled):
    """Each intrinsic and operator, lane by lane, to the last bit."""
    out = np.zeros(LANES, np.float32)
    compiled(A, B, out)
    np.testing.assert_array_equal(out, CASES[compiled])


def test_gaussian_is_near_the_exponential():
    """exp(32 x) to 1.6e-6 of its peak."""
    out = np.zeros(LANES, np.float32)
    k_gaussian(A, B, out)
    np.testing.assert_allclose(out, np.exp(-(A.astype(float) ** 2) / 2), atol=1.6e-6)


@kernel
def k_call(function, first, second):
    call_with_pointers(function, first, second)


def test_a_c_function_is_called_by_its_address():
    """With both pointers, and NULL."""
    got = []
    pointer = ctypes.c_void_p
    function = ctypes.CFUNCTYPE(None, pointer, pointer, pointer)(lambda *arguments: got.append(arguments))
    k_call(ctypes.cast(function, pointer).value, 4096, 8192)
    assert got == [(4096, 8192, None)]


def test_every_intrinsic_is_among_them():
    """One that is added needs a kernel here."""
    kernels = [value for name, value in globals().items() if name.startswith("k_")]
    tested = {read for compiled in kernels for read in compiled.py_func.__code__.co_names}
    ours = {name for of in (simd, c_call) for name, value in vars(of).items() if isinstance(value, _Intrinsic)}
    assert len(ours) > 12
    assert ours - tested == set()
