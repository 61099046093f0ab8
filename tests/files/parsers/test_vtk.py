"""Legacy VTK files: tetrahedra, polygons, binary numbers, damage."""

import struct
from pathlib import Path

import numpy as np
import pytest

from gateway.files.assets.mesh_files import MeshFiles
from gateway.files.parsers.mesh_data import MeshFaultError
from gateway.files.parsers.vtk import read_vtk
from gateway.scene.tree.geometry import Surface

HEAD = "# vtk DataFile Version 3.0\ntest\nASCII\nDATASET UNSTRUCTURED_GRID\n"
POINTS = "POINTS 5 double\n0 0 0 1 0 0\n0 1 0 0 0 1 1 1 1\n"
TWO_TETRAHEDRA = f"{HEAD}{POINTS}CELLS 2 10\n4 0 1 2 3\n4 1 2 3 4\nCELL_TYPES 2\n10 10\n"
VERSION_5 = (
    f"{HEAD}{POINTS}CELLS 3 8\nOFFSETS vtktypeint64\n0 4 8\nCONNECTIVITY vtktypeint64\n0 1 2 3 1 2 3 4\n"
    "CELL_TYPES 2\n10\n10\n"
)


def parse(text: str | bytes) -> tuple[np.ndarray, np.ndarray]:
    positions, triangles, _ = read_vtk(text if isinstance(text, bytes) else text.encode(), 1000, 1000, [])
    assert triangles is not None
    return positions, triangles


def binary() -> bytes:
    head = HEAD.replace("ASCII", "BINARY").encode()
    points = struct.pack(">12d", 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1)
    cells = struct.pack(">5i", 4, 0, 1, 2, 3)
    return b"".join(
        (head, b"POINTS 4 double\n", points, b"\nCELLS 1 5\n", cells, b"\nCELL_TYPES 1\n", struct.pack(">i", 10))
    )


@pytest.mark.parametrize("text", [TWO_TETRAHEDRA, VERSION_5])
def test_boundary_of_tetrahedra(text: str) -> None:
    positions, triangles = parse(text)
    assert positions.shape == (5, 3)
    assert {tuple(sorted(row)) for row in triangles.tolist()} == {
        *((0, 1, 2), (0, 1, 3), (0, 2, 3)),
        *((1, 2, 4), (1, 3, 4), (2, 3, 4)),
    }, "without the face between the two"


