from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gateway.gltf import reader_kernels, warm_up
from gateway.gltf.compare import equal_bytes
from gateway.gltf.normals import vertex_normals
from gateway.gltf.reader_kernels import STRETCH, arrange, equal_arrays, gather, long_strings, read_meshes
from gateway.scene.transforms import IDENTITY, from_trs
from renderers.compiler.pointers import address_of
from renderers.stop import current_stop

Floats = NDArray[np.float32]
Triangles = NDArray[np.uint32]


def straightforward_normals(positions: Floats, triangles: Triangles) -> Floats:
    """One triangle after the other, in float64."""
    sums = np.zeros(positions.shape)
    for corners in triangles:
        a, b, c = positions[corners].astype(np.float64)
        (ux, uy, uz), (vx, vy, vz) = b - a, c - a
        normal = np.array((uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx))
        for corner in corners:
            sums[corner] += normal
    result = np.empty(positions.shape, np.float32)
    with np.errstate(all="ignore"):
        for i, (x, y, z) in enumerate(sums):
            length = np.sqrt(x * x + y * y + z * z)
            result[i] = sums[i] * (1.0 / length) if 0.0 < length < np.inf else (0.0, 0.0, 1.0)
    return result


def mesh(seed: int, vertices: int, triangles: int, scale: float = 1.0) -> tuple[Floats, Triangles]:
    rng = np.random.default_rng(seed)
    positions = (rng.normal(size=(vertices, 3)) * scale).astype(np.float32)
    indices = rng.integers(0, vertices, (triangles, 3), dtype=np.uint32)
    indices[0] = (0, vertices - 1, vertices // 2)  # so that all are in use
    return frozen(positions), frozen(indices)


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    array.flags.writeable = False
    return array


def read(
    positions: Floats,
    indices: NDArray[Any],
    limit: int,
    uv: Floats | None = None,
    given: Floats | None = None,
) -> tuple[bool, Floats, Triangles]:
    """Whether a mesh is sound, its normals and its indices; ``given``: the normals that it comes with."""
    normals, widened = np.full(positions.shape, 7.0, np.float32), np.empty(indices.shape, np.uint32)
    as_they_are = indices.dtype == np.uint32
    row = (
        address_of(positions, np.float32),
        len(positions),
        address_of(indices, indices.dtype.type),
        indices.size,
        indices.itemsize,
        address_of(uv, np.float32),
        address_of(given, np.float32),
        0 if as_they_are else address_of(widened, np.uint32),
        address_of(normals, np.float32),
        limit,
    )
    rows, good = np.array([row, row], np.int64), np.full(2, 7, np.uint8)
    read_meshes(rows.ctypes.data, 2, good.ctypes.data, current_stop().address)
    assert good[0] == good[1]
    return bool(good[0]), normals if given is None else given, indices if as_they_are else widened


def test_nothing_is_compiled_after_the_warm_up() -> None:
    """Read-only and writable arrays are different types to Numba: callers must always pass the same."""
    warm_up()
    data = bytes(10_000)
    for other in (bytes(10_000), memoryview(bytearray(10_000)), memoryview(bytearray(10_001))[1:]):
        assert equal_bytes(data, other)
        assert equal_bytes(memoryview(data), other)
    positions, triangles = np.zeros((3, 3), np.float32), np.array([(0, 1, 2)], np.uint32)
    for writeable in (True, False):
        positions.flags.writeable = triangles.flags.writeable = writeable
        vertex_normals(positions, triangles)
        assert positions.flags.writeable == writeable
    for kernel in (equal_arrays, read_meshes, gather, arrange, long_strings):
        assert len(kernel.signatures) == 1


@pytest.mark.parametrize(
    ("vertices", "triangles"), [(1, 1), (2, 3), (3, 1), (4, 9), (5, 9), (50, 100), (500, 300), (503, 900)]
)
@pytest.mark.parametrize("scale", [1.0, 1e-30, 1e30])
def test_normals_are_those_of_one_triangle_after_the_other(vertices: int, triangles: int, scale: float) -> None:
    positions, indices = mesh(vertices, vertices, triangles, scale)
    expected = straightforward_normals(positions, indices)
    for limit in (-1, vertices):
        sound, normals, _ = read(positions, indices, limit)
        assert sound
        np.testing.assert_array_equal(normals, expected)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.uint32])
def test_narrow_indices_are_widened(kind: type[np.unsignedinteger[Any]]) -> None:
    positions, indices = mesh(0, 50, 100)
    sound, normals, widened = read(positions, indices.astype(kind), 50)
    assert sound
    np.testing.assert_array_equal(widened, indices)
    np.testing.assert_array_equal(normals, straightforward_normals(positions, indices))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("at", [0, 7, 49])
def test_what_is_not_finite_is_found(value: float, at: int) -> None:
    good, indices = mesh(0, 50, 100)
    unit = straightforward_normals(good, indices)
    uv = np.zeros((50, 2), np.float32)
    bad, bad_uv, bad_unit = good.copy(), uv.copy(), unit.copy()
    bad[at, at % 3] = bad_uv[at, at % 2] = bad_unit[at, at % 3] = value
    for array in (uv, bad, bad_uv, unit, bad_unit):
        frozen(array)
    assert read(good, indices, 50, uv)[0]
    assert read(good, indices, 50, uv, unit)[0]
    for positions, coordinates, given_normals in ((bad, uv, unit), (good, bad_uv, unit), (good, uv, bad_unit)):
        assert not read(positions, indices, 50, coordinates, given_normals)[0]
        sound, normals, _ = read(positions, indices, 50, coordinates)
        assert sound == (given_normals is bad_unit)
        assert sound or (normals == 7.0).all()


