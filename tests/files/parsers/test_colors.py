"""Colours of vertices, points and faces in PLY and OBJ files, in the forms that programs and devices write."""

import struct
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.files.parsers.mesh import read_mesh
from gateway.files.parsers.mesh_data import MeshData
from tests.files.assets.mesh_files.files import png
from tests.files.parsers.test_mesh import LIMITS, content

COLORS = np.array([(220, 40, 0), (0, 200, 40), (40, 0, 255), (0, 0, 0), (255, 255, 255)], np.uint8)
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1)]
FACES = [(0, 1, 2, 3), (0, 1, 4), (1, 2, 4)]
KINDS: dict[str, tuple[str, Any]] = {
    "uchar": ("B", COLORS),
    "int": ("i", COLORS),
    "ushort": ("H", 257 * COLORS.astype(int)),
    "float": ("f", COLORS / 255),
    "double": ("d", COLORS.astype(float)),
}
"""Type of a property: its code in ``struct``, and the values of ``COLORS`` (``double``: from 0 to 255)."""
NAMES = [
    ("red", "green", "blue"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
    ("r", "g", "b"),
    ("R", "G", "B"),
    ("diffuse_r", "diffuse_g", "diffuse_b"),
]
ENCODINGS = {"ascii": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}


def ply(
    order: str, names: tuple[str, ...], kind: str, colored: str, faces: list[tuple[int, ...]], before: str = "s t"
) -> bytes:
    """Return a PLY file.

    Args:
        order: a key of ``ENCODINGS``.
        names: properties of colours of the type ``kind``.
        colored: element that has colours.
        before: float properties of vertices before the colours.
    """
    code, values = KINDS[kind]
    extra, columns = before.split(), [f"property {kind} {name}" for name in names]
    rows: list[list[tuple[str, Any]]] = []

    def add(row: list[tuple[str, Any]], element: str, number: int) -> None:
        rows.append(row + [(code, value) for value in values[number].tolist() if colored == element])

    for number, corner in enumerate(CORNERS):
        add([("f", value) for value in (*corner, *[0.25] * len(extra))], "vertex", number)
    for number, face in enumerate(faces):
        add([("B", len(face)), *(("i", index) for index in face)], "face", number)
    header = [
        "ply",
        f"format {ENCODINGS[order]} 1.0",
        f"element vertex {len(CORNERS)}",
        *(f"property float {name}" for name in ("x", "y", "z", *extra)),
        *(columns if colored == "vertex" else []),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        *(columns if colored == "face" else []),
        "end_header\n",
    ]
    if order == "ascii":
        body = "".join(" ".join(f"{value:.9g}" for _, value in row) + "\n" for row in rows).encode()
    else:
        body = b"".join(struct.pack(order + "".join(c for c, _ in row), *(v for _, v in row)) for row in rows)
    return "\n".join(header).encode() + body


def colors_of(data: bytes | str, extension: str = "ply") -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return the colours of triangles' corners, (M, 3, 4), and their positions; of a cloud (N, 4) and (N, 3)."""
    (shape,) = content(data, extension).shapes
    assert shape.colors is not None
    colors = np.frombuffer(shape.colors, np.uint8).reshape(-1, 4)
    positions = np.frombuffer(shape.positions, np.float32).reshape(-1, 3)
    if shape.triangles is None:
        return colors, positions
    triangles = np.frombuffer(shape.triangles, np.uint32).reshape(-1, 3)
    return colors[triangles], positions[triangles]


def check_vertices(colors: NDArray[np.uint8], positions: NDArray[np.float32]) -> None:
    for color, (x, y, z) in zip(colors.reshape(-1, 4), positions.reshape(-1, 3).astype(int).tolist(), strict=True):
        assert color.tolist() == [*COLORS[CORNERS.index((x, y, z))].tolist(), 255]


@pytest.mark.parametrize("order", ENCODINGS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("names", NAMES)
def test_colors_of_ply_vertices(order: str, kind: str, names: tuple[str, ...]) -> None:
    for faces in ([], FACES[1:], FACES[:1], FACES):
        for before in ("", "scan_size", "s t", "u v", "texture_u texture_v"):
            check_vertices(*colors_of(ply(order, names, kind, "vertex", faces, before)))


@pytest.mark.parametrize("order", ENCODINGS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("names", NAMES)
def test_each_face_of_a_ply_has_its_own_color(order: str, kind: str, names: tuple[str, ...]) -> None:
    for faces in (FACES[1:], FACES):
        colors, positions = colors_of(ply(order, names, kind, "face", faces))
        expected = np.repeat(COLORS[: len(faces)], [len(face) - 2 for face in faces], axis=0)
        np.testing.assert_array_equal(colors[:, :, :3], np.repeat(expected[:, None], 3, axis=1))
        fans = [(face[0], face[k], face[k + 1]) for face in faces for k in range(1, len(face) - 1)]
        np.testing.assert_array_equal(positions, np.array(CORNERS, np.float32)[np.array(fans)])


@pytest.mark.parametrize("colored", ["vertex", "face"])
def test_mitsuba_writes_linear_colors(colored: str) -> None:
    colors, _ = colors_of(ply("<", ("color_0", "color_1", "color_2"), "float", colored, [FACES[0]]))
    linear = COLORS / 255
    srgb = np.where(linear > 0.0031308, 1.055 * linear ** (1 / 2.4) - 0.055, 12.92 * linear)
    corners = [[0, 1, 2], [0, 2, 3]] if colored == "vertex" else [[0, 0, 0]] * 2
    np.testing.assert_array_equal(colors[:, :, :3], np.rint(255 * srgb[corners]))


@pytest.mark.parametrize(("opacities", "expected"), [((0, 0, 0), [255] * 3), ((0, 9, 0), [0, 9, 0])])
def test_colors_that_are_all_invisible_are_drawn_opaque(opacities: tuple[int, ...], expected: list[int]) -> None:
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    for name in ("red", "green", "blue", "alpha"):
        header += f"property uchar {name}\n"
    points = "".join(f"{x} {y} {z} 1 2 3 {a}\n" for (x, y, z), a in zip(CORNERS, opacities, strict=False))
    colors, _ = colors_of(
        f"{header}element face 1\nproperty list uchar int vertex_index\nend_header\n{points}3 0 1 2\n"
    )
    assert colors.tolist() == [[[1, 2, 3, alpha] for alpha in expected]]


@pytest.mark.parametrize("order", ENCODINGS)
@pytest.mark.parametrize("spelling", ["vertex_indices", "indices"])
def test_lists_before_colored_vertices(order: str, spelling: str) -> None:
    header = (
        f"ply\nformat {ENCODINGS[order]} 1.0\nelement face 2\nproperty list uchar int {spelling}\n"
        "element camera 2\nproperty list uchar short m\nelement vertex 5\nproperty float X\nproperty float Y\n"
        "property float Z\nproperty list uchar uchar near\nproperty  uchar\tRed\nproperty uchar Green\n"
        "property uchar Blue\nend_header\n"
    )
    rows: list[tuple[str, tuple[float, ...]]] = [
        ("B4i", (4, *FACES[0])),
        ("B3i", (3, *FACES[1])),
        ("B2h", (2, 7, 8)),
        ("Bh", (1, 9)),
    ]
    for number, corner in enumerate(CORNERS):
        rows.append((f"3f{2 + number}B3B", (*corner, 1 + number, *[9] * (1 + number), *COLORS[number].tolist())))
    text = "".join(" ".join(map(str, values)) + "\n" for _, values in rows).encode()
    body = text if order == "ascii" else b"".join(struct.pack(order + code, *values) for code, values in rows)
    colors, positions = colors_of(header.encode() + body)
    check_vertices(colors, positions)
    assert len(positions) == 3


def test_faces_of_missing_vertices_are_left_out_with_their_color() -> None:
    (shape,) = content(ply("<", NAMES[0], "uchar", "face", [(0, 1, 9), (1, 2, 4)]), "ply").shapes
    assert np.frombuffer(shape.colors or b"", np.uint8).reshape(-1, 4)[:, :3].tolist() == [COLORS[1].tolist()] * 3


def test_opacity_of_ply_vertices() -> None:
    data = ply("<", (*NAMES[1], "alpha"), "uchar", "vertex", [])
    header, end, body = data.partition(b"end_header\n")
    rows = np.frombuffer(body, "5f, 3u1").tolist()
    body = b"".join(struct.pack("<5f4B", *place, *color, 7) for place, color in rows)
    assert {int(color[3]) for color in colors_of(header + end + body)[0]} == {7}


@pytest.mark.parametrize(("texture", "is_colored"), [(None, True), (b"no image", True), (png((1, 2, 3)), False)])
def test_only_a_texture_replaces_colors(texture: bytes | None, is_colored: bool) -> None:
    def read_file(name: str) -> bytes:
        if texture is None:
            raise FileNotFoundError(name)
        return texture

    data = ply("<", NAMES[0], "uchar", "vertex", FACES).replace(b" 1.0\n", b" 1.0\ncomment TextureFile t.png\n", 1)
    result = read_mesh(read_file, data, "ply", LIMITS)
    assert isinstance(result, MeshData)
    (shape,) = result.shapes
    assert (shape.colors is not None, shape.image is None) == (is_colored, is_colored)


def test_centres_of_a_splat_have_its_colors_and_a_hint() -> None:
    properties = "".join(f"property float {name}\n" for name in ("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2"))
    data = f"ply\nformat ascii 1.0\nelement vertex 1\n{properties}end_header\n0 0 0 0 {0.5 / 0.28209479} -9\n"
    result = content(data.encode(), "ply")
    (shape,), warnings = result.shapes, result.warnings
    assert list(shape.colors or b"") == [128, 255, 0, 255]
    assert len(warnings) == 1
    assert "splat" in warnings[0]


def test_colors_that_zbrush_paints() -> None:
    """Two comments of a mask, red, green and blue for each vertex; one more than there are, and one that is damaged."""
    paint = "#MRGB ffff000000008000\n#MRGB xyz\n#MRGB ff0000ff12345678\n"
    (shape,) = content(f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{paint}f 1 2 3\n", "obj").shapes
    colors = np.frombuffer(shape.colors or b"", np.uint8).reshape(-1, 4)
    assert colors[:, :3].tolist() == [[255, 0, 0], [0, 128, 0], [0, 0, 255]]


@pytest.mark.parametrize("full", [1.0, 255.0, 65535.0])
@pytest.mark.parametrize("library", ["", "mtllib missing.mtl\n"])
@pytest.mark.parametrize("faces", ["", "f 1 2 3\nf 1 3 4\nf 1 2 5\n", "f 1/1 2/2 3/3\nf 1/3 3/2 4/1\nf 1/1 2/2 5/3\n"])
def test_colors_of_obj_vertices(full: float, library: str, faces: str) -> None:
    rows = zip(CORNERS, (COLORS / 255.0 * full).tolist(), strict=True)
    text = library + "".join(f"v {' '.join(map(str, p))} {' '.join(f'{c:.6g}' for c in color)}\n" for p, color in rows)
    check_vertices(*colors_of(f"{text}vt 0 0\nvt 1 0\nvt 1 1\n{faces}", "obj"))


def read_obj(text: str, files: dict[str, str]) -> MeshData:
    result = read_mesh(lambda name: files[name].encode(), text.encode(), "obj", LIMITS)
    assert isinstance(result, MeshData)
    return result


@pytest.mark.parametrize(("statement", "shade"), [("Kd 0.5 0.5 0.5", 128 / 255), ("illum 1", 1.0)])
def test_the_material_of_an_obj_file_multiplies_its_colors(statement: str, shade: float) -> None:
    """Without Kd it is white, as in VTK and three.js; Assimp writes it beside colours of vertices."""
    text = "mtllib m.mtl\nusemtl m\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 2 3\n"
    (shape,) = read_obj(text, {"m.mtl": f"newmtl m\n{statement}\n"}).shapes
    assert shape.color == pytest.approx((shade, shade, shade, 1), abs=1 / 255)
    assert np.frombuffer(shape.colors or b"", np.uint8).reshape(-1, 4)[:, :3].tolist() == (255 * np.eye(3)).tolist()


def test_a_colour_of_an_obj_file_in_both_vertices_and_material_is_drawn_once() -> None:
    """The robots of gb-robot-models have both, for Rerun and for RViz."""
    rgb = "0.333333333 0.117647059 0.1"
    text = f"mtllib m.mtl\nusemtl m\nv 0 0 0 {rgb}\nv 1 0 0 {rgb}\nv 0 1 0 {rgb}\nf 1 2 3\n"
    (shape,) = read_obj(text, {"m.mtl": f"newmtl m\nKd {rgb}\n"}).shapes
    assert shape.color == pytest.approx((1 / 3, 2 / 17, 0.1, 1))
    assert shape.colors is None


@pytest.mark.parametrize(
    ("libraries", "kd"),
    [
        ("mtllib other.mtl\nmtllib m.mtl\n", "Kd 1 0.2 0"),
        ("mtllib other.mtl m.mtl\n", "Kd 1 0.2 0 # orange"),
        ("mtllib my m.mtl\n", "Kd\t1 0.2 0"),
    ],
)
def test_materials_of_several_mtl_files(libraries: str, kd: str) -> None:
    files = {"other.mtl": "newmtl  light  gray\nKd 0.4\n", "m.mtl": f"newmtl m # first\r\n{kd}\r\n"}
    files["my m.mtl"] = files["other.mtl"] + files["m.mtl"]
    text = f"{libraries}v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl m\nf 1 2 3\nusemtl light gray\nf 1 2 4\n"
    result = read_obj(text, files)
    colors = sorted(shape.color for shape in result.shapes if shape.color)
    assert colors == [pytest.approx((0.4, 0.4, 0.4, 1)), pytest.approx((1, 0.2, 0, 1))]
    assert result.warnings == []