def test_normals_point_outwards_and_binary_numbers() -> None:
    positions, triangles = parse(binary())
    corners = positions[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert len(triangles) == 4
    assert ((corners.mean(axis=1) - positions.mean(axis=0)) * normals).sum(axis=1).min() > 0.0


@pytest.mark.parametrize(
    ("kind", "code"),
    [
        *(("char", "b"), ("unsigned_char", "B"), ("short", "h"), ("unsigned_short", "H"), ("unsigned_int", "I")),
        *(("vtkIdType", "i"), ("unsigned_long", "Q"), ("vtktypeuint64", "Q"), ("FLOAT", "f")),
    ],
)
def test_types_of_binary_numbers(kind: str, code: str) -> None:
    head = HEAD.replace("ASCII", "BINARY").replace("UNSTRUCTURED_GRID", "POLYDATA").encode()
    numbers = struct.pack(f">9{code}", 0, 0, 0, 100, 0, 0, 0, 7, 0)
    data = head + f"POINTS 3 {kind}\n".encode() + numbers + b"\nPOLYGONS 1 4\n" + struct.pack(">4i", 3, 0, 1, 2)
    assert parse(data)[0].tolist() == [[0, 0, 0], [100, 0, 0], [0, 7, 0]]


CUBE = "POINTS 8 float\n0 0 0 1 0 0 1 1 0 0 1 0\n0 0 1 1 0 1 1 1 1 0 1 1\n"
"""Unit cube, its corners in the order of a hexahedron."""


def grid(*cells: tuple[int, ...]) -> str:
    """Return a file of cells on the corners of the cube: type, then points."""
    rows = "".join(f"{len(points)} {' '.join(map(str, points))}\n" for _, *points in cells)
    count, numbers = len(cells), sum(map(len, cells))
    return (
        f"{HEAD}{CUBE}CELLS {count} {numbers}\n{rows}CELL_TYPES {count}\n{' '.join(str(each[0]) for each in cells)}\n"
    )


LOWER_PRISM = (42, 5, 3, 0, 2, 1, 3, 4, 5, 6, *(4, 0, 1, 5, 4), *(4, 1, 2, 6, 5), *(4, 2, 0, 4, 6))
"""A polyhedron of half the cube: the number of faces, then the points of each."""


@pytest.mark.parametrize(
    ("cells", "volume", "triangle_count"),
    [
        ([(12, 0, 1, 2, 3, 4, 5, 6, 7)], 1.0, 12),
        ([(11, 0, 1, 3, 2, 4, 5, 7, 6)], 1.0, 12),
        ([(25, *range(8), *[0] * 12)], 1.0, 12),
        ([(29, *range(8), *[0] * 19)], 1.0, 12),
        ([(72, *range(8), *[0] * 56), (68, 0, 1, 2, 3), (75, 0, 1, 2, 3)], 1.0, 12),
        ([(79, *range(8), *[0] * 56)], 1.0, 12),
        *(([(kind, 0, 3, 1, 4, 7, 5, 2), (kind, 1, 3, 2, 5, 7, 6, 0)], 1.0, 12) for kind in (73, 80)),
        *(([(kind, 0, 1, 2, 3, 4, 7)], 1 / 3, 6) for kind in (74, 81)),
        *(([(kind, 0, 1, 3, 4, 7)], 1 / 6, 4) for kind in (71, 78)),
        *(([(kind, 0, 1, 3, 7)] * 2, 0.0, 2) for kind in (69, 76)),
        *(([(kind, 0, 1, 2, 3, 7)], 0.0, 2) for kind in (70, 77)),
        ([(13, 0, 3, 1, 4, 7, 5), (13, 1, 3, 2, 5, 7, 6)], 1.0, 12),
        ([(14, 0, 1, 2, 3, 4)], 1 / 3, 6),
        ([(14, 0, 1, 2, 3, 4), (14, 4, 5, 1, 0, 2)], 2 / 3, 12),
        ([(14, 0, 1, 2, 3, 6), (10, 0, 1, 6, 5)], 1 / 2, 8),
        ([LOWER_PRISM], 1 / 2, 8),
        ([LOWER_PRISM, (42, 5, 3, 0, 3, 2, 3, 4, 6, 7, *(4, 0, 4, 6, 2), *(4, 2, 3, 7, 6), *(4, 3, 0, 4, 7))], 1.0, 12),
    ],
    ids=[
        "hexahedron",
        "voxel",
        "quadratic",
        "triquadratic",
        "Lagrange",
        "Bézier",
        *(f"two wedges, {kind}" for kind in (73, 80)),
        *(f"pyramid, {kind}" for kind in (74, 81)),
        *(f"tetrahedron, {kind}" for kind in (71, 78)),
        *(f"two triangles, {kind}" for kind in (69, 76)),
        *(f"quadrilateral, {kind}" for kind in (70, 77)),
        "two wedges",
        "pyramid",
        "two pyramids",
        "pyramid and tetrahedron",
        "polyhedron",
        "two polyhedra",
    ],
)
def test_boundary_of_volumes(cells: list[tuple[int, ...]], volume: float, triangle_count: int) -> None:
    positions, triangles = parse(grid(*cells))
    corners = positions[triangles]
    assert np.linalg.det(corners).sum() / 6 == pytest.approx(volume), "triangles face outwards"
    assert len(triangles) == triangle_count


def test_polygons_pixels_and_strips() -> None:
    _, triangles = parse(grid((7, 0, 1, 2, 3, 7), (8, 0, 1, 3, 2), (6, 0, 1, 3, 2)))
    assert triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 7], [0, 1, 2], [0, 2, 3], [0, 1, 3], [2, 3, 1]]
    strips = (
        HEAD.replace("UNSTRUCTURED_GRID", "POLYDATA") + CUBE + "POLYGONS 1 4\n3 0 1 2\nTRIANGLE_STRIPS 1 5\n4 0 1 3 2\n"
    )
    assert parse(strips)[1].tolist() == [[0, 1, 2], [0, 1, 3], [2, 3, 1]]


