"""STL files as programs write them, beyond what every reader reads."""

import struct

import numpy as np
import pytest

from gateway.files.parsers.mesh_data import MeshFaultError
from gateway.files.parsers.stl import read_stl

CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0)), ((0, 0, 0), (1, 1, 0), (0, 1, 0))
FACETS = "".join(
    "facet normal 0 0 1\n outer loop\n"
    + "".join(f"  vertex {x} {y} {z}\n" for x, y, z in corners)
    + " endloop\nendfacet\n"
    for corners in CORNERS
)


def binary(spare: tuple[int, int] = (0, 0), header: bytes = b"", count: int = 2, end: bytes = b"") -> bytes:
    triangles = (
        struct.pack("<12fH", 0, 0, 1, *np.ravel(corners), color) for corners, color in zip(CORNERS, spare, strict=True)
    )
    return header.ljust(80) + struct.pack("<I", count) + b"".join(triangles) + end


@pytest.mark.parametrize(
    "data",
    [
        binary(header=b"solid as binary files of some programs begin"),
        binary(end=b"what a program keeps behind the triangles"),
        binary(count=0),
        f"solid a\n{FACETS}endsolid a\n".encode(),
        f"\ufeffsolid a\n{FACETS}endsolid a\n".encode(),
        f"# by hand\nsolid a # first\n{FACETS}endsolid a\n".encode(),
        f"\n SOLID\n{FACETS.upper()}ENDSOLID\n".encode(),
        f"solid facet with vertex in its name\n{FACETS}endsolid\n".encode(),
        f"solid a {FACETS} endsolid a".replace("\n", " ").encode(),
        f"solid a\n{FACETS}endsolid a\n".replace("\n", "\r\n").replace(" 1 ", " \t+1.0E+000 ").encode(),
    ],
)
def test_forms_of_stl_files(data: bytes) -> None:
    warnings: list[str] = []
    positions, colors = read_stl(data, 2, warnings)
    assert np.array_equal(positions, np.reshape(CORNERS, (6, 3)))
    assert (colors, warnings) == (None, [])


@pytest.mark.parametrize(
    ("header", "spare", "expected"),
    [
        (b"VisCAM", (0x8000 | 31 << 10, 0), ((255, 0, 0), (255, 255, 255))),
        (b"VisCAM", (0x8000 | 16, 0x8000), ((0, 0, 132), (0, 0, 0))),
        (b"COLOR=\x01\x02\x03\xff,MATERIAL=", (31, 0x8000), ((255, 0, 0), (1, 2, 3))),
        (b"COLOR=\x01\x02\x03\xff", (0, 0xFFFF), ((1, 2, 3), (1, 2, 3))),
        (b"COLOR=\x7f\x7f\x7f\x20 as by MeshLab", (0x8000 | 31, 31 << 10), ((255, 0, 0), (0, 0, 255))),
    ],
)
def test_colours_of_triangles(header: bytes, spare: tuple[int, int], expected: tuple[tuple[int, ...], ...]) -> None:
    _, colors = read_stl(binary(spare, header), 2, [])
    assert colors[::3, :3].tolist() == [list(color) for color in expected]
    assert (colors == colors[[0, 0, 0, 3, 3, 3]]).all()
    assert (colors[:, 3] == 255).all()


def test_a_file_that_ends_early_has_a_warning() -> None:
    warnings: list[str] = []
    assert len(read_stl(binary(count=3), 3, warnings)[0]) == 6
    assert "2 of 3" in warnings[0]


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "no triangles"),
        (b"solid a\nendsolid a\n", "no triangles"),
        (b"\0" * 200, "no triangles"),
        (binary(), "limit is 1"),
        (b"solid vertex 1 1 nil" * 3, "number"),
    ],
)
def test_files_without_triangles_or_beyond_the_limit(data: bytes, reason: str) -> None:
    with pytest.raises(MeshFaultError, match=reason):
        read_stl(data, 1, [])
