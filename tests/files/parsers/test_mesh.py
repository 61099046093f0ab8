"""Hostile mesh files: limits hold before anything unfolds. They are read in this process, whose memory is measured."""

import dataclasses
import struct
import threading
import tracemalloc
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.files.assets.mesh_formats import MESH_LIMITS, PARSER_LIMITS, MeshFormatError, parse_mesh
from gateway.files.parsers.mesh import read_mesh
from gateway.files.parsers.mesh_data import MeshData, MeshOptions
from gateway.scene.tree.geometry import PointCloud, Surface
from renderers.stop import StopFlag
from tests.files.assets.mesh_files.files import DAE
from tests.files.assets.mesh_files.files import ply as ascii_ply

LIMITS = {name: getattr(MESH_LIMITS, name) for name in MeshOptions.__struct_fields__ if name.startswith("max_")}
PLAIN = DAE.format(asset="")
LEAF = '<node id="n0"><instance_geometry url="#g"/></node>'
VTK = b"# vtk DataFile Version 3.0\ntest\nASCII\nDATASET POLYDATA\n"


def no_files(name: str) -> bytes:
    raise FileNotFoundError(name)


def read(data: str | bytes, extension: str = "dae", **limits: int) -> MeshData | str:
    raw = data.encode() if isinstance(data, str) else data
    return read_mesh(no_files, raw, extension, LIMITS | limits)


def fault(data: str | bytes, extension: str = "dae", **limits: int) -> str:
    result = read(data, extension, **limits)
    assert isinstance(result, str)
    return result


def content(data: str | bytes, extension: str = "dae", **limits: int) -> MeshData:
    result = read(data, extension, **limits)
    assert isinstance(result, MeshData), result
    return result


def scene(library: str, nodes: str) -> str:
    """Return a COLLADA document with ``library_nodes``."""
    start, _, rest = PLAIN.partition("<library_visual_scenes>")
    _, _, end = rest.partition("</library_visual_scenes>")
    visual = f'<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>'
    return f"{start}<library_nodes>{library}</library_nodes>{visual}{end}"


def nested(levels: int, copies: int, leaf: str = LEAF) -> str:
    """Return a document whose nodes each have copies of the one below."""
    library = leaf + "".join(
        f'<node id="n{level}">{f"""<instance_node url="#n{level - 1}"/>""" * copies}</node>'
        for level in range(1, levels + 1)
    )
    return scene(library, f'<node><instance_node url="#n{levels}"/></node>')


def test_instances_of_nodes_share_their_shape() -> None:
    result = content(nested(4, 3))
    assert (len(result.shapes), len(result.instances)) == (1, 81)


@pytest.mark.parametrize(
    ("levels", "copies", "reason"),
    [
        (40, 2, r"it has more than 10\^12 parts, the limit is 200000"),
        (18, 2, "it has 262144 parts, the limit is 200000"),
        (200, 100, r"it has more than 10\^400 parts"),
        (300, 1, "it has more than 256 levels of nodes"),
    ],
)
def test_nested_nodes_are_counted_before_they_are_expanded(levels: int, copies: int, reason: str) -> None:
    with pytest.raises(MeshFormatError, match=reason):
        raise MeshFormatError(fault(nested(levels, copies)))


def test_nodes_without_geometry_are_not_expanded() -> None:
    library = nested(40, 2, '<node id="n0"/>').partition("<library_nodes>")[2].partition("</library_nodes>")[0]
    nodes = '<node><instance_node url="#n40"/><instance_geometry url="#g"/></node>'
    assert len(content(scene(library, nodes)).instances) == 1


def test_many_nodes_above_few_parts_are_limited() -> None:
    """2^17 parts below a chain of 200 nodes each."""
    targets = ["n0", *(f"c{i}" for i in range(200)), *(f"f{i}" for i in range(17))]
    library = LEAF + "".join(
        f'<node id="{name}">{f"""<instance_node url="#{target}"/>""" * (2 if name.startswith("f") else 1)}</node>'
        for target, name in pairwise(targets)
    )
    assert "nodes, the limit is 1000000" in fault(scene(library, '<node><instance_node url="#f16"/></node>'))


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (PLAIN.replace("0 1 2</p>", "0 1 4294967295</p>"), "an index of its vertices is not one of 0 to 2"),
        (PLAIN.replace("0 1 2</p>", "0 1 -1</p>"), "an index of its vertices is not one of 0 to 2"),
        (PLAIN.replace("0 1 2</p>", "0 1 3</p>"), "the file holds no triangles or points"),
        (PLAIN.replace("</COLLADA>", "<a>" * 600 + "</a>" * 600 + "</COLLADA>"), "or more than 512 levels"),
        (PLAIN.replace("</COLLADA>", "<a/>" * 1_000_001 + "</COLLADA>"), "more than 1000000 XML elements"),
        ("<!DOCTYPE a [<!ENTITY x 'y'>]>" + PLAIN.partition("?>")[2], "with a DOCTYPE are refused"),
        (PLAIN.replace("<asset>", '<asset><unit meter="0"/>'), "its unit of 0 m is out of range"),
        ("PK\3\4" + PLAIN, "it cannot be read as DAE: not well-formed"),
    ],
)
def test_damaged_collada(data: str, reason: str) -> None:
    assert reason in fault(data)