def test_the_limit_holds_for_all_sections_together() -> None:
    section = "POLYGONS 1 4\n3 0 1 2\n"
    with pytest.raises(MeshFaultError, match="it has 6 triangles, the limit is 5"):
        read_vtk((HEAD + CUBE + 6 * section).encode(), 1000, 5, [])


def test_cells_of_other_types_are_a_warning() -> None:
    warnings: list[str] = []
    prism = (15, *range(8), 0, 1)
    read_vtk(grid((5, 0, 1, 2), (3, 0, 1), prism).encode(), 1000, 1000, warnings)
    assert warnings == ["1 of 3 cells are left out, of VTK's types 15"]


@pytest.mark.parametrize("digits", [25, 26, 27, 28, 60, 5000])
def test_numbers_of_any_length_are_read_whole(digits: int) -> None:
    text = TWO_TETRAHEDRA.replace("0 0 0 1 0 0", f"0 0 0 1.{digits * '0'}e-03 0 0")
    assert parse(text)[0][1].tolist() == pytest.approx([0.001, 0, 0])


def test_points_and_lines_have_no_surface() -> None:
    mixed = f"{HEAD}{POINTS}CELLS 3 10\n3 0 1 2\n2 0 1\n2 1 2\nCELL_TYPES 3\n5 3 3\n"
    assert parse(mixed)[1].tolist() == [[0, 1, 2]]
    warnings: list[str] = []
    lines = f"{HEAD}{POINTS}CELLS 2 5\n2 0 1\n1 2\nCELL_TYPES 2\n3 1\n".encode()
    positions, triangles, _ = read_vtk(lines, 1000, 1000, warnings)
    assert (len(positions), triangles, len(warnings)) == (5, None, 1)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("solid", "does not start as"),
        (HEAD, "no points or no cells"),
        (TWO_TETRAHEDRA.replace("4 1 2 3 4", "4 1 2 3 9"), "refers to point 9 of 5"),
        (TWO_TETRAHEDRA.replace("4 1 2 3 4", "9 1 2 3 4"), "cut off"),
        (TWO_TETRAHEDRA.replace("POINTS 5", "POINTS 5000"), "the limit is 1000"),
        (TWO_TETRAHEDRA.replace("POINTS 5", "POINTS x"), "'x' elements"),
        (TWO_TETRAHEDRA.replace("1 1 1\n", "1 1 z\n"), "cannot be read"),
        (TWO_TETRAHEDRA.replace("CELL_TYPES 2\n10 10", "CELL_TYPES 1\n10"), "1 types for 2 cells"),
        (TWO_TETRAHEDRA.replace("4 1 2 3 4", "nan 1 2 3 4"), "cut off"),
        (VERSION_5.replace("0 4 8", "0 9 8"), "not in order"),
        (VERSION_5.replace("CONNECTIVITY", "NOTHING"), "no connectivity"),
        (binary()[:100], "ends within an array"),
    ],
)
def test_damage(text: str | bytes, reason: str) -> None:
    with pytest.raises(MeshFaultError, match=reason):
        parse(text)


def test_cut_off_and_changed_bytes_never_raise_others() -> None:
    for whole in (TWO_TETRAHEDRA.encode(), VERSION_5.encode(), binary()):
        for position in range(len(whole)):
            for damaged in (whole[:position], whole[:position] + b"\xff" + whole[position + 1 :]):
                try:
                    parse(damaged)
                except MeshFaultError:
                    pass


SHADES = [[255, 0, 0, 255], [0, 128, 0, 255], [10, 20, 30, 255], [1, 2, 3, 255], [4, 5, 6, 255]]


FLAT = (
    f"{HEAD.replace('UNSTRUCTURED_GRID', 'POLYDATA')}{POINTS}VERTICES 1 2\n1 0\n"
    "POLYGONS 1 5\n4 0 1 4 2\nTRIANGLE_STRIPS 1 5\n4 0 1 2 3\n"
)
"""A vertex, a polygon and a strip, in this order."""
OF_POINTS = "POINT_DATA 5\nSCALARS other float\nLOOKUP_TABLE default\n0 0 0 0 0\n"


