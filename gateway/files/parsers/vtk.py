"""Reads legacy VTK files (.vtk): polygons, boundaries of volumes and of grids, clouds of vertices, colours.

Source: "VTK File Formats", section "Simple Legacy Formats". Versions 2 to 4 (CELLS as counts and indices) and version 5
(OFFSETS and CONNECTIVITY) are read. Drake's hydroelastic meshes are UNSTRUCTURED_GRID files of tetrahedra.
"""

import re
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.files.parsers.mesh_data import MeshFaultError
from gateway.files.parsers.polygons import triangles_of_polygons, triangles_of_strip

_STRIP, _POLYGON, _PIXEL, _QUAD = 6, 7, 8, 9
_TETRAHEDRON, _VOXEL, _HEXAHEDRON, _WEDGE, _PYRAMID = range(10, 15)
"""VTK's numbers of cell types."""
_FACES: Final = {
    _TETRAHEDRON: ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)),
    _VOXEL: ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)),
    _HEXAHEDRON: ((0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7)),
    _WEDGE: ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    _PYRAMID: ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}
"""Corners of each face of a volume, counter-clockwise from outside."""
_CORNERS: Final = {5: 3, _PIXEL: 4, _QUAD: 4, _TETRAHEDRON: 4, _VOXEL: 8, _HEXAHEDRON: 8, _WEDGE: 6, _PYRAMID: 5}
"""Number of corners by cell type, where it is the same for all cells."""
_LINEAR: Final = {
    5: (22, 34, 69, 76),
    _QUAD: (23, 28, 30, 70, 77),
    _TETRAHEDRON: (24, 71, 78),
    _HEXAHEDRON: (25, 29, 33, 72, 79),
    _WEDGE: (26, 31, 32, 73, 80),
    _PYRAMID: (27, 37, 74, 81),
}
"""Curved types (quadratic ones, Lagrange's from 69, Bézier's from 76) by the linear type with the same corners. Their
other points come after the corners."""
_VERTICES: Final = (1, 2)
"""Cell types that are points."""
_WITHOUT_SURFACE: Final = (0, *_VERTICES, 3, 4, 21, 35, 68, 75)
"""Cell types that are points or lines."""
_POLYHEDRON: Final = 42
_GRIDS: Final = (b"structured_grid", b"rectilinear_grid", b"structured_points")
_DATA_SETS: Final = (b"polydata", b"unstructured_grid", *_GRIDS)
_SECTIONS: Final = {b"vertices": 2, b"lines": 4, b"polygons": _POLYGON, b"triangle_strips": _STRIP}
"""Cell types by the keyword of a section of POLYDATA."""
_COLORS: Final = re.compile(rb"(?im)^(?:(POINT|CELL)_DATA[ \t]+\d+|COLOR_SCALARS[ \t]+\S+[ \t]+([1-4]))[ \t\r]*$")
"""Start of the attributes of points or cells, or of colours: grey or RGB, with or without opacity."""
_TYPES: Final = {
    b"float": ">f4",
    b"double": ">f8",
    b"char": ">i1",
    b"signed_char": ">i1",
    b"unsigned_char": ">u1",
    b"short": ">i2",
    b"unsigned_short": ">u2",
    b"int": ">i4",
    b"unsigned_int": ">u4",
    b"long": ">i8",
    b"unsigned_long": ">u8",
    b"vtktypeint64": ">i8",
    b"vtktypeuint64": ">u8",
    b"vtkidtype": ">i4",
}
"""NumPy types by the names in a file. Binary files are big-endian."""
_WORD: Final = re.compile(rb"\S+")
_MAX_WORD: Final = 64
"""Maximum length of a word in bytes: keywords and counts are shorter."""


