"""Vectors: every operation lane by lane, the store that must not become a masked one, and equality with scalars."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numba import njit

from renderers.compiler import simd as vec
from renderers.compiler.pointers import f32_at, f64_at, i32_at, i64_at, u8_at, u32_at
from renderers.drawlist import DrawList, Instance, Material
from renderers.raster import CpuRenderer
from tests.renderers import scalar
from tests.renderers.scenes import camera, draw_list, grid, pose, soup, sphere

A = np.array((0.0, -1.5, 2.5, 3.5, -0.5, 1e6, 7.25, -8.0))
B = np.array((1.0, -1.5, 0.5, -2.0, 4.0, 3.0, 7.5, 2.0))


@njit
def _floats(a, b, out, number):
    p, q, o, n = f64_at(a), f64_at(b), f64_at(out), i32_at(number)
    x, y = vec.load(p, 0), vec.load(q, 0)
    vec.store(o, 0, x + y)
    vec.store(o, 8, x - y)
    vec.store(o, 16, x * y)
    vec.store(o, 24, x / y)
    vec.store(o, 32, vec.minimum(x, y))
    vec.store(o, 40, vec.maximum(x, y))
    vec.store(o, 48, vec.select((x < y) & ~(x == y), x, -y))
    vec.store(o, 56, vec.rint(x))
    vec.store(o, 64, vec.ceil(x))
    vec.store(o, 72, vec.floor(x))
    vec.store(o, 80, vec.absolute(x))
    vec.store(o, 88, vec.to_f64(vec.to_f32(x)))
    vec.store(o, 96, vec.to_f64(vec.to_i32(x)))
    n[0] = vec.movemask(x < y)
    n[1] = vec.movemask(x <= y)
    n[2] = vec.movemask(x > y)
    n[3] = vec.movemask(x >= y)
    n[4] = vec.movemask(x == y)
    n[5] = vec.movemask((x != y) | (x == y))


def test_floats_lane_by_lane() -> None:
    out, number = np.zeros(104), np.zeros(6, np.int32)
    _floats(A.ctypes.data, B.ctypes.data, out.ctypes.data, number.ctypes.data)
    expected = (
        A + B,
        A - B,
        A * B,
        A / B,
        np.minimum(A, B),
        np.maximum(A, B),
        np.where(A < B, A, -B),
        np.rint(A),
        np.ceil(A),
        np.floor(A),
        np.abs(A),
        A.astype(np.float32),
        np.trunc(A),
    )
    for k, values in enumerate(expected):
        np.testing.assert_array_equal(out[8 * k : 8 * k + 8], values, err_msg=str(k))
    masks = (A < B, A <= B, A > B, A >= B, A == B, np.full(8, True))
    assert number.tolist() == [int((1 << np.arange(8))[mask].sum()) for mask in masks]


@njit
def _integers(a, b, out):
    p, q, o = i32_at(a), i32_at(b), i32_at(out)
    x, y = vec.load(p, 0), vec.load(q, 0)
    vec.store(o, 0, x + y)
    vec.store(o, 8, x - y)
    vec.store(o, 16, x * y)
    vec.store(o, 24, x & y)
    vec.store(o, 32, x | y)
    vec.store(o, 40, x ^ y)
    vec.store(o, 48, x >> vec.i32(2))
    vec.store(o, 56, x << vec.i32(2))
    vec.store(o, 64, ~x)
    vec.store(o, 72, -x)
    vec.store(o, 80, vec.minimum(x, y))
    vec.store(o, 88, vec.gather(p, vec.iota() ^ vec.i32(3)))
    vec.store(o, 96, vec.load_third(p, 0, 2))
    vec.store(o, 104, vec.to_i32(vec.to_f32(x)))
    vec.store(o, 112, vec.select(vec.less_unsigned(x, y), x, y))
    vec.store(o, 120, vec.count_bits(x))


def test_integers_lane_by_lane() -> None:
    x = np.array((5, -7, 100, -100, 0, 1, 65535, -65536, *range(20, 36)), np.int32)
    y = np.array((3, 3, -3, 12, 9, -1, 2, 5), np.int32)
    out = np.zeros(128, np.int32)
    _integers(x.ctypes.data, y.ctypes.data, out.ctypes.data)
    a = x[:8]
    expected = (a + y, a - y, a * y, a & y, a | y, a ^ y, a >> 2, a << 2, ~a, -a, np.minimum(a, y), a[np.arange(8) ^ 3])
    unsigned = np.minimum(a.view(np.uint32), y.view(np.uint32)).view(np.int32)
    bit_counts = [value.bit_count() for value in a.view(np.uint32).tolist()]
    for k, values in enumerate((*expected, x[2::3], a, unsigned, bit_counts)):
        np.testing.assert_array_equal(out[8 * k : 8 * k + 8], values, err_msg=str(k))


@njit
def _corners(vertices, indices, out):
    o = f32_at(out)
    for corner in range(3):
        x, y, w = vec.load_corners(f32_at(vertices), u32_at(indices), corner)
        vec.store(o, 24 * corner, x)
        vec.store(o, 24 * corner + 8, y)
        vec.store(o, 24 * corner + 16, w)
    x, y, w = vec.load_corners(f32_at(vertices), u32_at(indices), 1)
    vec.store_vertices(o, 72, x, y, w)


def test_corners_of_eight_triangles() -> None:
    rng = np.random.default_rng(0)
    vertices = rng.normal(size=(30, 4)).astype(np.float32)
    indices = rng.integers(0, 30, size=(8, 3)).astype(np.uint32)
    out = np.zeros(72 + 32, np.float32)
    _corners(vertices.ctypes.data, indices.ctypes.data, out.ctypes.data)
    np.testing.assert_array_equal(out[:72].reshape(3, 3, 8), vertices[indices, :3].transpose(1, 2, 0))
    np.testing.assert_array_equal(out[72:].reshape(8, 4)[:, :3], vertices[indices[:, 1], :3])


@njit
def _blend_again(a, b, c):
    p, q = f32_at(a), f32_at(b)
    for k in range(0, c, 8):
        new, old = vec.load(q, k), vec.load_volatile(p, k)
        vec.store(p, k, vec.select(new > old, new, old))


def test_blends_are_not_masked_stores() -> None:
    """Masked stores are microcoded on Zen 1 to 3, 5 to 15 times slower: see the module's notes."""
    a, b = A.astype(np.float32), B.astype(np.float32)
    _blend_again(a.ctypes.data, b.ctypes.data, 8)
    np.testing.assert_array_equal(a, np.maximum(A, B).astype(np.float32))
    assembly = "".join(_blend_again.inspect_asm().values())
    assert "maskmov" not in assembly
    assert "volatile" in "".join(_blend_again.inspect_llvm().values())