@pytest.mark.parametrize(
    ("text", "counts"), [(TWO_TETRAHEDRA + OF_POINTS, (3, 3)), (TWO_TETRAHEDRA, (3, 3)), (FLAT + OF_POINTS, (0, 2, 2))]
)
def test_colors_of_cells(text: str, counts: tuple[int, ...]) -> None:
    values = np.array(SHADES[: len(counts)])[:, :3]
    rows = " ".join(f"{channel / 255:.6f}" for channel in values.ravel())
    data = f"{text}CELL_DATA {len(counts)}\nCOLOR_SCALARS rgb 3\n{rows}\n".encode()
    positions, triangles, colors = read_vtk(data, 1000, 1000, [])
    assert len(positions) == len(colors) == 3 * len(triangles)
    assert [int((colors[:, :3] == each).all(axis=1).sum()) for each in values] == [3 * count for count in counts]
    assert (colors[:, 3] == 255).all()


def test_binary_gray_with_opacity() -> None:
    data = binary() + b"\nCELL_DATA 1\nCOLOR_SCALARS rgb 2\n\x07\x09"
    _, _, colors = read_vtk(data, 1000, 1000, [])
    assert colors is not None
    assert np.unique(colors, axis=0).tolist() == [[7, 7, 7, 9]]


def test_a_cloud_of_vertices_has_its_colors() -> None:
    rows = " ".join(f"{channel / 255:.4f}" for shade in SHADES for channel in shade)
    text = f"{HEAD.replace('UNSTRUCTURED_GRID', 'POLYDATA')}{POINTS}VERTICES 5 10\n{'1 0 ' * 5}\nPOINT_DATA 5\n"
    positions, triangles, colors = read_vtk(f"{text}COLOR_SCALARS rgba 4\n{rows}\n".encode(), 1000, 1000, [])
    assert triangles is None
    assert positions.shape == (5, 3)
    assert colors.tolist() == SHADES


def test_colors_that_are_cut_off_are_a_warning() -> None:
    warnings: list[str] = []
    _, triangles, colors = read_vtk(f"{TWO_TETRAHEDRA}CELL_DATA 2\nCOLOR_SCALARS c 3\n1 0\n".encode(), 9, 9, warnings)
    assert triangles is not None
    assert colors is None
    assert "colours" in warnings[0]


def test_as_a_mesh_file(tmp_path: Path) -> None:
    (tmp_path / "two.vtk").write_text(TWO_TETRAHEDRA)
    (part,) = MeshFiles((tmp_path,)).load("two.vtk")
    assert isinstance(part.shape, Surface)
    assert len(part.shape.mesh.elements) == 6


RECTILINEAR = (
    "RECTILINEAR_GRID\nDIMENSIONS 2 3 4\nX_COORDINATES 2 float\n0 1\nY_COORDINATES 3 float\n0 1 3\n"
    "Z_COORDINATES 4 float\n-1 0 2 5\n"
)


@pytest.mark.parametrize(
    ("points", "bounds"),
    [
        (RECTILINEAR, [[0, 0, -1], [1, 3, 5]]),
        ("STRUCTURED_POINTS\nDIMENSIONS 2 3 4\nSPACING 2 1 .5\nORIGIN 0 0 1\n", [[0, 0, 1], [2, 2, 2.5]]),
        ("STRUCTURED_POINTS\nORIGIN 0 0 1\nASPECT_RATIO 2 1 .5\nDIMENSIONS 2 3 1\n", [[0, 0, 1], [2, 2, 1]]),
    ],
    ids=["rectilinear", "points", "flat"],
)
def test_grids_without_points_of_their_own(points: str, bounds: list[list[float]]) -> None:
    positions, triangles = parse(HEAD.replace("UNSTRUCTURED_GRID\n", points))
    assert [positions.min(axis=0).tolist(), positions.max(axis=0).tolist()] == bounds
    corners = positions[triangles]
    assert np.linalg.det(corners - positions.mean(axis=0)).sum() / 6 == pytest.approx(np.prod(np.diff(bounds, axis=0)))


@pytest.mark.parametrize("axes", ["STRUCTURED_POINTS\nDIMENSIONS 99 99 99\n", "RECTILINEAR_GRID\nDIMENSIONS 2 2 2\n"])
def test_grids_beyond_the_limit_or_cut_off(axes: str) -> None:
    with pytest.raises(MeshFaultError, match=r"970299 points|no points"):
        parse(HEAD.replace("UNSTRUCTURED_GRID\n", axes))
