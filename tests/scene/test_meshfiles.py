from __future__ import annotations

import os
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from gateway.scene import transforms as tf
from gateway.scene.bounds import scene_bounds
from gateway.scene.flatten import flatten
from gateway.scene.geometry import Part, PointCloud, Surface
from gateway.scene.gltf import GltfLimits
from gateway.scene.meshfiles import MeshFileError, MeshFileLimits, MeshFiles
from gateway.scene.packages import Packages
from gateway.scene.tree import Node
from renderers import primitives
from renderers.drawlist import AlphaMode, Mesh

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n"
CUBE = """mtllib cube.mtl
v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1
vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1
usemtl painted
f 1/1 4/4 3/3 2/2\nf 5/1 6/2 7/3 8/4
usemtl glass
f 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8
"""
CUBE_MTL = "newmtl painted\nKd 0.1 0.1 0.1\nmap_Kd textures/paint.png\nnewmtl glass\nKd 1 0 0.5\nd 0.25\n"


def write(path: Path, content: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def png(*pixels: tuple[int, int, int]) -> bytes:
    ok, data = cv2.imencode(".png", np.array([[(b, g, r) for r, g, b in pixels]], np.uint8))
    assert ok
    return data.tobytes()


def stl(mesh: Mesh) -> bytes:
    corners = mesh.positions[mesh.elements]
    rows = np.zeros(len(corners), np.dtype([("n", "<3f4"), ("v", "<9f4"), ("a", "<u2")]))
    rows["v"] = corners.reshape(-1, 9)
    return b"\0" * 80 + struct.pack("<I", len(corners)) + rows.tobytes()


def bounds(parts: tuple[Part, ...]) -> np.ndarray:
    found = scene_bounds(flatten(Node(parts)))
    assert found is not None
    return found


def mesh_of(part: Part) -> Mesh:
    assert isinstance(part.shape, Surface)
    return part.shape.mesh


@pytest.fixture
def root(tmp_path: Path) -> Path:
    folder = tmp_path / "open"
    folder.mkdir()
    write(tmp_path / "secret.obj", TRIANGLE)
    write(tmp_path / "open-sesame" / "near.obj", TRIANGLE)
    return folder


@pytest.fixture
def files(root: Path) -> MeshFiles:
    return MeshFiles([root])


# --- formats


def test_obj_with_materials_and_texture(root: Path, files: MeshFiles):
    write(root / "cube.obj", CUBE)
    write(root / "cube.mtl", CUBE_MTL)
    write(root / "textures" / "paint.png", png((255, 0, 0), (0, 0, 255)))
    parts = files.load("cube.obj")
    np.testing.assert_array_equal(bounds(parts), [(-1, -1, -1), (1, 1, 1)])
    by_alpha = {part.material.alpha_mode: part for part in parts}
    painted, glass = by_alpha[AlphaMode.OPAQUE], by_alpha[AlphaMode.BLEND]
    assert painted.material.base_color == (1, 1, 1, 1)
    assert painted.material.base_color_texture is not None
    pixels = painted.material.base_color_texture.image.decode()
    np.testing.assert_array_equal(pixels, [[(255, 0, 0, 255), (0, 0, 255, 255)]])
    assert glass.material.base_color == pytest.approx((1, 0, 0.2159, 0.25), abs=2e-3)
    assert glass.material.double_sided
    assert {part.kind for part in parts} == {"mesh_file"}
    assert {part.source for part in parts} == {"cube.obj"}
    mesh = mesh_of(painted)
    assert mesh.uv0 is not None
    corner = np.flatnonzero((mesh.positions == (-1, -1, 1)).all(axis=1))
    np.testing.assert_array_equal(mesh.uv0[corner[0]], (0, 1))


def test_meshes_without_normals_are_smooth_but_not_across_creases(root: Path, files: MeshFiles):
    write(root / "ball.stl", stl(primitives.sphere()))
    ball = mesh_of(files.load("ball.stl")[0])
    assert ball.normals is not None
    assert len(ball.positions) == len(primitives.sphere().positions)
    assert np.einsum("ni,ni->n", ball.normals, ball.positions).min() > 0.99
    write(root / "box.stl", stl(primitives.box()))
    box = mesh_of(files.load("box.stl")[0])
    assert box.normals is not None
    assert len(box.positions) == 24
    np.testing.assert_allclose(np.sort(np.abs(box.normals), axis=1), np.tile((0, 0, 1), (24, 1)), atol=1e-6)


@pytest.mark.parametrize("content", [b"no picture", png((1, 2, 3))[:33], b""])
def test_textures_that_cannot_be_decoded_are_left_out(root: Path, files: MeshFiles, content: bytes):
    write(root / "cube.obj", CUBE)
    write(root / "cube.mtl", CUBE_MTL)
    write(root / "textures" / "paint.png", content)
    parts = files.load("cube.obj")
    assert len(parts) == 2
    assert [part.material.base_color_texture for part in parts] == [None, None]


def test_textures_beyond_the_total_of_pixels_are_left_out(root: Path):
    head, _ = CUBE.split("usemtl glass")
    write(root / "two.obj", head + "usemtl second\nf 1/1 2/2 6/3 5/4\n")
    write(root / "cube.mtl", CUBE_MTL.replace("glass", "second") + "map_Kd second.png\n")
    write(root / "textures" / "paint.png", png((1, 2, 3), (4, 5, 6)))
    write(root / "second.png", png((7, 8, 9), (4, 5, 6)))
    for most, textured in ((4, 2), (3, 1), (1, 0)):
        files = MeshFiles([root], MeshFileLimits(gltf=GltfLimits(max_total_image_pixels=most)))
        assert sum(part.material.base_color_texture is not None for part in files.load("two.obj")) == textured


def test_normals_of_the_file_are_kept(root: Path, files: MeshFiles):
    write(root / "n.obj", "v 0 0 0\nv 1 0 0\nv 0 2 0\nvn 0 0.6 0.8\nf 1//1 2//1 3//1\n")
    mesh = mesh_of(files.load("n.obj")[0])
    np.testing.assert_allclose(mesh.normals, np.tile((0, 0.6, 0.8), (3, 1)), atol=1e-6)


def test_ply_with_vertex_colours_and_ply_of_points(root: Path, files: MeshFiles):
    head = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {c}\n" for c in "xyz")
    colors = "".join(f"property uchar {c}\n" for c in ("red", "green", "blue"))
    rows = "0 0 0 255 0 0\n1 0 0 0 255 0\n0 1 0 0 0 188\n"
    write(
        root / "c.ply",
        f"{head}{colors}element face 1\nproperty list uchar int vertex_indices\nend_header\n{rows}3 0 1 2\n",
    )
    mesh = mesh_of(files.load("c.ply")[0])
    assert mesh.colors is not None
    # the file has colours as displays show them, a mesh has linear light, which 188 is half of
    light = [(1, 0, 0, 1), (0, 1, 0, 1), (0, 0, 0.5029, 1)]
    np.testing.assert_allclose(mesh.colors[np.argsort(mesh.positions @ (1, 2, 0))], light, atol=1e-4)
    write(root / "p.ply", f"{head}{colors}end_header\n{rows}")
    (part,) = files.load("p.ply")
    assert isinstance(part.shape, PointCloud)
    np.testing.assert_array_equal(part.shape.points, [(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    np.testing.assert_array_equal(part.shape.channels["rgb"][:, :3], np.diag(np.float32([1, 1, 188 / 255])))


DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
 <asset>{asset}</asset>
 <library_geometries><geometry id="g"><mesh>
  <source id="p"><float_array id="pa" count="9">0 0 0 1 0 0 0 2 0</float_array><technique_common>
   <accessor source="#pa" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
   <param name="Z" type="float"/></accessor></technique_common></source>
  <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
  <triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
 </mesh></geometry></library_geometries>
 <library_visual_scenes><visual_scene id="s"><node id="n"><translate>0 0 5</translate>
  <instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
 <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>"""


@pytest.mark.parametrize(
    ("asset", "expected"),
    [
        ('<unit name="cm" meter="0.01"/><up_axis>Z_UP</up_axis>', [(0, 0, 0.05), (0.01, 0.02, 0.05)]),
        ("<up_axis>Y_UP</up_axis>", [(0, -5, 0), (1, -5, 2)]),
        ("", [(0, -5, 0), (1, -5, 2)]),
        ("<up_axis>X_UP</up_axis>", [(-2, -5, 0), (0, -5, 1)]),
    ],
)
def test_collada_states_its_unit_and_what_is_up(root: Path, files: MeshFiles, asset: str, expected):
    write(root / "part.dae", DAE.format(asset=asset))
    np.testing.assert_allclose(bounds(files.load("part.dae")), expected, atol=1e-6)


def test_collada_with_entities_is_refused(root: Path, files: MeshFiles):
    bomb = DAE.format(asset="").replace("<COLLADA", '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]><COLLADA', 1)
    write(root / "bomb.dae", bomb)
    with pytest.raises(MeshFileError, match="DOCTYPE"):
        files.load("bomb.dae")


def gltf(generator: str) -> str:
    return (
        '{"asset":{"version":"2.0","generator":"' + generator + '"},"scene":0,"scenes":[{"nodes":[0]}],'
        '"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],'
        '"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,2,0]}],'
        '"bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36,"uri":"data.bin"}]}'
    )


@pytest.mark.parametrize(("generator", "expected"), [("", [(0, 0, 0), (1, 0, 2)]), ("VTK", [(0, 0, 0), (1, 2, 0)])])
def test_gltf_is_y_up_unless_drake_wrote_it(root: Path, files: MeshFiles, generator: str, expected):
    write(root / "t.gltf", gltf(generator))
    write(root / "data.bin", np.array([(0, 0, 0), (1, 0, 0), (0, 2, 0)], np.float32).tobytes())
    np.testing.assert_allclose(bounds(files.load("t.gltf")), expected, atol=1e-6)


def test_scale_is_applied_along_the_files_axes(root: Path, files: MeshFiles):
    write(root / "t.obj", TRIANGLE)
    np.testing.assert_array_equal(bounds(files.load("t.obj", (2, -3, 4))), [(0, -6, 0), (2, 0, 0)])
    np.testing.assert_array_equal(bounds(files.load("t.obj")), [(0, 0, 0), (1, 2, 0)])


# --- names


def test_absolute_relative_and_file_names(root: Path, files: MeshFiles):
    write(root / "sub dir" / "t.obj", TRIANGLE)
    for name in (
        "sub dir/t.obj",
        str(root / "sub dir/t.obj"),
        f"file://{root}/sub%20dir/t.obj",
        "./sub dir/../sub dir/t.obj",
    ):
        assert files.load(name)


def test_packages_are_found_by_the_name_in_their_manifest(root: Path, files: MeshFiles):
    write(root / "ws" / "src" / "arm" / "package.xml", "<package format='2'>\n <name> my_arm </name></package>")
    write(root / "ws" / "src" / "arm" / "meshes" / "link.obj", TRIANGLE)
    assert files.load("package://my_arm/meshes/link.obj")
    with pytest.raises(MeshFileError, match="no package 'arm'") as caught:
        files.load("package://arm/meshes/link.obj")
    assert caught.value.missing
    with pytest.raises(MeshFileError, match="outside"):
        files.load("package://my_arm/../../../../secret.obj")


def test_unknown_packages_do_not_cause_a_search_each(root: Path, monkeypatch):
    now = [0.0]
    packages = Packages((root,), clock=lambda: now[0])
    scans = []
    real = Packages._scan
    monkeypatch.setattr(Packages, "_scan", lambda self: scans.append(1) or real(self))
    for _ in range(50):
        assert packages.folder("nobody") is None
    assert len(scans) == 1
    write(root / "late" / "package.xml", "<name>late</name>")
    now[0] = 60.0
    assert packages.folder("late") == root / "late"


def test_a_sibling_of_a_known_format_stands_in(root: Path, files: MeshFiles):
    write(root / "link.obj", TRIANGLE)
    write(root / "other.vtm", "<VTKFile/>")
    assert files.load("link.vtp")
    with pytest.raises(MeshFileError, match="not a file of a known format") as caught:
        files.load("other.vtm")
    assert not caught.value.missing


def test_missing_files_say_so(files: MeshFiles):
    with pytest.raises(MeshFileError, match=r"'nothing\.obj': there is no such file") as caught:
        files.load("nothing.obj")
    assert caught.value.missing


# --- attacks


@pytest.mark.parametrize(
    "name",
    [
        "../secret.obj",
        "sub/../../secret.obj",
        "../open-sesame/near.obj",
        "{outside}/secret.obj",
        "file://{outside}/secret.obj",
        "file://{outside}/open/%2e%2e/secret.obj",
        "/etc/passwd",
        "link/secret.obj",
        "secret-link.obj",
        "../nothing-there.obj",
    ],
)
def test_nothing_outside_of_the_roots_is_read_or_even_known_to_exist(root: Path, files: MeshFiles, name: str):
    (root / "link").symlink_to(root.parent)
    (root / "secret-link.obj").symlink_to(root.parent / "secret.obj")
    with pytest.raises(MeshFileError, match="lies outside of the folders that are open to clients") as caught:
        files.load(name.format(outside=root.parent))
    assert not caught.value.missing


def test_a_link_within_the_roots_is_followed(root: Path, files: MeshFiles):
    write(root / "real" / "t.obj", TRIANGLE)
    (root / "alias.obj").symlink_to(root / "real" / "t.obj")
    assert files.load("alias.obj")


def test_a_sibling_outside_is_not_taken(root: Path, files: MeshFiles):
    (root / "link.obj").symlink_to(root.parent / "secret.obj")
    with pytest.raises(MeshFileError, match="no such file"):
        files.load("link.vtp")


@pytest.mark.parametrize("name", ["http://example.org/x.obj", "https://example.org/x.obj", "ftp://h/x.obj", "data://x"])
def test_nothing_is_fetched(files: MeshFiles, name: str):
    with pytest.raises(MeshFileError, match="nothing is fetched"):
        files.load(name)


@pytest.mark.parametrize("name", ["", "a\0b.obj", "x" * 5000 + ".obj"])
def test_what_is_no_file_name(files: MeshFiles, name: str):
    with pytest.raises(MeshFileError, match="is not a file name"):
        files.load(name)


def test_names_that_the_system_refuses(files: MeshFiles):
    with pytest.raises(MeshFileError):
        files.load("x" * 300 + ".obj")
    with pytest.raises(MeshFileError):
        files.load("\ud800.obj")


@pytest.mark.parametrize("named", ["../secret.mtl", "/etc/passwd", "leak.mtl", "http://example.org/x.mtl"])
def test_materials_outside_of_the_roots_are_left_out(root: Path, files: MeshFiles, named: str):
    write(root.parent / "secret.mtl", "newmtl m\nKd 1 0 0\n")
    (root / "leak.mtl").symlink_to(root.parent / "secret.mtl")
    write(root / "t.obj", f"mtllib {named}\nv 0 0 0\nv 1 0 0\nv 0 2 0\nusemtl m\nf 1 2 3\n")
    (part,) = files.load("t.obj")
    assert part.material.base_color == (1, 1, 1, 1)


def test_textures_outside_of_the_roots_are_left_out(root: Path, files: MeshFiles):
    write(root.parent / "secret.png", png((9, 9, 9)))
    write(root / "t.mtl", "newmtl m\nKd 1 0 0\nmap_Kd ../secret.png\n")
    write(root / "t.obj", "mtllib t.mtl\nv 0 0 0\nv 1 0 0\nv 0 2 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n")
    (part,) = files.load("t.obj")
    assert part.material.base_color_texture is None
    assert part.material.base_color == (1, 0, 0, 1)


def test_gltf_buffers_outside_of_the_roots_are_refused(root: Path, files: MeshFiles):
    write(root.parent / "data.bin", b"\0" * 36)
    write(root / "t.gltf", gltf("").replace("data.bin", "../data.bin"))
    with pytest.raises(MeshFileError, match="outside"):
        files.load("t.gltf")


def test_a_pipe_is_no_mesh_and_does_not_hold_the_thread(root: Path, files: MeshFiles):
    os.mkfifo(root / "pipe.obj")
    with pytest.raises(MeshFileError, match=r"known format|regular file"):
        files.load("pipe.obj")
    os.mkfifo(root / "pipe.mtl")
    write(root / "t.obj", "mtllib pipe.mtl\n" + TRIANGLE)
    assert files.load("t.obj")


def test_without_roots_everything_is_refused(root: Path):
    write(root / "t.obj", TRIANGLE)
    with pytest.raises(MeshFileError, match="no folder is open"):
        MeshFiles([]).load(str(root / "t.obj"))


@pytest.mark.parametrize("extension", ["obj", "stl", "ply", "dae", "glb", "gltf"])
@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\0" * 200,
        b"solid \xff\xfe",
        b"f 1 2 3\n",
        b"ply\nformat ascii 1.0\nelement vertex 9999999999\nend_header\n",
    ],
)
def test_damaged_files_are_a_sentence(root: Path, files: MeshFiles, extension: str, content: bytes):
    write(root / f"bad.{extension}", content)
    with pytest.raises(MeshFileError) as caught:
        files.load(f"bad.{extension}")
    assert f"bad.{extension}" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_faces_beyond_the_vertices_are_a_sentence(root: Path, files: MeshFiles):
    write(root / "bad.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    with pytest.raises(MeshFileError):
        files.load("bad.obj")


def test_files_beyond_the_limits_are_refused(root: Path):
    write(root / "t.obj", TRIANGLE)
    with pytest.raises(MeshFileError, match="larger than the 10 bytes"):
        MeshFiles([root], MeshFileLimits(max_bytes=10)).load("t.obj")
    with pytest.raises(MeshFileError, match="more than 2 vertices"):
        MeshFiles([root], MeshFileLimits(gltf=GltfLimits(max_vertices=2))).load("t.obj")


# --- memory


def test_a_file_is_loaded_once_until_it_or_its_material_changes(root: Path, files: MeshFiles):
    write(root / "cube.obj", CUBE)
    material = write(root / "cube.mtl", CUBE_MTL)
    first = files.load("cube.obj")
    assert files.load(str(root / "cube.obj"))[0].shape is first[0].shape
    scaled = files.load("cube.obj", (2, 2, 2))
    assert scaled[0].shape is first[0].shape
    np.testing.assert_array_equal(scaled[0].X_node_part, tf.scaling(2, 2, 2))
    write(material, CUBE_MTL.replace("d 0.25", "d 0.75"))
    again = files.load("cube.obj")
    assert sorted(part.material.base_color[3] for part in again) == [0.75, 1.0]


def test_the_cache_is_bounded_in_bytes(root: Path):
    for index in range(4):
        write(root / f"{index}.obj", TRIANGLE)
    size = MeshFiles([root])
    size.load("0.obj")
    files = MeshFiles([root], MeshFileLimits(cache_bytes=2 * size._nbytes))
    kept = [files.load(f"{index}.obj")[0].shape for index in range(4)]
    assert files._nbytes <= 2 * size._nbytes
    assert files.load("3.obj")[0].shape is kept[3]
    assert files.load("0.obj")[0].shape is not kept[0]
