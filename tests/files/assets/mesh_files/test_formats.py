"""Shapes, materials, textures, units and axes of all formats."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from gateway.files.assets.mesh_files import MeshFileError, MeshFileLimits, MeshFiles
from gateway.files.gltf import GltfLimits
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.geometry import Part, PointCloud
from gateway.scene.tree.nodes import Node
from renderers import primitives
from renderers.drawlist import AlphaMode
from tests.files.assets.mesh_files.files import (
    CUBE,
    CUBE_MTL,
    DAE,
    RGB,
    TRIANGLE,
    gltf,
    load_one,
    load_painted,
    mesh_of,
    ply,
    png,
    stl,
    write,
)
from tests.support.bounds import scene_bounds


def bounds(parts: tuple[Part, ...]) -> np.ndarray:
    return scene_bounds(flatten(Node(parts)))


@pytest.fixture
def white(root: Path) -> None:
    write(root / "p.png", png((255, 255, 255)))


def test_obj_with_materials_and_texture(root: Path, files: MeshFiles) -> None:
    write(root / "cube.obj", CUBE)
    write(root / "cube.mtl", CUBE_MTL)
    write(root / "textures" / "paint.png", png((255, 0, 0), (0, 0, 255)))
    parts = files.load("cube.obj")
    np.testing.assert_array_equal(bounds(parts), [(-1, -1, -1), (1, 1, 1)])
    by_alpha = {part.material.alpha_mode: part for part in parts}
    painted, glass = by_alpha[AlphaMode.OPAQUE], by_alpha[AlphaMode.BLEND]
    assert painted.material.base_color == pytest.approx((0.0103, 0.0103, 0.0103, 1), abs=1e-3)
    pixels = painted.material.base_color_texture.image.decode()
    np.testing.assert_array_equal(pixels, [[(255, 0, 0, 255), (0, 0, 255, 255)]])
    assert glass.material.base_color == pytest.approx((1, 0, 0.2159, 0.25), abs=2e-3)
    assert glass.material.double_sided
    assert {part.kind for part in parts} == {"mesh_file"}
    assert {part.source for part in parts} == {"cube.obj"}
    mesh = mesh_of(painted)
    corner = np.flatnonzero((mesh.positions == (-1, -1, 1)).all(axis=1))
    np.testing.assert_array_equal(mesh.uv0[corner[0]], (0, 1))


def test_meshes_without_normals_are_smooth_but_not_across_creases(root: Path, files: MeshFiles) -> None:
    write(root / "ball.stl", stl(primitives.sphere()))
    ball = mesh_of(files.load("ball.stl")[0])
    assert ball.normals is not None
    assert len(ball.positions) == len(primitives.sphere().positions)
    assert np.einsum("ni,ni->n", ball.normals, ball.positions).min() > 0.999
    write(root / "box.stl", stl(primitives.box()))
    box = mesh_of(files.load("box.stl")[0])
    assert box.normals is not None
    assert len(box.positions) == 24
    np.testing.assert_allclose(np.sort(np.abs(box.normals), axis=1), np.tile((0, 0, 1), (24, 1)), atol=1e-6)


@pytest.mark.parametrize("content", [b"no picture", png((1, 2, 3))[:33], b""])
def test_textures_that_cannot_be_decoded_are_left_out(root: Path, files: MeshFiles, content: bytes) -> None:
    write(root / "cube.obj", CUBE)
    write(root / "cube.mtl", CUBE_MTL)
    write(root / "textures" / "paint.png", content)
    warnings: list[str] = []
    parts = files.load("cube.obj", warnings=warnings)
    assert len(parts) == 2
    assert [part.material.base_color_texture for part in parts] == [None, None]
    (warning,) = warnings
    assert warning.startswith("'cube.obj': 'textures/paint.png' is left out: ")


def test_a_texture_of_16_bits_in_a_tiff_file(root: Path, files: MeshFiles) -> None:
    Image.fromarray(np.full((1, 2), 100 * 257, np.uint16)).save(root / "p.tiff")
    part, _ = load_painted(files, root, "map_Kd p.tiff")
    assert part.material.base_color_texture.image.decode()[0, 0, 0] == 100


@pytest.mark.parametrize("format_", ["BMP", "DDS", "GIF", "TGA", "TIFF"])
@pytest.mark.parametrize("option", ["", "-clamp on ", "-s 1 1 1 -bm 0.5 "])
def test_textures_of_older_formats(root: Path, files: MeshFiles, format_: str, option: str) -> None:
    Image.new("RGB", (2, 1), (200, 100, 50)).save(root / f"paint.{format_.lower()}", format_)
    part, warnings = load_painted(files, root, f"map_Kd {option}paint.{format_.lower()}")
    assert not warnings
    assert part.material.base_color_texture.image.decode()[0, 0].tolist() == [200, 100, 50, 255]


def test_undefined_materials_of_obj_files(root: Path, files: MeshFiles) -> None:
    write(root / "t.mtl", "newmtl m\nKd 0 1 0\n")
    write(root / "t.obj", "mtllib t.mtl\n" + TRIANGLE.replace("f ", "usemtl other\nf "))
    _, warnings = load_one(files, "t.obj")
    assert warnings == ["'t.obj': materials of usemtl that no MTL file defines (1): 'other'; they are white"]


def test_textures_beyond_the_total_of_pixels_are_left_out(root: Path) -> None:
    head, _ = CUBE.split("usemtl glass")
    write(root / "two.obj", head + "usemtl second\nf 1/1 2/2 6/3 5/4\n")
    write(root / "cube.mtl", CUBE_MTL.replace("glass", "second") + "map_Kd second.png\n")
    write(root / "textures" / "paint.png", png((1, 2, 3), (4, 5, 6)))
    write(root / "second.png", png((7, 8, 9), (4, 5, 6)))
    for most, textured in ((4, 2), (3, 1), (1, 0)):
        files = MeshFiles([root], MeshFileLimits(gltf=GltfLimits(max_total_image_pixels=most)))
        assert sum(part.material.base_color_texture is not None for part in files.load("two.obj")) == textured


def test_normals_of_the_file_are_kept(root: Path, files: MeshFiles) -> None:
    write(root / "n.obj", "v 0 0 0\nv 1 0 0\nv 0 2 0\nvn 0 0.6 0.8\nf 1//1 2//1 3//1\n")
    mesh = mesh_of(files.load("n.obj")[0])
    np.testing.assert_allclose(mesh.normals, np.tile((0, 0.6, 0.8), (3, 1)), atol=1e-6)


def test_ply_with_vertex_colours_and_ply_of_points(root: Path, files: MeshFiles) -> None:
    rows = "0 0 0 255 0 0\n1 0 0 0 255 0\n0 1 0 0 0 188\n"
    write(root / "c.ply", ply(3, rows + "3 0 1 2\n", *RGB, faces=1))
    mesh = mesh_of(files.load("c.ply")[0])
    # the file has colours as displays show them, a mesh has linear light, which 188 is half of
    light = [(1, 0, 0, 1), (0, 1, 0, 1), (0, 0, 0.5029, 1)]
    np.testing.assert_allclose(mesh.colors[np.argsort(mesh.positions @ (1, 2, 0))], light, atol=1e-4)
    write(root / "p.ply", ply(3, rows, *RGB))
    (part,) = files.load("p.ply")
    assert isinstance(part.shape, PointCloud)
    np.testing.assert_array_equal(part.shape.points, [(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    np.testing.assert_array_equal(part.shape.channels["rgb"][:, :3], np.diag(np.array([1, 1, 188 / 255], np.float32)))


@pytest.mark.parametrize(
    ("asset", "expected"),
    [
        ('<unit name="cm" meter="0.01"/><up_axis>Z_UP</up_axis>', [(0, 0, 0.05), (0.01, 0.02, 0.05)]),
        ('<unit meter="inch"/><up_axis>Z_UP</up_axis>', [(0, 0, 5), (1, 2, 5)]),  # no number
        ("<up_axis>Y_UP</up_axis>", [(0, -5, 0), (1, -5, 2)]),
        ("", [(0, -5, 0), (1, -5, 2)]),
        ("<up_axis>X_UP</up_axis>", [(-2, -5, 0), (0, -5, 1)]),
    ],
)
def test_collada_unit_and_up_axis(root: Path, files: MeshFiles, asset: str, expected: Any) -> None:
    write(root / "part.dae", DAE.format(asset=asset))
    np.testing.assert_allclose(bounds(files.load("part.dae")), expected, atol=1e-6)


@pytest.mark.parametrize(
    ("generator", "expected"),
    [("", [(0, 0, 0), (1, 0, 2)]), ("VTK", [(0, 0, 0), (1, 0, 2)]), ("Drake glTF merger", [(0, 0, 0), (1, 2, 0)])],
)
def test_gltf_is_y_up_unless_drake_merged_it(root: Path, files: MeshFiles, generator: str, expected: Any) -> None:
    write(root / "t.gltf", gltf(generator))
    write(root / "data.bin", np.array([(0, 0, 0), (1, 0, 0), (0, 2, 0)], np.float32).tobytes())
    np.testing.assert_allclose(bounds(files.load("t.gltf")), expected, atol=1e-6)


def test_lights_of_a_mesh_are_parts_in_its_frame(root: Path, files: MeshFiles) -> None:
    document = json.loads(gltf("made by hand"))
    document["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "spot", "range": 5}]}}
    document["nodes"][0] |= {"translation": [1, 2, 3], "extensions": {"KHR_lights_punctual": {"light": 0}}}
    write(root / "lamp.gltf", json.dumps(document))
    write(root / "data.bin", np.eye(3, dtype=np.float32).tobytes())
    warnings: list[str] = []
    parts = files.load("lamp.gltf", (2, 2, 2), warnings)
    assert warnings == []
    (light,) = flatten(Node(parts)).lights
    assert (light.position, light.direction, light.range) == ((2, -6, 4), (0, 1, 0), 5)


@pytest.mark.parametrize("scale", [(2, -3, 4), (1, 1, 1), (2, 1, 1), (1, 3, 1), (1, 1, 0.5), (-1, 1, 1)])
def test_scale_is_applied_along_the_files_axes(root: Path, files: MeshFiles, scale: tuple[float, float, float]) -> None:
    write(root / "t.obj", TRIANGLE)
    (part,) = files.load("t.obj", scale)
    np.testing.assert_array_equal(part.X_node_part, np.diag((*scale, 1)))


@pytest.mark.parametrize(("metres", "allowed"), [("1e-9", False), ("1.1e-9", True), ("9e8", True), ("1e9", False)])
def test_units_of_collada_are_limited(root: Path, files: MeshFiles, metres: str, allowed: bool) -> None:
    write(root / "part.dae", DAE.format(asset=f'<unit meter="{metres}"/><up_axis>Z_UP</up_axis>'))
    if allowed:
        (part,) = files.load("part.dae")
        assert part.X_node_part[:3, 3].tolist() == [0, 0, pytest.approx(5 * float(metres))]
    else:
        with pytest.raises(MeshFileError, match=r"its unit of .* m is out of range"):
            files.load("part.dae")


@pytest.mark.parametrize(
    ("statements", "opacity"),
    [("", 1.0), ("d 0.25", 0.25), ("Tr 0.25", 0.75), ("d 0.5\nTr 0.25", 0.5), ("d 7", 1.0), ("d nan\nTr 0.25", 0.75)],
)
def test_opacity_of_obj_materials(root: Path, files: MeshFiles, statements: str, opacity: float) -> None:
    part, _ = load_painted(files, root, f"Kd 0 1 0\n{statements}")
    assert part.material.base_color == pytest.approx((0, 1, 0, opacity))
    assert part.material.alpha_mode is (AlphaMode.BLEND if opacity < 1 else AlphaMode.OPAQUE)
    assert part.material.double_sided


@pytest.mark.usefixtures("white")
def test_texture_coordinates_start_at_the_top(root: Path, files: MeshFiles) -> None:
    uv = "vt 0 0.25\nvt 1 0\nvt 0.5 1\n"
    part, _ = load_painted(files, root, "Kd 0 0 0\nd 0.5\nmap_Kd p.png", uv, "1/1 2/2 3/3")
    mesh = mesh_of(part)
    order = np.argsort(mesh.positions @ (1, 2, 0))
    assert mesh.uv0[order].tolist() == [[0, 0.75], [1, 1], [0.5, 0]]
    assert part.material.base_color == (1, 1, 1, 0.5)  # the image replaces the black colour


@pytest.mark.usefixtures("white")
@pytest.mark.parametrize("number", ["nan", "inf", "1e39"])
def test_texture_coordinates_that_are_not_finite_are_zero(root: Path, files: MeshFiles, number: str) -> None:
    uv = f"vt 0 0.25\nvt 1 {number}\nvt 0.5 1\n"
    part, warnings = load_painted(files, root, "map_Kd p.png", uv, "1/1 2/2 3/3")
    assert warnings == ["'t.obj': 1 of 3 texture coordinates are not finite, they are read as 0"]
    assert part.material.base_color_texture is not None
    assert sorted(mesh_of(part).uv0.tolist()) == [[0, 0.75], [0.5, 0], [1, 1]]


def test_vertices_that_are_not_finite_drop_their_triangles(root: Path, files: MeshFiles) -> None:
    rows = "0 0 0\n1 0 0\n0 -1e13 0\n0 nan 0\n0 0 inf\n"
    write(root / "t.ply", ply(5, rows + "3 0 1 2\n3 0 1 3\n3 1 2 4\n", faces=3))
    part, warnings = load_one(files, "t.ply")
    mesh = mesh_of(part)
    assert warnings == ["'t.ply': 2 of 3 triangles with vertices that are not finite are left out"]
    assert len(mesh.elements) == 1
    assert mesh.positions[mesh.elements[0]].min() == np.float32(-1e13)
    assert np.isfinite(mesh.positions).all()


@pytest.mark.parametrize("number", ["nan", "1e39", "-1e39", "1e400"])
def test_obj_vertices_that_are_not_finite_in_float32_drop_their_faces(
    root: Path, files: MeshFiles, number: str
) -> None:
    write(root / "t.obj", f"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 {number}\nf 1 2 3\nf 1 2 4\n")
    part, warnings = load_one(files, "t.obj")
    mesh = mesh_of(part)
    assert (len(mesh.elements), mesh.positions.max()) == (1, 1.0)
    assert warnings == ["'t.obj': 1 of 2 triangles with vertices that are not finite are left out"]
    write(root / "u.obj", f"v 0 0 0\nv 1 0 0\nv 0 0 {number}\nf 1 2 3\n")
    with pytest.raises(MeshFileError, match=r"no triangles .*1 of 1 "):
        files.load("u.obj")


@pytest.mark.parametrize("missing", ["t.mtl", "p.png"])
def test_a_missing_material_or_texture_file_has_a_warning(root: Path, files: MeshFiles, missing: str) -> None:
    if missing != "t.mtl":
        write(root / "t.mtl", "newmtl m\nKd 0 0 1\nmap_Kd p.png\n")
    write(root / "t.obj", "mtllib t.mtl\n" + TRIANGLE.replace("f ", "usemtl m\nf "))
    _, warnings = load_one(files, "t.obj")
    assert warnings == [f"'t.obj': {missing!r} is left out: No such file or directory"]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(
    "faces", [((0, 1, 2), (0, 2, 4)), ((0, 1, 2, 4),), ((0, 1, 2, 4), (2, 3, 4)), ((0, 1, 2, 3, 4),)]
)
def test_texture_coordinates_of_the_corners_of_ply_faces(
    root: Path, files: MeshFiles, faces: tuple[tuple[int, ...], ...], order: str
) -> None:
    """As MeshLab writes textured meshes."""
    write(root / "p.png", png((255, 0, 0)))
    header = (
        f"ply\nformat binary_{'little' if order == '<' else 'big'}_endian 1.0\ncomment TextureFile p.png\n"
        "element vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    )
    points = ((0, 0), (1, 0), (1, 1), (0.5, 2), (0, 1))
    body = struct.pack(f"{order}15f", *(number for x, y in points for number in (x, y, 0)))
    for number, face in enumerate(faces):
        uv = [coordinate for vertex in face for coordinate in (number, vertex / 8)]
        body += struct.pack(f"{order}B{len(face)}iB{len(uv)}f3B", len(face), *face, len(uv), *uv, 255, 255, 255)
    write(root / "t.ply", header.encode() + body)
    part, warnings = load_one(files, "t.ply")
    mesh = mesh_of(part)
    assert part.material.base_color_texture is not None
    assert (warnings, len(mesh.elements)) == ([], sum(len(face) - 2 for face in faces))
    u, v = mesh.uv0[mesh.elements].reshape(-1, 2).T
    assert sorted(set(u.tolist())) == [float(number) for number in range(len(faces))]
    vertices = [points.index((x, y)) for x, y in mesh.positions[mesh.elements].reshape(-1, 3)[:, :2].tolist()]
    np.testing.assert_allclose(1.0 - v, np.array(vertices) / 8, atol=1e-6)


TWO_TEXTURES = "comment TextureFile p.png\ncomment TextureFile q.png\n"


def test_only_texture_coordinates_make_a_second_texture_of_a_ply_file_a_warning(root: Path, files: MeshFiles) -> None:
    write(root / "q.png", png((255, 0, 0)))
    place = "0 0 0{0}\n1 0 0{0}\n0 1 0{0}\n3 0 1 2\n"
    write(root / "t.ply", ply(3, place.format(" 0 0"), "float s", "float t", faces=1, comments=TWO_TEXTURES))
    write(root / "plain.ply", ply(3, place.format(""), faces=1, comments=TWO_TEXTURES))
    assert [len(load_one(files, name)[1]) for name in ("t.ply", "plain.ply")] == [1, 0]


def test_each_face_of_a_ply_file_has_the_texture_that_it_numbers(root: Path, files: MeshFiles) -> None:
    """As MeshLab writes meshes with several textures; a face without one has the number -1."""
    write(root / "p.png", png((255, 0, 0)))
    write(root / "q.png", png((0, 255, 0)))
    corners = [f"3 {k} {k + 1} {k + 2} 6 {k} 0 {k} 0 {k} 0 {number}\n" for k, number in enumerate((1, 0, -1, 1))]
    points = "".join(f"{k} {k % 2} 0\n" for k in range(6))
    lists = "property list uchar float texcoord\nproperty int texnumber\nend_header"
    write(
        root / "t.ply", ply(6, points + "".join(corners), faces=4, comments=TWO_TEXTURES).replace("end_header", lists)
    )
    warnings: list[str] = []
    shown = {}
    for part in files.load("t.ply", warnings=warnings):
        texture = part.material.base_color_texture
        color = None if texture is None else tuple(texture.image.decode()[0, 0, :3].tolist())
        shown[color] = sorted({*mesh_of(part).uv0[:, 0].tolist()})
    assert (shown, warnings) == ({None: [2], (255, 0, 0): [1], (0, 255, 0): [0, 3]}, [])


@pytest.mark.parametrize("library", ["m/t.mtl", '"m/t.mtl"', "./m/t.mtl # materials"])
@pytest.mark.parametrize("texture", ["p.png", "-s 1 1 1 p.png", "sub/p.png", "../p.png"])
def test_textures_are_relative_to_the_file_of_the_material(
    root: Path, files: MeshFiles, library: str, texture: str
) -> None:
    write(root / "m" / texture.split()[-1], png((255, 0, 0)))
    write(root / "m/t.mtl", f"newmtl m\nmap_Kd {texture}\nmap_d {texture}\n")
    write(root / "t.obj", f"mtllib {library}\nvt 0 0\n" + TRIANGLE.replace("f 1 2 3", "usemtl m # it\nf 1/1 2/1 3/1"))
    part, warnings = load_one(files, "t.obj")
    assert part.material.base_color_texture is not None
    assert warnings == []


@pytest.mark.usefixtures("white")
@pytest.mark.parametrize("name", ["/home/other/tex/p.png", r"C:\other tex\p.png", r".\p.png", '"p.png"', "tex/p.png"])
def test_a_texture_named_by_a_path_of_another_machine_is_looked_for_beside_the_mesh(
    root: Path, files: MeshFiles, name: str
) -> None:
    part, warnings = load_painted(files, root, f"map_Kd {name}")
    assert part.material.base_color_texture is not None
    assert len(warnings) == (name not in (r".\p.png", '"p.png"'))


@pytest.mark.usefixtures("white")
@pytest.mark.parametrize(
    ("kd", "expected"),
    [("Kd 0.5 0 1\n", (0.2159, 0, 1)), ("", (1, 1, 1)), ("Kd 0 0 0\n", (1, 1, 1)), ("Kd nan 1.05 -1\n", (0, 1, 0))],
)
def test_kd_multiplies_the_texture(root: Path, files: MeshFiles, kd: str, expected: tuple[float, ...]) -> None:
    """As in Drake. A black one beside a texture is a slip of exporters."""
    part, _ = load_painted(files, root, f"{kd}map_Kd p.png")
    assert part.material.base_color[:3] == pytest.approx(expected, abs=2e-3)
    assert part.material.base_color_texture is not None


@pytest.mark.parametrize(
    ("options", "expected", "ignored"),
    [
        ("-s 2 3 1 -o 0.25 0.5 0", [(0.25, 0.5), (2.25, 3.5)], ()),
        ("-o 0.25", [(0.25, 0), (1.25, 1)], ()),
        ("-s 2", [(0, 0), (2, 1)], ()),
        ("-s\t2  3e0\t1 -imfchan m", [(0, 0), (2, 3)], ("-imfchan m",)),
        ("-clamp on -s 0.5 0.5", [(0, 0), (0.5, 0.5)], ()),
        ("-clamp on -s 2 2", [(0, 0), (2, 2)], ("-clamp on",)),
        ("-blendu on -cc off -mm 0.5 1", [(0, 0), (1, 1)], ("-mm 0.5 1",)),
    ],
)
@pytest.mark.usefixtures("white")
def test_options_of_textures(
    root: Path, files: MeshFiles, options: str, expected: list[tuple[float, float]], ignored: tuple[str, ...]
) -> None:
    part, warnings = load_painted(files, root, f"map_Kd {options} p.png", "vt 0 0\nvt 1 1\n", "1/1 2/2 3/1")
    found = {(float(u), float(1 - v)) for u, v in mesh_of(part).uv0}
    assert found == {(float(u), float(v)) for u, v in expected}
    assert len(warnings) == len(ignored)
    assert all(option in warning for option, warning in zip(ignored, warnings, strict=True))


@pytest.mark.parametrize(
    ("ke", "expected"), [("Ke 0 1 0.5", (0, 1, 0.2140)), ("Ke 1", (1, 1, 1)), ("Ke 0 0 0", (0, 0, 0))]
)
def test_ke_is_emitted(root: Path, files: MeshFiles, ke: str, expected: tuple[float, ...]) -> None:
    part, _ = load_painted(files, root, f"Kd 0 0 0\n{ke}  # lamp")
    assert part.material.emissive == pytest.approx(expected, abs=1e-3)


@pytest.mark.usefixtures("white")
@pytest.mark.parametrize(("name", "is_ignored"), [("p.png", False), ("-s 1 1 1 other.png", True)])
def test_map_d_is_said_unless_it_is_the_alpha_of_map_kd(
    root: Path, files: MeshFiles, name: str, is_ignored: bool
) -> None:
    _, warnings = load_painted(files, root, f"map_Kd p.png\nmap_d {name}")
    assert any("map_d" in warning for warning in warnings) == is_ignored