@njit
def _store_where(out, values):
    o, v = f32_at(out), f32_at(values)
    vec.store_where(o, 3, vec.load(v, 0) > vec.f32(0.0), vec.load(v, 0))


def test_stores_of_some_lanes() -> None:
    out, values = np.full(16, 9.0, np.float32), A.astype(np.float32)
    _store_where(out.ctypes.data, values.ctypes.data)
    expected = np.full(16, 9.0, np.float32)
    expected[3:11] = np.where(A > 0.0, A, 9.0)
    np.testing.assert_array_equal(out, expected)
    assert "maskmov" not in "".join(_store_where.inspect_asm().values())  # see above


@njit
def _lists(values, out, number):
    a, o, n = i32_at(values), i32_at(out), i64_at(number)
    x, y = vec.load(a, 0), vec.load(a, 8)
    vec.prefetch(a, 1 << 40)  # may lie anywhere
    n[0], n[1] = vec.minimum_of(x), vec.maximum_of(x)
    n[2], n[3] = vec.count_bits(vec.movemask(x > y)), vec.or_of(x)
    taken, kept = x > y, vec.compress(x > y, vec.to_f32(vec.iota()))
    vec.store(o, 0, vec.compress(taken, x))
    vec.store(o, 8, vec.compress(taken, y))
    vec.store(o, 16, vec.to_i32(kept))


