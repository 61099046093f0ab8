"""Parse legacy VTK files (.vtk): surfaces of polygons, and boundaries of tetrahedral volumes.

Source: "VTK File Formats", section "Simple Legacy Formats". Versions 2 to 4 (CELLS as counts and indices) and version 5
(OFFSETS and CONNECTIVITY) are read. Drake's hydroelastic meshes are UNSTRUCTURED_GRID files of tetrahedra.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

TRIANGLE, QUAD, TETRAHEDRON = 5, 9, 10
"""VTK cell types that are read; others are left out."""
_TYPES: Final = {
    b"float": ">f4",
    b"double": ">f8",
    b"int": ">i4",
    b"vtktypeint64": ">i8",
    b"long": ">i8",
    b"vtkidtype": ">i4",
}
"""NumPy types by the names in a file. Binary files are big-endian."""
_FACES: Final = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
"""Vertices of each face of a tetrahedron, counter-clockwise from outside."""


class VtkError(ValueError):
    """A file cannot be parsed. The message is the reason, without the file's name."""


class _Parser:
    """Reads words and arrays of a file in their order. Methods raise VtkError."""

    def __init__(self, data: bytes) -> None:
        lines = data.split(b"\n", 3)
        if len(lines) < 4 or not lines[0].lower().startswith(b"# vtk datafile"):
            raise VtkError("it does not start as a legacy VTK file")
        self._is_binary = lines[2].strip().upper() == b"BINARY"
        self._data = lines[3]
        self._position = 0

    def next_is(self, word: bytes) -> bool:
        """Return True if the next word is ``word``, and skip it then. ``word`` is in lower case."""
        begin = self._position
        if self.word() == word:
            return True
        self._position = begin
        return False

    def word(self) -> bytes:
        """Return the next word in lower case; empty at the end."""
        data, begin = self._data, self._position
        while begin < len(data) and data[begin : begin + 1].isspace():
            begin += 1
        end = begin
        while end < len(data) and not data[end : end + 1].isspace():
            end += 1
        self._position = end
        return data[begin:end].lower()

    def count(self, limit: int) -> int:
        """Return the next word as a number of elements, which is at most ``limit``."""
        word = self.word()
        count = int(word) if word.isdigit() and len(word) < 12 else -1
        if not 0 <= count <= limit:
            raise VtkError(f"it has {word.decode('ascii', 'replace')[:20]!r} elements, the limit is {limit}")
        return count

    def numbers(self, kind: bytes, count: int) -> NDArray[np.float64]:
        """Return the next ``count`` numbers, (count,) float64.

        Args:
            kind: type of the numbers in a binary file, a key of ``_TYPES``.
        """
        if self._is_binary:
            return self._binary(kind, count)
        found = self._data[self._position :].split(None, count)
        if len(found) < count:
            raise VtkError(f"it ends after {len(found)} of {count} numbers")
        self._position = len(self._data) - (len(found[count]) if len(found) > count else 0)
        try:
            return np.array(found[:count], dtype="S32").astype(np.float64)
        except ValueError:
            raise VtkError("it has a number that cannot be read") from None

    def _binary(self, kind: bytes, count: int) -> NDArray[np.float64]:
        dtype = _TYPES.get(kind)
        if dtype is None:
            raise VtkError(f"numbers of the type {kind.decode('ascii', 'replace')[:20]!r} cannot be read")
        begin = self._data.find(b"\n", self._position) + 1
        end = begin + np.dtype(dtype).itemsize * count
        if not begin or end > len(self._data):
            raise VtkError(f"it ends within an array of {count} numbers")
        self._position = end
        return np.frombuffer(self._data[begin:end], dtype).astype(np.float64)


def parse_vtk(data: bytes, max_vertices: int, max_triangles: int) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Return the surface in a file.

    Args:
        max_vertices: Maximum number of points.
        max_triangles: Maximum number of cells, and of triangles.

    Returns:
        Positions (N, 3) float32, in the file's unit, and triangles (M, 3) uint32.

    Raises:
        VtkError: The file is damaged, not a legacy VTK file with points and cells, or beyond a limit.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return _parse(_Parser(data), max_vertices, max_triangles)


