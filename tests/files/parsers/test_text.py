"""Text of mesh files with numbers and rows that their formats do not have, as programs wrote them."""

import pytest

from tests.files.assets.mesh_files.files import ply
from tests.files.parsers.test_mesh import VTK, area, content

CORNERS = ("0 0 0", "2 0 0", "0 3 0")


@pytest.mark.parametrize("number", ["1.#IND", "-1.#IND00", "1.#QNAN0", "-1.#INF", "nan"])
def test_numbers_that_are_not_finite_as_windows_prints_them(number: str) -> None:
    """A vertex with one costs its triangle, a normal nothing."""
    corners = (*CORNERS, f"0 {number} 0")
    obj = "".join(f"v {corner}\n" for corner in corners)
    assert area(f"{obj}vn 0 {number} 1\nf 1//1 2//1 3//1\nf 1//1 2//1 4//1\n", "obj") == pytest.approx(3.0)
    assert area(ply(4, "\n".join((*corners, "3 0 1 2\n3 0 1 3\n")), faces=2), "ply") == pytest.approx(3.0)
    facets = "".join(f"vertex {corner}\n" for corner in (*CORNERS, *corners[1:]))
    assert area(f"solid\n{facets}endsolid\n", "stl") == pytest.approx(3.0)
    cells = f"POINTS 4 float\n{' '.join(corners)}\nPOLYGONS 2 8\n3 0 1 2 3 0 1 3\n"
    assert area(VTK + cells.encode(), "vtk") == pytest.approx(3.0)


@pytest.mark.parametrize("length", ["3.0", "+3", "3.000000000000000000e+00"])
def test_lengths_of_lists_as_numpy_writes_them(length: str) -> None:
    data = ply(3, "\n".join((*CORNERS, f"{length} 0 1 2\n")), faces=1)
    assert area(data, "ply") == pytest.approx(3.0)
    assert content(data, "ply").warnings == []


def test_ply_with_colors_of_corners_in_place_of_the_color_of_a_face() -> None:
    """Old versions of MeshLab wrote them."""
    rows = "3 0 1 2 9 1 1 1 1 1 1 1 1 1\n4 0 1 2 3 12 1 1 1 1 1 1 1 1 1 1 1 1\n"
    data = ply(4, "\n".join((*CORNERS, "-2 0 0", rows)), faces=2)
    data = data.replace("end_header", "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header")
    assert area(data, "ply") == pytest.approx(9.0)
    shapes, (warning,) = content(data, "ply").shapes, content(data, "ply").warnings
    assert [shape.colors for shape in shapes] == [None]
    assert "'face' have 14 values, its header names 7" in warning