class _Parser:
    """Reads words and arrays of a file in their order. Methods raise MeshFaultError."""

    def __init__(self, data: bytes) -> None:
        lines = data.split(b"\n", 3)
        if len(lines) < 4 or not lines[0].lower().startswith(b"# vtk datafile"):
            raise MeshFaultError("it does not start as a legacy VTK file")
        self._is_binary = lines[2].strip().upper() == b"BINARY"
        self._data = lines[3]
        self._position = 0

    def next_is(self, word: bytes) -> bool:
        """Return True and skip the next word if it is ``word``, which is in lower case; else return False."""
        begin = self._position
        if self.word() == word:
            return True
        self._position = begin
        return False

    def word(self) -> bytes:
        """Return the next word in lower case, at most ``_MAX_WORD`` bytes of it; empty at the end."""
        found = _WORD.search(self._data, self._position)
        self._position = len(self._data) if found is None else found.end()
        return b"" if found is None else self._data[found.start() : min(found.end(), found.start() + _MAX_WORD)].lower()

    def count(self, limit: int) -> int:
        """Return the next word as a number of elements, which is at most ``limit``."""
        word = self.word()
        count = int(word) if word.isdigit() and len(word) < 12 else -1
        if not 0 <= count <= limit:
            raise MeshFaultError(f"it has {word.decode('ascii', 'replace')[:20]!r} elements, the limit is {limit}")
        return count

    def numbers(self, kind: bytes, count: int) -> NDArray[np.float64]:
        """Return the next ``count`` numbers, float64. ``kind``: their type in a binary file, a key of ``_TYPES``."""
        if self._is_binary:
            return self._binary(kind, count)
        # Split a window that grows until it holds all numbers: splitting the whole rest each time would be quadratic.
        end = self._position
        while True:
            end = min(len(self._data), 2 * end - self._position + 32 * (count + 2))
            found = self._data[self._position : end].split(None, count)
            if len(found) > count or end == len(self._data):
                break
        if len(found) < count:
            raise MeshFaultError(f"it ends after {len(found)} of {count} numbers")
        self._position = end - (len(found[count]) if len(found) > count else 0)
        try:
            return np.fromiter(map(float, found[:count]), np.float64, count)
        except ValueError:
            raise MeshFaultError("it has a number that cannot be read") from None

    def _binary(self, kind: bytes, count: int) -> NDArray[np.float64]:
        dtype = _TYPES.get(kind)
        if dtype is None:
            raise MeshFaultError(f"numbers of the type {kind.decode('ascii', 'replace')[:20]!r} cannot be read")
        begin = self._data.find(b"\n", self._position) + 1
        end = begin + np.dtype(dtype).itemsize * count
        if not begin or end > len(self._data):
            raise MeshFaultError(f"it ends within an array of {count} numbers")
        self._position = end
        return np.frombuffer(self._data[begin:end], dtype).astype(np.float64)

    def colors(self, of_cells: bool, points: int, cells: int) -> tuple[bool, NDArray[np.uint8]] | None:
        """Return True for colours of the cells, and the first colours in the rest, (``points`` or ``cells``, 4).

        ``of_cells``: the position is in the attributes of cells.
        """
        for found in _COLORS.finditer(self._data, self._position):
            if found[2] is None:
                of_cells = found[1].lower() == b"cell"
                continue
            self._position = found.end()
            count, channels = cells if of_cells else points, int(found[2])
            values = self.numbers(b"unsigned_char", channels * count).reshape(count, channels)
            if not self._is_binary:
                values = np.floor(255.0 * values + 0.5)  # as VTK rounds
            rgb = values[:, :3] if channels > 2 else values[:, :1].repeat(3, axis=1)
            alpha = values[:, -1:] if channels in (2, 4) else np.full((count, 1), 255.0)
            return of_cells, np.clip(np.hstack((rgb, alpha)), 0.0, 255.0).astype(np.uint8)
        return None


