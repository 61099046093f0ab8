"""Requests in JSON that ``scenegate publish`` puts below a path."""

import json
import os
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.files.robots.published import MAX_IMAGE_SIDE, PartImages, geometries_of
from gateway.scene.draw.meshing import meshes_of
from gateway.scene.tree.geometry import Part, Shape, Surface
from gateway.scene.tree.geometry import PointCloud as Points
from gateway.scene.tree.transforms import from_pose, scaling, translation
from renderers.drawlist import AlphaMode, Image, ImageError, Material, Mesh, Texture
from renderers.images import decode_image
from scenegate.cli.publish import _read_request
from scenegate.messages.changes import Changes, Entry
from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, MeshGeometry, PointCloud, Sphere, Transform
from tests.adapters.treeviewer.conversation import BOX
from tests.conftest import DemoGateway
from tests.files.robots.files import ARM, TRIANGLE, write
from tests.support.command import scenegate
from tests.support.liblcm import liblcm
from tests.support.waiting import SECONDS

NOT_DRAWN = """<robot name="arm">
<link name="a"><visual><geometry><mesh filename="missing.stl"/></geometry></visual></link>
</robot>"""


def read(folder: Path, request: Any) -> Changes:
    source, changes = folder / "request.json", Changes()
    source.write_text(json.dumps(request))
    _read_request(source, ("root",), changes)
    return changes


def test_commands_are_put_below_the_path(tmp_path: Path) -> None:
    box, ball, move = {"type": "box"}, {"type": "sphere"}, {"translation": [1, 2, 3]}
    request = {
        "settransform": [{"path": ["a"], "transform": move}, {"path": ["b"]}],
        "setgeometry": [
            {"path": "a/b", "geometry": box},
            {"path": [], "geometries": [box, ball]},
            {"path": ["c"], "geometry": None},
        ],
        "delete": [{"path": ["old", 2]}],
    }
    changes = read(tmp_path, request)
    assert list(changes.deleted) == [("root", "old", 2)]
    assert changes.entries == {
        ("root", "a", "b"): Entry([box]),
        ("root",): Entry([box, ball]),
        ("root", "c"): Entry([]),
        ("root", "a"): Entry(None, move),
        ("root", "b"): Entry(None, {}),
    }


def test_other_json_is_no_request(tmp_path: Path) -> None:
    others: tuple[Any, ...] = ([], {}, {"geometry": []}, 3)
    for other in others:
        with pytest.raises(ValueError, match="has no delete, setgeometry or settransform"):
            read(tmp_path, other)
    for command in ({}, {"path": 3}, {"path": None}, "a", ["a"]):
        with pytest.raises(ValueError, match=r"setgeometry\[1\] has no path"):
            read(tmp_path, {"setgeometry": [{"path": "a"}, command]})