def test_indices_out_of_range_and_narrow_ones_are_found() -> None:
    positions, indices = mesh(0, 50, 100)
    unit = frozen(straightforward_normals(positions, indices))
    narrow = frozen(indices % np.uint32(20))
    for triangles, limit, sound in ((indices, 50, True), (indices, 49, False), (narrow, 50, False)):
        assert read(positions, triangles, limit)[0] == sound
        assert read(positions, triangles, limit, given=unit)[0] == sound


def test_normals_that_are_not_of_unit_length_are_found() -> None:
    positions, indices = mesh(0, 50, 100)
    unit = straightforward_normals(positions, indices)
    for factor, sound in ((1.0, True), (1.0005, True), (1.01, False), (0.0, False)):
        changed = unit.copy()
        changed[30] *= np.float32(factor)
        assert read(positions, indices, 50, given=frozen(changed))[0] == sound


@given(st.lists(st.one_of(st.integers(0, 40), st.integers(480, 2100)), max_size=12), st.booleans())
@settings(deadline=None)
def test_long_strings_are_all_found(lengths: list[int], closed: bool) -> None:
    text = b'"'.join(bytes([97 + i]) * length for i, length in enumerate(lengths)) + b'"' * closed
    places = np.empty((len(text) // int(STRETCH), 2), np.int64)
    count = long_strings(np.frombuffer(text, np.uint8).ctypes.data, len(text), places.ctypes.data)
    found = places[:count].tolist()
    expected = [[m.start() + 1, m.end()] for m in re.finditer(rb'"[^"]*(?=")', text)]
    assert found == [[begin, end] for begin, end in expected if end - begin >= 2 * int(STRETCH)]


def placed(
    numbers: NDArray[np.float64], parents: list[int], composed: bytes = b""
) -> tuple[bool, NDArray[np.float64], NDArray[np.float64], list[int]]:
    """What ``arrange`` says and writes."""
    count, given = len(parents), numbers.copy()
    matrices, worlds = np.empty((count, 4, 4)), np.empty((count, 4, 4))
    moves = np.frombuffer(bytearray(composed or bytes(count)), np.uint8)
    above = np.array(parents, np.int64)
    places = (a.ctypes.data for a in (given, above, matrices, worlds, moves))
    return arrange(count, *places), matrices, worlds, moves.tolist()


def test_matrices_of_nodes() -> None:
    numbers = np.random.default_rng(0).normal(size=(3, 16))
    numbers[:, [3, 7, 11]], numbers[:, 15] = 1e-7, 1.0
    numbers[1] = IDENTITY.T.ravel()
    sound, matrices, worlds, moves = placed(numbers, [-1, -1, -1])
    assert sound
    assert moves == [1, 0, 1]
    np.testing.assert_array_equal(matrices[:, :3], numbers.reshape(3, 4, 4).transpose(0, 2, 1)[:, :3])
    assert (matrices[:, 3] == (0, 0, 0, 1)).all()
    np.testing.assert_array_equal(worlds, matrices)
    for at, value in ((0, np.nan), (20, np.inf), (35, 1e-5), (47, 2.0), (12, -np.inf)):
        odd = numbers.ravel().copy()
        odd[at] = value
        assert not placed(odd, [-1, -1, -1])[0]


def test_matrices_of_nodes_are_multiplied_from_the_roots_down() -> None:
    numbers = np.random.default_rng(1).normal(size=(6, 16))
    numbers[:, [3, 7, 11]], numbers[:, 15] = 0.0, 1.0
    numbers[0] = numbers[3] = IDENTITY.T.ravel()
    parents = [-1, 0, 1, 2, 3, -1]
    sound, matrices, worlds, moves = placed(numbers, parents)
    assert sound
    assert moves == [0, 1, 3, 2, 3, 1]
    for node, parent in enumerate(parents):
        expected = matrices[node] if parent < 0 else worlds[parent] @ matrices[node]
        np.testing.assert_allclose(worlds[node], expected, rtol=1e-12, atol=1e-14)
    for same, as_that in ((0, 0), (1, 1), (5, 5)):
        np.testing.assert_array_equal(worlds[same], matrices[as_that])
    np.testing.assert_array_equal(worlds[3], worlds[2])


def test_translations_rotations_and_scales_of_nodes() -> None:
    numbers = np.random.default_rng(2).normal(size=(4, 16))
    numbers[3, 3:7] = (0.0, 1e-160, 0.0, 0.0)
    sound, matrices, _, moves = placed(numbers[:3], [-1, -1, -1], b"\1" * 3)
    assert sound
    assert moves == [1, 1, 1]
    for given_, matrix in zip(numbers, matrices, strict=False):
        np.testing.assert_array_equal(matrix, from_trs(given_[:3], given_[3:7], given_[7:10]))
    assert not placed(numbers, [-1] * 4, b"\1" * 4)[0]  # left to who can tell


def test_all_kernels_are_warmed_up() -> None:
    warm_up()
    compiled = [value for value in vars(reader_kernels).values() if hasattr(value, "signatures")]
    entries = [kernel for kernel in compiled if not kernel.py_func.__name__.startswith("_")]
    assert len(entries) == 5
    assert all(kernel.signatures for kernel in entries)