@np.errstate(over="ignore", invalid="ignore")
def read_vtk(
    data: bytes, max_vertices: int, max_triangles: int, warnings: list[str]
) -> tuple[NDArray[np.float64], NDArray[np.int64] | None, NDArray[np.uint8] | None]:
    """Return positions, (N, 3) in the file's unit, triangles, (M, 3), and sRGB colours, (N, 4), of a surface.

    Triangles are None if all cells are vertices or lines: a cloud, with a warning for lines. Elsewhere these are left
    out, and cells of other types with a warning. Colours are None without COLOR_SCALARS; with those of cells, each
    triangle has vertices of its own. ``max_triangles`` is the limit of cells, too. Raises MeshFaultError if the file is
    damaged, not a legacy VTK file with points and cells, or beyond a limit.
    """
    parser = _Parser(data)
    positions: NDArray[np.float64] | None = None
    points: list[NDArray[np.int64]] = []
    sizes: list[NDArray[np.int64]] = []
    types: list[NDArray[np.int64]] = []
    shape: tuple[int, ...] = ()
    axes: list[NDArray[np.float64]] = []
    origin, spacing = [0.0] * 3, [1.0] * 3
    kind = b""
    while word := parser.word():
        if word == b"dataset" and (kind := parser.word()) not in _DATA_SETS:
            names = ", ".join(name.decode().upper() for name in _DATA_SETS)
            raise MeshFaultError(f"its data set is {kind.decode('ascii', 'replace').upper()[:40]}, not {names}")
        if word == b"dimensions":
            shape = tuple(parser.count(max_vertices) for _ in range(3))[::-1]
        elif word == b"points":
            count = parser.count(max_vertices)
            positions = parser.numbers(parser.word(), 3 * count).reshape(count, 3)
        elif kind == b"structured_points" and word == b"origin":
            origin = [float(parser.word()) for _ in range(3)]
        elif kind == b"structured_points" and word in (b"spacing", b"aspect_ratio"):
            spacing = [float(parser.word()) for _ in range(3)]
        elif kind == b"rectilinear_grid" and word.endswith(b"_coordinates"):
            count = parser.count(max_vertices)
            axes.append(parser.numbers(parser.word(), count))
        elif word == b"cells" or word in _SECTIONS:
            points_of_section, sizes_of_section = _cells(parser, max_triangles)
            points.append(points_of_section)
            sizes.append(sizes_of_section)
            types.append(np.full(len(sizes_of_section), _SECTIONS.get(word, _POLYGON)))
        elif word == b"cell_types" and types:
            types[-1] = parser.numbers(b"int", parser.count(max_triangles)).astype(np.int64)
            break
        elif word in (b"point_data", b"cell_data"):
            break
    if kind == b"structured_points":
        axes = [
            start + step * np.arange(n, dtype=np.float64)
            for n, step, start in zip(shape[::-1], spacing, origin, strict=False)
        ]
    if len(axes) == 3:
        positions = _grid_points(axes, max_vertices)
    if shape and positions is not None:
        corners, kind_of_cell = _grid_cells(shape, len(positions), max_triangles)
        points, sizes = [corners.ravel()], [np.full(len(corners), corners.shape[1])]
        types = [np.full(len(corners), kind_of_cell)]
    if positions is None or not any(map(len, sizes)):
        raise MeshFaultError("it has no points or no cells")
    cells = np.concatenate(points), np.concatenate(sizes), np.concatenate(types)
    colors: tuple[bool, NDArray[np.uint8]] | None = None
    try:
        colors = parser.colors(word == b"cell_data", len(positions), len(cells[1]))
    except MeshFaultError as error:
        warnings.append(f"its colours are left out: {error}")
    if np.isin(cells[2], _WITHOUT_SURFACE).all():
        if lines := np.count_nonzero(~np.isin(cells[2], _VERTICES)):
            warnings.append(f"its {lines} lines are not drawn, only its points")
        return positions, None, None if colors is None or colors[0] else colors[1]
    triangles, cell = np.split(_triangles(*cells, positions, max_triangles, warnings), [3], axis=1)
    if triangles.size and not (triangles.min() >= 0 and triangles.max() < len(positions)):
        worst = int(triangles.min()) if triangles.min() < 0 else int(triangles.max())
        raise MeshFaultError(f"a cell refers to point {worst} of {len(positions)}")
    if colors is None or not colors[0]:
        return positions, triangles, None if colors is None else colors[1]
    return (
        positions[triangles.ravel()],
        np.arange(triangles.size).reshape(-1, 3),
        colors[1][cell[:, 0]].repeat(3, axis=0),
    )