def test_parts_become_meshes_and_points_of_the_path() -> None:
    """In the frame of the path, with sRGB colours limited to 1, and with faces whose front stays outside."""
    material = Material(base_color=(0.5, 0.0, 2.0, 0.25))
    mirror = np.diag((-1.0, 1.0, 1.0, 1.0))
    ((box, _, X_part_box),) = meshes_of(Box((2.0, 4.0, 6.0)), material)
    surface = Surface(Mesh(box.positions @ X_part_box[:3, :3].T.astype(np.float32), box.elements))
    for X in (translation(10.0, 0.0, 0.0), translation(10.0, 0.0, 0.0) @ mirror):
        (mesh,) = geometries_of(Part(surface, material, X), None)
        assert isinstance(mesh, MeshGeometry)
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        assert vertices.min(0) == pytest.approx((9, -2, -3))
        assert vertices.max(0) == pytest.approx((11, 2, 3))
        corners = vertices[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (np.einsum("ij,ij->i", normals, corners.mean(1) - (10, 0, 0)) > 0).all()
        assert mesh.color == pytest.approx([0.7354, 0.0, 1.0, 0.25], abs=1e-4)


def test_points_are_moved_and_keep_their_colours() -> None:
    rgb = np.array([(1, 0, 0), (0, 1, 0)], np.float32)
    shape = Points(np.array([(0, 0, 0), (1, 2, 3)], np.float32), {"rgb": rgb})
    (points,) = geometries_of(Part(shape, Material(), translation(0.0, 0.0, 3.0)), None)
    assert isinstance(points, PointCloud)
    np.testing.assert_array_equal(points.points, [(0, 0, 3), (1, 2, 6)])
    np.testing.assert_array_equal(points.colors, rgb)


def test_the_texture_of_a_shape_gives_its_mean_colour() -> None:
    pixels = np.full((2, 2, 4), (0, 255, 0, 255), np.uint8)
    material = Material(base_color_texture=Texture(Image(b"green", lambda: pixels)))
    (box,) = geometries_of(Part(Box((1.0, 1.0, 1.0)), material), PartImages())
    assert box.color == pytest.approx([0.0, 1.0, 0.0, 1.0])


def triangle(**fields: Any) -> Surface:
    return Surface(Mesh(np.eye(3, dtype=np.float32), np.array([(0, 1, 2)], np.uint32), **fields))


def test_meshes_keep_textures_and_vertex_colours() -> None:
    pixels = np.arange(48, dtype=np.uint8).reshape(3, 4, 4)
    uv = np.array([(0, 0), (1, 0), (0, 1)], np.float32)
    halved = Texture(Image(b"i", lambda: pixels), uv_transform=(0.5, 0.0, 0.25, 0.0, 0.5, 0.0))
    for mode, channels in ((AlphaMode.BLEND, 4), (AlphaMode.OPAQUE, 3)):
        material = Material(base_color=(1.0, 0.0, 0.0, 1.0), base_color_texture=halved, alpha_mode=mode)
        (mesh,) = geometries_of(Part(triangle(uv0=uv), material), PartImages())
        assert isinstance(mesh, MeshGeometry)
        assert mesh.color == pytest.approx([1.0, 0.0, 0.0, 1.0])
        np.testing.assert_array_equal(mesh.uv, 0.5 * uv + (0.25, 0.0))
        decoded = decode_image(mesh.image)  # type: ignore[arg-type]  # bytes
        np.testing.assert_array_equal(decoded[..., :channels], pixels[..., :channels])
        assert mesh.body()["type"] == "mesh"
    linear = np.array([(1, 0, 0, 1), (0.5, 0.5, 0.5, 0.5), (0, 0, 0, 0)], np.float32)
    (mesh,) = geometries_of(Part(triangle(colors=linear), Material()), PartImages())
    assert isinstance(mesh, MeshGeometry)
    np.testing.assert_allclose(np.asarray(mesh.colors)[1], (0.7354, 0.7354, 0.7354, 0.5), atol=1e-4)
    (plain,) = geometries_of(Part(triangle(colors=linear), Material()), None)
    assert plain.body()["type"] == "mesh_data"


def test_large_textures_are_reduced_and_broken_ones_are_left_out() -> None:
    uv = np.zeros((3, 2), np.float32)

    def fail() -> NDArray[np.uint8]:
        raise ImageError("broken")

    large = Image(b"large", lambda: np.full((100, 2 * MAX_IMAGE_SIDE, 4), 7, np.uint8))
    for image in (large, Image(b"broken", fail)):
        material = Material(base_color_texture=Texture(image))
        (mesh,) = geometries_of(Part(triangle(uv0=uv), material), PartImages())
        assert isinstance(mesh, MeshGeometry)
        if image is large:
            assert decode_image(mesh.image).shape == (50, MAX_IMAGE_SIDE, 4)  # type: ignore[arg-type]  # bytes
        else:
            assert mesh.image is None


def test_photographs_are_jpeg_files() -> None:
    noise = np.random.default_rng(1).integers(0, 256, (800, 800, 4), np.uint8)
    material = Material(base_color_texture=Texture(Image(b"noise", lambda: noise)))
    (mesh,) = geometries_of(Part(triangle(uv0=np.zeros((3, 2), np.float32)), material), PartImages())
    assert isinstance(mesh, MeshGeometry)
    assert isinstance(mesh.image, bytes)
    assert mesh.image.startswith(b"\xff\xd8")


@pytest.mark.parametrize(
    ("shape", "kind"),
    [
        (Box((1.0, 2.0, 3.0)), "box"),
        (Sphere(1.0), "sphere"),
        (Ellipsoid((1.0, 2.0, 3.0)), "ellipsoid"),
        (Cylinder(1.0, 2.0), "cylinder"),
        (Capsule(1.0, 2.0), "capsule"),
    ],
)
def test_shapes_of_the_protocol_stay_what_they_are_unless_scaled(shape: Shape, kind: str) -> None:
    turned = from_pose((1.0, 2.0, 3.0), (0.5, 0.5, 0.5, 0.5))
    (geometry,) = geometries_of(Part(shape, Material(), turned), None)
    assert geometry.kind == kind
    transform = Transform.of(geometry.transform)
    np.testing.assert_allclose(from_pose(transform.translation, transform.quaternion), turned, atol=1e-15)
    scaled = list(geometries_of(Part(shape, Material(), scaling(1.0, 2.0, 1.0)), None))
    assert {geometry.kind for geometry in scaled} == {"mesh_data"}


def test_a_robot_gets_a_path_for_each_link(demo_gateway: DemoGateway, tmp_path: Path) -> None:
    """The command prints the first ten; options of robots are for robots."""
    liblcm()
    robot, hub = write(tmp_path, ARM), f"tcpq://{demo_gateway.tcpq}"
    options = ("--path", "cell/arm", "--joint", "elbow=0.5", "--lcm-url", hub, "--collision", "--no-sliders")
    result = scenegate("publish", str(robot), *options)
    assert result.exit_code == 0, result.stderr
    assert "set: cell/arm/base, cell/arm/upper, cell/arm/hand, cell/arm/finger, cell/arm/tool" in result.stdout
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(robot.read_bytes(),))
    writer.start()
    result = scenegate("publish", str(pipe), "--lcm-url", hub, "--collision", "--no-sliders")
    writer.join(SECONDS)
    assert "set: robot/base, robot/upper" in result.stdout, result.stderr
    twelve = {"setgeometry": [{"path": [i], "geometry": BOX} for i in range(12)]}
    boxes = write(tmp_path, json.dumps(twelve), "b.json")
    result = scenegate("publish", str(boxes), "--lcm-url", hub)
    assert "set: 0, 1, 2, 3, 4, 5, 6, 7, 8, 9 and 2 more\n" in result.stdout
    empty, none = write(tmp_path, "# empty", "empty.obj"), write(tmp_path, NOT_DRAWN, "none.urdf")
    for path, given, reason in (
        (empty, (), "the file holds no triangles or points, so nothing is drawn"),
        (none, (), "nothing of the robot is drawn"),
        (robot, ("--joint", "elbo=1"), "the robot has no joint 'elbo'; did you mean elbow"),
        (robot, ("--scale", "0.001"), "--scale is for mesh files"),
        (robot, ("--up", "z"), "--up is for mesh files"),
    ):
        result = scenegate("publish", str(path), *given, "--lcm-url", hub)
        assert (result.exit_code, reason in result.stderr) == (1, True), result.stderr
    triangle = write(tmp_path, TRIANGLE, "mm.obj")
    result = scenegate("publish", str(triangle), "--scale", "0.001", "--up", "y", "--lcm-url", hub)
    assert "set: mm\nmoved: mm" in result.stdout, result.stderr
    kinds = "--collision and --reload are for robot files (.urdf, .sdf, .world, .xml, .mjcf, .xacro)"
    assert kinds in scenegate("publish", str(triangle), "--collision").stderr