@pytest.mark.parametrize("seed", range(5))
def test_compressed_lists_and_reductions(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = rng.integers(-(1 << 31), 1 << 31, 16).astype(np.int32)
    out, number = np.full(24, 3, np.int32), np.zeros(4, np.int64)
    _lists(values.ctypes.data, out.ctypes.data, number.ctypes.data)
    x, y = values[:8], values[8:]
    taken = x > y
    assert number.tolist() == [x.min(), x.max(), taken.sum(), np.bitwise_or.reduce(x)]
    np.testing.assert_array_equal(out.reshape(3, 8)[:, : number[2]], np.stack((x, y, np.arange(8)))[:, taken])


SCENES: dict[str, tuple[Callable[[np.random.Generator], DrawList], dict[str, Any]]] = {
    "tiny": (lambda r: draw_list(soup(r, 4000, size=0.01, low=(-1, -1, 1), high=(1, 1, 4))), {}),
    "small": (lambda r: draw_list(soup(r, 1500, size=0.05, low=(-1, -1, 1), high=(1, 1, 4))), {}),
    "large": (lambda r: draw_list(soup(r, 60, size=0.4, low=(-1, -1, 2), high=(1, 1, 4))), {"near": 0.01}),
    "spheres": (
        lambda r: DrawList(tuple(Instance(sphere(24, 12, 0.8), Material(), pose(r, z=2.0 + k)) for k in range(3))),
        {"width": 333, "height": 217},
    ),
    "fine sphere": (lambda r: draw_list(Instance(sphere(300, 150), Material(), pose(r, z=2.5))), {"width": 320}),
    "shared edges": (lambda _: draw_list(grid(90, 70, ((-1, -1, 2), (1.1, -1, 3), (1, 1, 3), (-1, 0.9, 2.5)))), {}),
    "grazing": (lambda _: draw_list(grid(9, 40, ((-2, 0.4, 0.3), (2, 0.4, 0.3), (2, 0.5, 8), (-2, 0.5, 8)))), {}),
}


@pytest.mark.parametrize("width", [0, 8, 97])
@pytest.mark.parametrize("name", SCENES)
def test_vectors_give_the_bits_of_scalars(name: str, width: int) -> None:
    make, changes = SCENES[name]
    scene, view = make(np.random.default_rng(11)), camera(**{**changes, **({"width": width} if width else {})})
    ids, inverse = scalar.draw(scene, view)
    seen = CpuRenderer(1).visibility(scene, view)
    assert (seen.ids >= 0).any()
    np.testing.assert_array_equal(seen.ids, ids)
    covered = ids >= 0
    assert seen.inv_z[covered].tobytes() == inverse[covered].tobytes()


@njit
def _moves(values, whole, offsets, lanes, out, number, picture):
    o, n = f32_at(out), i32_at(number)
    at, lane = vec.load(i32_at(offsets), 0), vec.load(i32_at(lanes), 0)
    vec.store(o, 24, vec.f32(vec.lane(vec.load(f32_at(values), 0), 3)))
    vec.store(o, 32, vec.sqrt(vec.absolute(vec.load(f32_at(values), 0))))
    vec.store(n, 0, vec.float_bits(vec.load(f32_at(values), 0)))
    vec.store_rgb(u8_at(picture), 1, vec.load(i32_at(whole), 0))
    for k, part in enumerate(vec.load_quads(f32_at(values), at)):
        vec.store(o, 40 + 8 * k, part)
    for k, part in enumerate(vec.load_octets(f32_at(values), at)):
        vec.store(o, 72 + 8 * k, part)
    for k, part in enumerate(vec.load_rows(f32_at(values), u32_at(offsets), lane)):
        vec.store(o, 136 + 8 * k, part)


def test_loads_and_stores() -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(size=240).astype(np.float32)  # thirty rows of eight
    whole = rng.integers(0, 1 << 31, 40).astype(np.int32)
    offsets, lanes = rng.permutation(30)[:8].astype(np.int32), rng.integers(0, 8, 8).astype(np.int32)
    out, number, picture = np.zeros(200, np.float32), np.zeros(8, np.int32), np.full(72, 7, np.uint8)
    _moves(*(a.ctypes.data for a in (values, whole, offsets, lanes, out, number, picture)))
    assert (out[24:32] == values[3]).all()
    np.testing.assert_array_equal(out[32:40], np.sqrt(np.abs(values[:8])))
    eight = offsets[None] + np.arange(8)[:, None]
    np.testing.assert_array_equal(out[40:72].reshape(4, 8), values[eight[:4]])
    np.testing.assert_array_equal(out[72:136].reshape(8, 8), values[eight])
    np.testing.assert_array_equal(out[136:].reshape(8, 8), values.reshape(30, 8)[offsets[lanes]].T)
    np.testing.assert_array_equal(number, values[:8].view(np.int32))
    np.testing.assert_array_equal(picture[1:25], whole[:8].view(np.uint8).reshape(8, 4)[:, :3].ravel())
    assert picture[0] == 7
    assert (picture[29:32] == 7).all()  # four more bytes may be anything
    assert (picture[32:] == 7).all()


@njit
def _lookups(values, whole, offsets, lanes, out, number):
    o, n = f32_at(out), i32_at(number)
    at, lane = vec.load(i32_at(offsets), 0), vec.load(i32_at(lanes), 0)
    floats, integers = vec.load(f32_at(values), 0), vec.load(i32_at(whole), 0)
    vec.prefetch(i32_at(whole), 5)
    for k, part in enumerate(vec.load_pairs(i32_at(whole), i32_at(offsets), 0)):
        vec.store(n, 8 * k, part)
    vec.store(n, 16, vec.gather(i32_at(whole), at))
    vec.store(n, 32, vec.permute(integers, lane))
    vec.store(o, 0, vec.permute(floats, lane))
    for k, part in enumerate(vec.decode_pairs(f32_at(values), i32_at(whole), i32_at(offsets), 0)):
        vec.store(o, 16 + 8 * k, part)


def test_permutations_and_gathers() -> None:
    rng = np.random.default_rng(2)
    values = rng.normal(size=256).astype(np.float32)
    whole = rng.integers(0, 1 << 30, 40).astype(np.int32)
    offsets, lanes = rng.permutation(30)[:8].astype(np.int32), rng.integers(0, 8, 8).astype(np.int32)
    out, number = np.zeros(64, np.float32), np.zeros(40, np.int32)
    _lookups(*(a.ctypes.data for a in (values, whole, offsets, lanes, out, number)))
    pairs = whole[offsets + np.array((0, 1))[:, None]]
    np.testing.assert_array_equal(number[:16].reshape(2, 8), pairs)
    colors = pairs[:, None] >> np.array((0, 8, 16))[None, :, None] & 255
    np.testing.assert_array_equal(out[16:].reshape(2, 3, 8), values[colors])
    np.testing.assert_array_equal(number[16:24], whole[offsets])
    np.testing.assert_array_equal(number[32:40], whole[lanes])
    np.testing.assert_array_equal(out[:8], values[lanes])