def _grid_points(axes: list[NDArray[np.float64]], limit: int) -> NDArray[np.float64]:
    """Return the points of a grid at these x, y and z, (N, 3), x fastest. N is at most ``limit``."""
    if (count := np.prod([len(axis) for axis in axes], dtype=np.float64)) > limit:
        raise MeshFaultError(f"its grid has {count:.0f} points, the limit is {limit}")
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).swapaxes(0, 2).reshape(-1, 3)


def _grid_cells(shape: tuple[int, ...], points: int, limit: int) -> tuple[NDArray[np.int64], int]:
    """Return the points of the cells of a grid, (N, corners), and their type: quads, or hexahedra.

    ``shape``: number of points along z, y and x.
    """
    if int(np.prod(shape, dtype=np.float64)) != points or points > limit:
        raise MeshFaultError(
            f"its {points} points are no grid of {shape[2]} x {shape[1]} x {shape[0]}, or beyond {limit}"
        )
    grid = np.arange(points).reshape([count for count in shape if count > 1])
    if grid.ndim < 2:
        return np.zeros((0, 4), np.int64), _QUAD
    low, high = grid[..., :-1, :], grid[..., 1:, :]
    faces = np.stack((low[..., :-1], low[..., 1:], high[..., 1:], high[..., :-1]), axis=-1)
    if grid.ndim == 2:
        return faces.reshape(-1, 4), _QUAD
    return np.concatenate((faces[:-1], faces[1:]), axis=-1).reshape(-1, 8), _HEXAHEDRON