CORNER_LINES = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


@pytest.mark.parametrize(
    ("faces", "read_count", "warning"),
    [
        (
            "vt 0 0\nf 1 2 3\nf 1/1 2/1 3/1 # all\nf 1 2 9\nf a b c\nf 1 2\nf 1/2 2/1 3/1\nf 1 2 0\nf -1 -2 -3\n",
            4,
            "4 of 8 faces are left out, such as 'f 1 2 9' in line 7",
        ),
        ("f -3 -2 \\\n-1\nf -6 -2 -1\n", 1, "1 of 2 faces are left out, such as 'f -6 -2 -1' in line 6"),
    ],
)
def test_broken_faces_of_obj_files_are_left_out(faces: str, read_count: int, warning: str) -> None:
    read = content(CORNER_LINES + faces, "obj")
    assert sum(len(shape.triangles or b"") for shape in read.shapes) == read_count * 12
    assert read.warnings == [warning]


@pytest.mark.parametrize("data", ["f 1 2 3\n", CORNER_LINES + "f 1 2\n", CORNER_LINES + "usemtl a\nf 1 2 4\n"])
def test_obj_files_without_a_whole_face_are_refused(data: str) -> None:
    assert "1 of 1 faces are left out, such as 'f 1 2" in fault(data, "obj")


def test_broken_faces_of_ply_files_are_left_out() -> None:
    data = ascii_ply(3, "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 1 9\n", faces=2)
    read = content(data.replace("ascii 1.0", "ascii 1.0 "), "ply")
    (shape,) = read.shapes
    assert len(shape.triangles or b"") == 12
    assert read.warnings == ["1 of 2 triangles refer to vertices that do not exist (9 of 3)"]


PLY_POINTS = "element vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1)]


def ply(order: str, faces: list[list[int]], flags: bool) -> bytes:
    """Return a binary PLY file of ``CORNERS``."""
    name = "little" if order == "<" else "big"
    extra = "property uchar flags\n" if flags else ""
    head = f"ply\nformat binary_{name}_endian 1.0\n{PLY_POINTS}element face {len(faces)}\n"
    rows = [struct.pack(f"{order}B{len(face)}i", len(face), *face) + b"\1" * flags for face in faces]
    points = np.array(CORNERS, f"{order}f4").tobytes()
    return f"{head}property list uchar int vertex_indices\n{extra}end_header\n".encode() + points + b"".join(rows)


def area(data: str | bytes, extension: str) -> float:
    """Return the area of all triangles of a file."""
    total = 0.0
    for shape in content(data, extension).shapes:
        corners = np.frombuffer(shape.positions, np.float32).reshape(-1, 3)[
            np.frombuffer(shape.triangles or b"", np.uint32)
        ]
        sides = np.diff(corners.reshape(-1, 3, 3), axis=1)
        total += float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum()) / 2.0
    return total


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("flags", [False, True])
def test_binary_ply_of_faces_with_different_numbers_of_corners(order: str, flags: bool) -> None:
    """A square and a triangle, as in files of Blender. A header of carriage returns is one of Rhinoceros."""
    data = ply(order, [[0, 1, 2, 3], [0, 1, 4]], flags)
    assert area(data, "ply") == pytest.approx(1.5)
    header, end, body = data.partition(b"end_header\n")
    assert area((header + end).replace(b"\n", b"\r") + body, "ply") == pytest.approx(1.5)
    assert area(header + b"end_header\r\n" + body, "ply") == pytest.approx(1.5)
    assert "shorter than its header says" in fault(data[:-2], "ply")