def _parse(parser: _Parser, max_vertices: int, max_triangles: int) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    positions: NDArray[np.float32] | None = None
    cells: list[NDArray[np.int64]] = []
    types: NDArray[np.int64] | None = None
    while word := parser.word():
        if word == b"points":
            count = parser.count(max_vertices)
            positions = parser.numbers(parser.word(), 3 * count).reshape(count, 3).astype(np.float32)
        elif word in (b"cells", b"polygons"):
            cells = _cells(parser, max_triangles)
        elif word == b"cell_types":
            types = parser.numbers(b"int", parser.count(max_triangles)).astype(np.int64)
            break
        elif word in (b"point_data", b"cell_data"):
            break
    if positions is None or not cells:
        raise VtkError("it has no points or no cells")
    triangles = _triangles(cells, types)
    if len(triangles) > max_triangles:
        raise VtkError(f"it has {len(triangles)} triangles, the limit is {max_triangles}")
    if triangles.size and not (triangles.min() >= 0 and triangles.max() < len(positions)):
        raise VtkError(f"a cell refers to point {triangles.max()} of {len(positions)}")
    return positions, triangles.astype(np.uint32)


def _cells(parser: _Parser, limit: int) -> list[NDArray[np.int64]]:
    """Return the point indices of each cell, of at most ``limit`` cells."""
    first, size = parser.count(limit), parser.count(16 * limit)
    if parser.next_is(b"offsets"):  # version 5: numbers of offsets and of indices; before: of cells and of all numbers
        offsets = parser.numbers(parser.word(), first).astype(np.int64)
        if parser.word() != b"connectivity":
            raise VtkError("its cells have no connectivity")
        connectivity = parser.numbers(parser.word(), size).astype(np.int64)
        if len(offsets) and not ((np.diff(offsets) >= 0).all() and offsets[0] >= 0 and offsets[-1] <= size):
            raise VtkError("the offsets of its cells are not in order")
        return np.split(connectivity, offsets[1:-1]) if len(offsets) > 1 else []
    numbers = parser.numbers(b"int", size).astype(np.int64)
    cells: list[NDArray[np.int64]] = []
    start = 0
    for _ in range(first):
        count = int(numbers[start]) if start < size else -1
        if not 0 <= count < size - start:
            raise VtkError("a cell is cut off")
        cells.append(numbers[start + 1 : start + 1 + count])
        start += 1 + count
    return cells


def _triangles(cells: list[NDArray[np.int64]], types: NDArray[np.int64] | None) -> NDArray[np.int64]:
    """Return the triangles of cells, (M, 3): polygons as fans, then the boundary of the tetrahedra.

    Args:
        types: Type of each cell; None: they are convex polygons.
    """
    if types is not None and len(types) != len(cells):
        raise VtkError(f"it has {len(types)} types for {len(cells)} cells")
    surface: list[NDArray[np.int64]] = []
    tetrahedra: list[NDArray[np.int64]] = []
    for index, cell in enumerate(cells):
        kind = None if types is None else int(types[index])
        if kind == TETRAHEDRON and len(cell) == 4:
            tetrahedra.append(cell)
        elif kind in (None, TRIANGLE, QUAD) and len(cell) >= 3:
            surface += [cell[[0, k, k + 1]] for k in range(1, len(cell) - 1)]
    found = np.array(surface, np.int64).reshape(-1, 3)
    return np.concatenate((found, _boundary(np.array(tetrahedra, np.int64).reshape(-1, 4))))


def _boundary(tetrahedra: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the faces that belong to only one tetrahedron, (M, 3), in the order of the tetrahedra."""
    faces = tetrahedra[:, _FACES].reshape(-1, 3)
    _, first, counts = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    boundary: NDArray[np.int64] = faces[np.sort(first[counts == 1])]
    return boundary