def _cells(parser: _Parser, limit: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the points of all cells, and the number of points of each cell, (N,); N is at most ``limit``."""
    first, size = parser.count(limit), parser.count(16 * limit)
    # Version 5 states the numbers of offsets and of indices; older versions, of cells and of integers in the list.
    if parser.next_is(b"offsets"):
        offsets = parser.numbers(parser.word(), first).astype(np.int64)
        if parser.word() != b"connectivity":
            raise MeshFaultError("its cells have no connectivity")
        connectivity = parser.numbers(parser.word(), size).astype(np.int64)
        if len(offsets) and not ((np.diff(offsets) >= 0).all() and offsets[0] >= 0 and offsets[-1] <= size):
            raise MeshFaultError("the offsets of its cells are not in order")
        return connectivity[offsets[0] : offsets[-1]] if first else connectivity[:0], np.diff(offsets)
    numbers = parser.numbers(b"int", size).astype(np.int64)
    places = np.empty(first, np.int64)  # of the cells' sizes, each before its points
    place = 0
    for cell in range(first):
        count = int(numbers[place]) if place < size else -1
        if not 0 <= count < size - place:
            raise MeshFaultError("a cell is cut off")
        places[cell] = place
        place += 1 + count
    return np.delete(numbers[:place], places), numbers[places]


def _triangles(
    points: NDArray[np.int64],
    sizes: NDArray[np.int64],
    types: NDArray[np.int64],
    positions: NDArray[np.float64],
    limit: int,
    warnings: list[str],
) -> NDArray[np.int64]:
    """Return the triangles of cells and the cell of each, (M, 4): of polygons, strips, the boundary of volumes.

    ``points``: those of all cells; ``sizes``, ``types``: number of points and type of each. A warning is added if cells
    are left out.
    """
    if len(types) != len(sizes):
        raise MeshFaultError(f"it has {len(types)} types for {len(sizes)} cells")
    points, sizes, types, numbers = _without_polyhedra(points, sizes, types)
    starts = np.cumsum(sizes) - sizes
    for linear, curved in _LINEAR.items():
        types[np.isin(types, curved)] = linear
    known = np.isin(types, (_STRIP, _POLYGON)) & (sizes >= 3)
    for kind, count in _CORNERS.items():
        has_corners = (types == kind) & (sizes >= count)
        sizes[has_corners] = count
        known |= has_corners
    left_out = ~known & ~np.isin(types, _WITHOUT_SURFACE)
    if left_out.any():
        kinds = ", ".join(map(str, np.unique(types[left_out])[:5]))
        warnings.append(f"{np.count_nonzero(left_out)} of {len(types)} cells are left out, of VTK's types {kinds}")
    third = starts[known & (types == _PIXEL)] + 2
    points[np.stack((third, third + 1))] = points[np.stack((third + 1, third))]  # their corners are in rows
    is_strip = known & (types == _STRIP)
    is_polygon = known & (types < _TETRAHEDRON) & ~is_strip
    total = int((sizes[is_polygon | is_strip] - 2).sum())
    if total > limit:
        raise MeshFaultError(f"it has {total} triangles, the limit is {limit}")
    polygons = triangles_of_polygons(points, starts[is_polygon], sizes[is_polygon], positions)
    ends = starts[is_strip] + sizes[is_strip]
    strips = [np.append(points[start:end], -1) for start, end in zip(starts[is_strip], ends, strict=True)]
    flat = np.concatenate((polygons, triangles_of_strip(np.concatenate([[-1], *strips]))))
    cells = np.concatenate([np.flatnonzero(of_kind).repeat(sizes[of_kind] - 2) for of_kind in (is_polygon, is_strip)])
    volumes = {kind: np.flatnonzero(known & (types == kind)) for kind in _FACES}
    boundary = _boundary(
        {
            kind: (points[starts[of_kind][:, None] + np.arange(_CORNERS[kind])], of_kind)
            for kind, of_kind in volumes.items()
        }
    )
    found = np.concatenate((np.column_stack((flat, cells)), boundary))
    found[:, 3] = numbers[found[:, 3]]
    if len(found) > limit:
        raise MeshFaultError(f"it has {len(found)} triangles, the limit is {limit}")
    return found


def _without_polyhedra(
    points: NDArray[np.int64], sizes: NDArray[np.int64], types: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return points, sizes and types with faces that only one polyhedron has in place of polyhedra, and cells' numbers.

    The points of a polyhedron are the number of its faces, then the number of points and the points of each.
    """
    is_polyhedron = types == _POLYHEDRON
    faces: dict[tuple[int, ...], list[tuple[int, list[int]]]] = {}
    ends = np.cumsum(sizes)
    for cell in np.flatnonzero(is_polyhedron).tolist():
        numbers = points[ends[cell] - sizes[cell] + 1 : ends[cell]].tolist()
        place = 0
        while place < len(numbers):
            face = numbers[place + 1 : place + 1 + max(0, numbers[place])]
            faces.setdefault(tuple(sorted(face)), []).append((cell, face))
            place += 1 + len(face)
    outer = [found[0] for found in faces.values() if len(found) == 1]
    kept = np.flatnonzero(~is_polyhedron)
    return (
        np.concatenate([points[~is_polyhedron.repeat(sizes)], *(np.array(face, np.int64) for _, face in outer)]),
        np.append(sizes[kept], [len(face) for _, face in outer]).astype(np.int64),
        np.append(types[kept], [_POLYGON] * len(outer)).astype(np.int64),
        np.append(kept, [cell for cell, _ in outer]).astype(np.int64),
    )


def _boundary(volumes: dict[int, tuple[NDArray[np.int64], NDArray[np.int64]]]) -> NDArray[np.int64]:
    """Return the triangles of faces that belong to only one volume, and its cell, (M, 4).

    ``volumes``: points and cells by cell type.
    """
    faces = np.concatenate([
        np.column_stack((np.pad(corners[:, face], ((0, 0), (0, 4 - len(face))), constant_values=-1), cells))
        for kind, (corners, cells) in volumes.items()
        for face in _FACES[kind]
    ])  # fmt: skip
    _, first, counts = np.unique(np.sort(faces[:, :4], axis=1), axis=0, return_index=True, return_counts=True)
    boundary = faces[np.sort(first[counts == 1])]
    quads = boundary[boundary[:, 3] >= 0]
    return np.concatenate((boundary[:, [0, 1, 2, 4]], quads[:, [0, 2, 3, 4]]))