@pytest.mark.parametrize("names", ["", "nx ny nz", "red green blue alpha", "nx ny nz red green blue alpha"])
@pytest.mark.parametrize("values", ["0.5 0.5", "255 0 0 255", "0.5 0.5 255 0 0 255"])
def test_ply_as_assimp_writes_it(names: str, values: str) -> None:
    """Assimp 6.0 declares no colours, and colours in place of texture coordinates. Meshes may differ."""
    properties = "".join(f"property float {name}\n" for name in ("x", "y", "z", *names.split()))
    normal = "0 0 1 " if "n" in names.split("r")[0] else ""
    rows = "".join(f"{corner} {normal}{values}\n" for corner in ("0 0 0", "2 0 0", "0 3 0"))
    if "0.5" in values:
        rows = rows.removesuffix("\n") + " 0\n"
    data = f"ply\nformat ascii 1.0\nelement vertex 3\n{properties}element face 1\n"
    data += f"property list uchar int vertex_index\nend_header\n{rows}3 0 1 2\n"
    assert area(data.encode(), "ply") == pytest.approx(3.0)


def test_an_element_without_rows_before_the_vertices_of_a_ply() -> None:
    data = ascii_ply(3, "0 0 0\n2 0 0\n0 3 0\n3 0 1 2\n", faces=1)
    camera = "element camera 0\nproperty float view_px\n"
    assert content(data.replace("element vertex", f"{camera}element vertex"), "ply").warnings == []


def test_ply_whose_faces_have_three_corners_each_on_average() -> None:
    """The file is as long as one whose faces are all like the first one, which trimesh takes it for."""
    assert area(ply("<", [[0, 1, 2, 3], [0, 1, 4], [0, 1, 2, 3, 0]], False), "ply") == pytest.approx(2.5)


def binary(*header: str, body: bytes) -> bytes:
    """Return a binary PLY file of ``CORNERS`` with more elements."""
    text = "\n".join(("ply", "format binary_little_endian 1.0", PLY_POINTS + header[0], *header[1:], "end_header\n"))
    return text.encode() + np.array(CORNERS, "<f4").tobytes() + body


MIXED = struct.pack("<B4iB3i", 4, 0, 1, 2, 3, 3, 0, 1, 4)
INDICES = "property list uchar int vertex_indices"


@pytest.mark.parametrize("faces", [MIXED, struct.pack("<B3iB3i", 3, 0, 1, 2, 3, 0, 1, 4)])
def test_edges_of_ply_files_are_not_used(faces: bytes) -> None:
    edges, numbers = ("element edge 1", "property int vertex1", "property int vertex2"), struct.pack("<2i", 0, 1)
    expected = area(binary("element face 2", INDICES, body=faces), "ply")
    assert area(binary(*edges, "element face 2", INDICES, body=numbers + faces), "ply") == pytest.approx(expected)
    assert area(binary("element face 2", INDICES, *edges, body=faces + numbers), "ply") == pytest.approx(expected)


def test_edges_of_ply_files_without_faces_are_named() -> None:
    """Open3D writes line sets in this way."""
    edges, numbers = ("element edge 2", "property int vertex1", "property int vertex2"), struct.pack("<4i", 0, 1, 1, 2)
    (warning,) = content(binary(*edges, body=numbers), "ply").warnings
    assert "2 edges" in warning


def test_a_compressed_splat_is_named() -> None:
    """As PlayCanvas writes it."""
    header = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty uint packed_position\nend_header\n1234"
    assert "packed_position" in fault(header, "ply")


def test_a_ply_polygon_of_a_million_corners_is_a_fan() -> None:
    faces = struct.pack("<I", 1_000_000) + b"\0\1\2\3" * 250_000 + struct.pack("<I3B", 3, 0, 1, 4)
    (shape,) = content(binary("element face 2", "property list uint uchar vertex_indices", body=faces), "ply").shapes
    assert len(shape.triangles or b"") == 12 * 999_999


@pytest.mark.parametrize(
    ("header", "body", "reason"),
    [
        (("element face -5", INDICES), MIXED, "line 7 of its header is wrong: 'element face -5'"),
        (("element face 2", "property list uchar vec3 a"), MIXED, "line 8 of its header is wrong: 'property list"),
        (("element face 2", "property list float int a"), MIXED, "line 8 of its header is wrong: 'property list"),
        (
            (f"element face {10**15}", "property list char uchar vertex_indices"),
            b"\xff" * 8,
            "a list of its element 'face' has a length of -1",
        ),
        ((f"element face {10**15}", INDICES), MIXED, "it is shorter than its header says"),
        (("element face 1", "property list uint int vertex_indices"), b"\xff" * 8, "it is shorter than its header"),
        (("element face 1",), b"", "its element 'face' has no list 'vertex_indices' of integers"),
        (
            ("element face 1", "property list uchar int a", "property list uchar int b"),
            bytes(2),
            "its element 'face' has no list 'vertex_indices' of integers",
        ),
        (
            ("element tristrips 1", "property list int float a"),
            bytes(4),
            "its element 'tristrips' has no list 'vertex_indices' of integers",
        ),
        (("element tristrips 1", INDICES), b"\4", "it is shorter than its header says"),
    ],
)
def test_damaged_binary_ply(header: tuple[str, ...], body: bytes, reason: str) -> None:
    assert f"it cannot be read as PLY: {reason}" in fault(binary(*header, body=body), "ply")


@pytest.mark.parametrize(("element", "corners"), [("face", 1), ("face", 2), ("tristrips", 2)])
def test_faces_of_ply_files_without_triangles_leave_points(element: str, corners: int) -> None:
    read = content(binary(f"element {element} 1", INDICES, body=bytes([corners, *bytes(4 * corners)])), "ply")
    assert [len(shape.positions) // 12 for shape in read.shapes] == [len(CORNERS)]
    assert read.shapes[0].triangles is None
    assert len(read.warnings) == 1


def test_other_damaged_ply() -> None:
    strips = "element tristrips 1\nproperty list int float a\nproperty int b\nend_header\n"
    points = "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS)
    data = f"ply\nformat ascii 1.0\n{PLY_POINTS}{strips}{points}3 0 1 2 7\n"
    assert "its element 'tristrips' has no list 'vertex_indices'" in fault(data, "ply")
    assert "it does not start with 'ply'" in fault("plx\n", "ply")


def test_comments_of_ply_files_need_not_be_utf_8() -> None:
    data = ply("<", [[0, 1, 2, 3]], False)
    assert area(
        data.replace(b"element vertex", b"comment M\xfcnchen \xc3\x85\nelement vertex"), "ply"
    ) == pytest.approx(1.0)


def numbered_ply(textures: int, corners: NDArray[np.int32]) -> bytes:
    """Return a PLY file of three vertices whose faces have texture coordinates, and the numbers of textures in turn."""
    names = "".join(f"comment TextureFile {number}.png\n" for number in range(textures))
    lists = "property list uchar int vertex_indices\nproperty list uchar float texcoord\nproperty int texnumber\n"
    header = PLY_HEADER.format(f"binary_little_endian 1.0\n{names}comment", t="float")
    row = [("size", "u1"), ("corners", "<i4", 3), ("uv_size", "u1"), ("uv", "<f4", 6), ("texture", "<i4")]
    faces = np.zeros(len(corners), row)
    faces["size"], faces["corners"], faces["uv_size"] = 3, corners, 6
    faces["texture"] = np.arange(len(corners)) % textures
    points = np.eye(3, dtype=np.float32).tobytes()
    return f"{header}element face {len(faces)}\n{lists}end_header\n".encode() + points + faces.tobytes()


def test_memory_for_a_ply_file_of_many_textures() -> None:
    """A mask of the faces for each texture took 2 GB for 2000 textures and a million faces."""
    data = numbered_ply(2000, np.tile(np.arange(3, dtype=np.int32), (50_000, 1)))
    tracemalloc.start()
    shapes = content(data, "ply").shapes
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert (len(shapes), peak < 50_000_000) == (2000, True)


def test_a_ply_file_of_several_textures_without_a_valid_face() -> None:
    result = read(numbered_ply(2, np.full((4, 3), 9, np.int32)), "ply")
    assert isinstance(result, str)
    assert "9 of 3" in result


def test_texture_coordinates_of_the_corners_of_ply_polygons() -> None:
    lists = f"element face 1\n{INDICES}\nproperty list uchar float texcoord\nend_header\n"
    points = "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS)
    data = f"ply\nformat ascii 1.0\n{PLY_POINTS}{lists}{points}4 0 1 2 3 8 0 0 1 0 1 .5 0 .25\n"
    (shape,) = content(data, "ply").shapes
    corners = np.frombuffer(shape.triangles or b"", np.uint32)
    uv = np.frombuffer(shape.uv or b"", np.float32).reshape(-1, 2)[corners]
    np.testing.assert_array_equal(1.0 - uv[:, 1], [0, 0, 0.5, 0, 0.5, 0.25])


@pytest.mark.parametrize("form", ["ascii", "binary", "two of binary"])
def test_strips_of_ply_files_are_triangles(form: str) -> None:
    corners = [0, 1, 3, 2, -1, 0, 1, 4]
    if form == "ascii":
        strips = "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
        points = "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS)
        data = f"ply\nformat ascii 1.0\n{PLY_POINTS}{strips}{points}8 {' '.join(map(str, corners))}\n".encode()
    elif form == "binary":
        data = binary("element tristrips 1", INDICES, body=struct.pack("<B8i", 8, *corners))
    else:
        data = binary("element tristrips 2", INDICES, body=struct.pack("<B4iB3i", 4, *corners[:4], 3, *corners[5:]))
    (shape,) = content(data, "ply").shapes
    triangles = np.frombuffer(shape.triangles or b"", np.uint32).reshape(-1, 3)
    np.testing.assert_array_equal(triangles, [(0, 1, 3), (2, 3, 1), (0, 1, 4)])


def test_triangles_face_where_their_normals_point() -> None:
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvn 0 0 -1\n"
    (shape,) = content(corners + "f 1//1 2//1 3//1\nf 1//2 2//2 3//2\nf 1//1 3//1 2//1\n", "obj").shapes
    positions = np.frombuffer(shape.positions, np.float32).reshape(-1, 3)
    points = positions[np.frombuffer(shape.triangles or b"", np.uint32)].reshape(-1, 3, 3)
    facing = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    assert facing[:, 2].tolist() == [1, -1, 1]


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize(
    ("first", "second"), [("f -3 -2 -1", "f -3 -2 -1 # the last three"), ("f 1 2 \\\n -1", "f -3 \\\n-2\\\n -1")]
)
def test_negative_indices_of_obj_files_count_from_their_line(first: str, second: str, end: str) -> None:
    data = f"{CORNER_LINES}{first}\nv 0 0 9\nv 2 0 9\nv 0 2 9\n{second}\n".replace("\n", end)
    assert area(data, "obj") == pytest.approx(0.5 + 2.0)


def test_collada_as_exporters_write_it() -> None:
    """A name of Assimp's exporter, rests after the document, and lights and cameras, which are not used anyway."""
    nodes = '<node id="<STL>"><instance_geometry url="#g"/></node><node><instance_light url="#gone"/></node>'
    read = content(scene("", nodes) + "</mesh></COLLADA>")
    assert (len(read.instances), read.warnings) == (1, [])


def test_a_comment_may_hold_the_end_of_a_collada_document() -> None:
    data = PLAIN.replace("<asset>", "<!-- </COLLADA> --><asset>")
    assert len(content(data).instances) == len(content(data + "</COLLADA>").instances) == 1


def test_skinned_meshes_are_drawn_in_their_bind_pose() -> None:
    """Their node's translation does not hold: the vertices are in the coordinates of the skeleton."""
    floats = '<float_array id="{0}a" count="{1}">{2}</float_array><technique_common><accessor source="#{0}a" '
    joints = '<source id="j"><Name_array id="ja" count="1">b</Name_array><technique_common><accessor source="#ja" '
    skin = (
        '<skin source="#g"><bind_shape_matrix>1 0 0 3 0 1 0 0 0 0 1 0 0 0 0 1</bind_shape_matrix>'
        f'{joints}count="1" stride="1"><param name="JOINT" type="name"/></accessor></technique_common></source>'
        f'<source id="b">{floats.format("b", 16, "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1")}count="1" stride="16">'
        '<param name="TRANSFORM" type="float4x4"/></accessor></technique_common></source>'
        f'<source id="w">{floats.format("w", 1, "1")}count="1" stride="1"><param name="WEIGHT" type="float"/>'
        '</accessor></technique_common></source><joints><input semantic="JOINT" source="#j"/>'
        '<input semantic="INV_BIND_MATRIX" source="#b"/></joints><vertex_weights count="3">'
        '<input semantic="JOINT" source="#j" offset="0"/><input semantic="WEIGHT" source="#w" offset="1"/>'
        "<vcount>1 1 1</vcount><v>0 0 0 0 0 0</v></vertex_weights></skin>"
    )
    data = PLAIN.replace('instance_geometry url="#g"', 'instance_controller url="#k"').replace(
        "<library_visual",
        f'<library_controllers><controller id="k">{skin}</controller></library_controllers><library_visual',
        1,
    )
    read = content(data)
    assert read.warnings == ["skinned and morphed meshes are shown in their bind pose"]
    ((_, transform),) = read.instances
    # Y up: +y of the file is +z.
    np.testing.assert_allclose(np.frombuffer(transform).reshape(4, 4)[:3, 3], (3.0, 0.0, 0.0), atol=1e-12)


def test_what_pycollada_leaves_out_is_a_warning() -> None:
    nodes = '<node><instance_geometry url="#g"/></node><node><instance_geometry url="#gone"/></node>'
    assert content(scene("", nodes)).warnings == ["left out: Geometry #gone not found in library"]


@pytest.mark.parametrize("place", ["nan 0 0", "0 inf 0", "1e400 0 0"])
def test_collada_geometry_at_a_place_that_is_not_finite_is_left_out(place: str) -> None:
    geometry = '<instance_geometry url="#g"/>'
    nodes = f"<node>{geometry}</node>" + 2 * f"<node><node><translate>{place}</translate>{geometry}</node></node>"
    read = content(scene("", nodes))
    assert len(read.instances) == 1
    assert read.warnings == ["geometry of nodes with transforms that are not finite is left out"]


def test_collada_is_limited_by_triangles_and_by_drawn_triangles() -> None:
    assert "it has more than 0 triangles" in fault(PLAIN, max_elements=0)
    assert "its parts draw more than 26 triangles" in fault(nested(3, 3), max_drawn_elements=26)
    assert len(content(nested(3, 3), max_drawn_elements=27).instances) == 27


def test_a_polygon_of_a_million_corners_is_a_fan() -> None:
    numbers = 1_000_002
    data = (
        VTK
        + b"POINTS 3 float\n0 0 0 1 0 0 0 1 0\nPOLYGONS 1 %d\n%d " % (numbers + 1, numbers)
        + b"0 1 2 " * (numbers // 3)
    )
    (shape,) = content(data, "vtk").shapes
    assert len(shape.triangles) == 12 * 1_000_000
    assert f"it has {numbers - 2} triangles, the limit is 999999" in fault(data, "vtk", max_elements=999_999)


NOTCHED = ((2, 1), (1, 1), (1, 2), (0, 2), (0, 0), (2, 0))
"""Corners of a polygon with an area of 3. As a fan from the first one it has 4."""
KEYHOLE = ((0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1))
"""A square with a square hole, which an edge joins to it: the area is 12."""
POLYLIST = """<polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/><vcount>{count}</vcount>
<p>{indices}</p></polylist>"""


@pytest.mark.parametrize(("corners", "expected"), [(NOTCHED, 3.0), (KEYHOLE, 12.0)])
@pytest.mark.parametrize("extension", ["obj", "ply", "binary ply", "dae", "vtk"])
def test_concave_polygons_keep_their_area(
    corners: tuple[tuple[int, int], ...], expected: float, extension: str
) -> None:
    count, flat = len(corners), " ".join(f"{x} 0 {-y}" for x, y in corners)
    indices, points = " ".join(map(str, range(count))), struct.pack(f"<{3 * count}f", *map(float, flat.split()))
    vertices = (f"element vertex {count}", "property float x", "property float y", "property float z")
    faces = ("element face 1", "property list uchar uchar vertex_indices")
    ply = "\n".join(("ply", "format {}", *vertices, *faces, "end_header", ""))
    face = bytes((count, *range(count)))
    data: dict[str, str | bytes] = {
        "obj": "".join(f"v {x} 0 {-y}\n" for x, y in corners)
        + "vn 0 1 0\nf "
        + " ".join(f"{number + 1}//1" for number in range(count)),
        "ply": ply.format("ascii 1.0") + "".join(f"{x} 0 {-y}\n" for x, y in corners) + f"{count} {indices}\n",
        "binary ply": ply.format("binary_little_endian 1.0").encode() + points + face,
        "dae": PLAIN.replace("0 0 0 1 0 0 0 2 0", flat)
        .replace('count="9"', f'count="{3 * count}"')
        .replace('count="3"', f'count="{count}"')
        .replace(
            PLAIN[PLAIN.index("<triangles") : PLAIN.index("</mesh>")], POLYLIST.format(count=count, indices=indices)
        ),
        "vtk": VTK.decode() + f"POINTS {count} float\n{flat}\nPOLYGONS 1 {count + 1}\n{count} {indices}\n",
    }
    (shape,) = content(data[extension], extension.split()[-1]).shapes
    assert len(shape.triangles or b"") == 12 * (count - 2)
    assert area(data[extension], extension.split()[-1]) == pytest.approx(expected)


def test_polygons_that_cross_themselves_are_drawn() -> None:
    star = "v 0 3 0\nv 2 -3 0\nv -3 1 0\nv 3 1 0\nv -2 -3 0\nv 0 -9 0\nf 1 2 3 4 5 6\n"
    (shape,) = content(star, "obj").shapes
    assert len(shape.triangles or b"") == 12 * 4


@pytest.mark.parametrize(
    "data",
    [VTK + b" " * 20_000_000, VTK + b"x" * 20_000_000, VTK + b"POINTS 1 float 0 0 0\n" * 100_000],
    ids=["spaces", "word", "arrays"],
)
def test_vtk_is_read_in_linear_time(data: bytes) -> None:
    assert fault(data, "vtk") == "it has no points or no cells"


@pytest.mark.parametrize("blanks", ["\t", "\n\t ", "\n  "])
def test_tabs_and_indentation_of_obj_files(blanks: str) -> None:
    separator = blanks.strip("\n ") or " "
    lines = "v 0 0 0", "v 1 0 0", "v 0 1 0", "f 1 2 3"
    (shape,) = content("\ufeff" + "".join(blanks + line.replace(" ", separator) + "\n" for line in lines), "obj").shapes
    assert shape.triangles is not None


@pytest.mark.parametrize("full", [1, 255])
def test_obj_vertices_without_colours_beside_some_with(full: int) -> None:
    """As three.js writes objects of which only some have colours of vertices."""
    data = "# two\no a\nv 0 0 0\nv 1 0 0 \nv 0 1 0\nf 1 2 3\no b\n"
    data += f"v 0 0 0 {full} 0 0\nv 1 0 0 {full} 0 0\nv 0 1 0 {full} 0 0\nf 4 5 6\n"
    (shape,) = content(data, "obj").shapes
    assert np.unique(np.frombuffer(shape.colors or b"", np.uint8).reshape(-1, 4), axis=0).tolist() == [
        [255, 0, 0, 255],
        [255, 255, 255, 255],
    ]


@pytest.mark.parametrize(
    ("dimensions", "expected"), [((3, 2, 1), 2.0), ((1, 3, 2), 2.0), ((2, 1, 3), 2.0), ((3, 2, 2), 10.0)]
)
def test_structured_grids_of_vtk_files(dimensions: tuple[int, int, int], expected: float) -> None:
    nx, ny, nz = dimensions
    points = "".join(f"{x} {y} {z}\n" for z in range(nz) for y in range(ny) for x in range(nx))
    head = VTK.replace(b"POLYDATA", b"STRUCTURED_GRID") + b"DIMENSIONS %d %d %d\nPOINTS %d float\n" % (
        *dimensions,
        nx * ny * nz,
    )
    assert area(head + points.encode(), "vtk") == pytest.approx(expected)
    wrong = head.replace(b"DIMENSIONS %d" % nx, b"DIMENSIONS 7")
    assert "grid" in fault(wrong + points.encode(), "vtk")


def test_data_sets_of_vtk_files_that_are_not_read_are_named() -> None:
    assert "FIELD" in fault(VTK.replace(b"POLYDATA", b"FIELD"), "vtk")


@pytest.mark.parametrize(
    ("extension", "data"),
    [
        ("obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3" + b" " * 20_000_000),
        ("dae", PLAIN.encode().replace(b"0 1 2</p>", b" " * 20_000_000 + b"0 1 2</p>")),
    ],
)
def test_spaces_are_skipped(extension: str, data: bytes) -> None:
    assert len(content(data, extension).instances) == 1


def test_the_limits_grow_with_the_file() -> None:
    small, large, huge = (PARSER_LIMITS.for_size(size) for size in (0, 30 << 20, 256 << 20))
    assert small.memory_bytes == 256 << 20
    assert small.seconds == 15
    assert large.memory_bytes == (256 << 20) + 40 * (30 << 20)
    assert huge.memory_bytes == 4 << 30


def parse(data: str | bytes, extension: str = "dae", **limits: Any) -> int:
    raw = data.encode() if isinstance(data, str) else data
    return len(parse_mesh(raw, extension, no_files, dataclasses.replace(MESH_LIMITS, **limits), []))


def test_the_child_process_says_what_it_exceeds() -> None:
    with pytest.raises(MeshFormatError, match=r"10\^12 parts.* 200000"):
        parse(nested(40, 2))
    polygons = '<polylist count="1">' + PLAIN.partition('<triangles count="1">')[2].partition("<p>")[0]
    data = PLAIN.replace(PLAIN[PLAIN.index("<triangles") : PLAIN.index("</triangles>") + 12],
                         f"{polygons}<vcount>2000000000</vcount><p>0 1 2</p></polylist>")  # fmt: skip
    with pytest.raises(MeshFormatError, match=r"DAE: it failed, or needs more than 2684.* bytes of memory"):
        parse(data)


def test_the_stop_flag_ends_a_file_that_takes_long() -> None:
    """References to nodes that follow are resolved again and again, by pycollada."""
    library = "".join(f'<node id="n{i}"><instance_node url="#n{i - 1}"/></node>' for i in range(20_000, 0, -1)) + LEAF
    document = scene(library, '<node><instance_node url="#n20000"/></node>')
    flag = StopFlag()
    threading.Timer(0.2, flag.set, (TimeoutError("late"),)).start()
    with pytest.raises(TimeoutError, match="late"):
        flag.run(lambda: parse(document))


def test_results_are_plain_values() -> None:
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(read(PLAIN)), type=MeshData) == read(PLAIN)


SURVEYED = np.array(
    [(512345.678, 5412345.678, 312.5), (512347.678, 5412345.678, 312.5), (512345.678, 5412346.178, 312.5)]
)
"""A triangle of 2 m x 0.5 m in UTM coordinates, whose steps in float32 are 0.5 m."""
ROWS = "\n".join("{:.3f} {:.3f} {:.3f}".format(*row) for row in SURVEYED)
PLY_HEADER = "ply\nformat {} 1.0\nelement vertex 3\nproperty {t} x\nproperty {t} y\nproperty {t} z\n"
FACE = "element face 1\nproperty list uchar int vertex_indices\n"


@pytest.mark.parametrize(
    ("extension", "data"),
    [
        ("obj", "v " + ROWS.replace("\n", "\nv ") + "\nf 1 2 3\n"),
        ("obj", "v " + ROWS.replace("\n", "\nv ") + "\n"),
        ("ply", PLY_HEADER.format("ascii", t="float") + FACE + f"end_header\n{ROWS}\n3 0 1 2\n"),
        ("ply", PLY_HEADER.format("ascii", t="double") + f"end_header\n{ROWS}\n"),
        (
            "ply",
            (PLY_HEADER.format("binary_big_endian", t="double") + FACE + "end_header\n").encode()
            + SURVEYED.astype(">f8").tobytes()
            + struct.pack(">B3i", 3, 0, 1, 2),
        ),
        ("stl", "solid a facet normal 0 0 1 outer loop vertex " + ROWS.replace("\n", " vertex ") + " endloop endsolid"),
        ("dae", PLAIN.replace("0 0 0 1 0 0 0 2 0", ROWS).replace("<translate>0 0 5</translate>", "")),
        (
            "vtk",
            f"# vtk DataFile Version 3.0\na\nASCII\nDATASET POLYDATA\nPOINTS 3 double\n{ROWS}\nPOLYGONS 1 4\n3 0 1 2\n",
        ),
    ],
)
def test_surveyed_coordinates_are_exact(extension: str, data: str | bytes) -> None:
    raw = data if isinstance(data, bytes) else data.encode()
    (part,) = parse_mesh(raw, extension, no_files, MESH_LIMITS, [], collada_up_axis=False)
    assert isinstance(part.shape, Surface | PointCloud)
    points = (
        part.shape.points
        if isinstance(part.shape, PointCloud)
        else part.shape.mesh.positions[part.shape.mesh.elements[0]]
    )
    np.testing.assert_allclose(points + part.X_node_part[:3, 3], SURVEYED, rtol=0, atol=1e-6)


@pytest.mark.parametrize("order", ["utf-16-le", "utf-16-be"])
@pytest.mark.parametrize(
    ("extension", "data"),
    [
        ("obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        ("ply", ascii_ply(3, "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", faces=1)),
        ("stl", "solid a facet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 endloop endsolid"),
        ("vtk", f"{VTK.decode()}POINTS 3 float\n0 0 0 1 0 0 0 1 0\nPOLYGONS 1 4\n3 0 1 2\n"),
        ("dae", PLAIN.replace("0 0 0 1 0 0 0 2 0", "0 0 0 1 0 0 0 1 0")),
    ],
)
def test_text_may_be_utf_16(extension: str, data: str, order: str) -> None:
    """As the shell of Windows writes what a program prints into a file."""
    assert area(f"\ufeff{data}".encode(order), extension) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("statements", "count"),
    [("l 1 2 3\n", 1), ("curv 0 1 1 2\n", 1), ("surf 0 1 0 1 1 2 3\n", 1), ("f 1 2 3\nl 1 2\n", 0)],
)
def test_lines_and_surfaces_of_obj_files_are_a_warning(statements: str, count: int) -> None:
    """Those beside faces are mostly edges that are drawn."""
    assert len(content(f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{statements}", "obj").warnings) == count
