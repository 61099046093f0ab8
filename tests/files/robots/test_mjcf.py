"""MJCF, read with the package mujoco."""

import os
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gateway.files.gltf.gltf_errors import GltfLimits
from gateway.files.robots.reader import read_robot
from gateway.files.robots.robot import Robot, RobotLimits
from renderers.color import linear_from_srgb
from renderers.stop import StopFlag
from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere
from scenegate.robots.robot_errors import RobotFileError
from tests.files.gltf.builder import mesh_of
from tests.files.robots.files import TRIANGLE, write

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture(autouse=True)
def _mujoco() -> None:
    pytest.importorskip("mujoco", reason="the package mujoco is not installed (scenegate[robots])")


def mjcf(body: str, rest: str = "") -> str:
    return f'<mujoco model="m">{rest}<worldbody>{body}</worldbody></mujoco>'


def read(folder: Path, content: str, **arguments: Any) -> Robot:
    return read_robot(write(folder, content, "robot.xml"), **arguments)


def assert_outward(corners: np.ndarray, directions: np.ndarray) -> None:
    """The winding of each triangle is that of a normal along its direction."""
    a, b, c = corners.transpose(1, 0, 2)
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), directions) > 0).all()


CHECKER = '<texture name="t" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 0 1" width="8" height="8"/>'


def test_bodies_joints_and_shapes(tmp_path: Path) -> None:
    robot = read(
        tmp_path,
        mjcf(
            '<body name="a" pos="0 0 1"><joint name="turn" axis="0 0 1" range="-1 1" limited="true"/>'
            '<geom type="box" size="1 2 3" pos="0 0 0.5" rgba="1 0 0 1"/><geom type="sphere" size="2"/>'
            '<body pos="1 0 0"><joint name="slide" type="slide" axis="1 0 0" ref="0.5"/>'
            '<geom type="capsule" size="1 2"/><geom type="cylinder" size="1 2"/><geom type="ellipsoid" size="1 2 3"/>'
            '</body></body><body name="ball"><freejoint name="free"/><geom size="1"/></body>'
        ),
    )
    assert robot.name == "m"
    assert robot.links == ("world", "a", "body_2", "ball")
    joints: dict[str, Any] = {
        "turn": ("revolute", (0.0,), pytest.approx((-np.pi / 180, np.pi / 180))),
        "slide": ("prismatic", (0.5,), None),
        "free": ("floating", (0, 0, 0, 1, 0, 0, 0), None),
    }
    assert {name: (joint.kind, joint.default, joint.limits) for name, joint in robot.joints.items()} == joints
    assert [[part.shape for part in parts] for parts in robot.parts] == [
        [],
        [Box((2.0, 4.0, 6.0)), Sphere(2.0)],
        [Capsule(1.0, 4.0), Cylinder(1.0, 4.0), Ellipsoid((1.0, 2.0, 3.0))],
        [Sphere(1.0)],
    ]
    box = robot.parts[1][0]
    assert box.material.base_color == (1.0, 0.0, 0.0, 1.0)
    np.testing.assert_allclose(box.X_node_part[:3, 3], (0, 0, 0.5))
    _, a, b, _ = robot.link_poses({"turn": np.pi / 2, "slide": 1.5})
    np.testing.assert_allclose(a, [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]], atol=1e-15)
    np.testing.assert_allclose(b[:3, 3], (0, 2, 1), atol=1e-15)


def test_which_geometry_is_for_collisions(tmp_path: Path) -> None:
    """Group 3 and above; and group 0 of a body that has geometry for the eye only, but a floor in the world."""
    content = mjcf(
        '<geom size="7"/><geom size="8" group="2" contype="0" conaffinity="0"/>'
        '<body name="menagerie"><geom size="1" group="2" contype="0" conaffinity="0"/><geom size="2" group="3"/></body>'
        '<body name="robosuite"><geom size="3" group="1" contype="0" conaffinity="0"/><geom size="4" group="0"/></body>'
        '<body name="plain"><geom size="5"/><geom size="6" rgba="1 1 1 0"/></body>'
    )
    seen = [[part.shape for part in parts] for parts in read(tmp_path, content).parts]
    assert seen == [[Sphere(7.0), Sphere(8.0)], [Sphere(1.0)], [Sphere(3.0)], [Sphere(5.0)]]
    touched = [[part.shape for part in parts] for parts in read(tmp_path, content, geometry="collision").parts]
    assert touched == [[Sphere(7.0)], [Sphere(2.0)], [Sphere(4.0)], [Sphere(5.0), Sphere(6.0)]]


def test_materials_and_textures(tmp_path: Path) -> None:
    robot = read(
        tmp_path,
        mjcf(
            '<geom type="plane" size="2 1 1" material="floor"/><geom size="1" material="floor"/>'
            '<geom size="1" material="gold" rgba="0 1 0 1"/><geom size="1" material="gold"/>',
            '<asset><texture name="t" type="2d" builtin="flat" rgb1="0.2 0.4 0.6" width="8" height="4"/>'
            '<material name="floor" texture="t" texrepeat="3 5" shininess="0"/>'
            '<material name="gold" rgba="1 0.8 0 1" metallic="1" roughness="0.3"/></asset>',
        ),
    )
    plane, ball, green, gold = (part.material for part in robot.parts[0])
    pixels = plane.base_color_texture.image.decode()
    assert pixels.shape == (4, 8, 4)
    assert pixels[0, 0].tolist() == pytest.approx([51, 102, 153, 255], abs=1)
    assert plane.base_color == (1.0, 1.0, 1.0, 1.0)
    assert plane.roughness == 1.0
    mesh = mesh_of(robot.parts[0][0])
    np.testing.assert_allclose(mesh.positions.max(axis=0), (2, 1, 0))
    np.testing.assert_allclose(np.ptp(mesh.uv0, axis=0), (3, 5))
    # without texture coordinates: the mean colour
    assert ball.base_color[2] == pytest.approx(linear_from_srgb(0.6), abs=0.01)
    assert green.base_color == (0.0, 1.0, 0.0, 1.0)
    assert gold.base_color == pytest.approx((1, linear_from_srgb(0.8), 0, 1))
    assert gold.metallic == 1.0
    assert gold.roughness == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("size", "attributes", "bottom_left", "top_right"),
    [
        ("2 1.5 1", 'texrepeat="3 2"', (0, 2), (3, 0)),
        ("2 1.5 1", 'texrepeat="0.5 0.25" texuniform="true"', (0, 0.375), (1, 0)),
        ("0 0 1", 'texrepeat="0.5 0.25"', (-2, 1.75), (3, -0.75)),
        ("0 0 1", 'texrepeat="0.5 0.25" texuniform="true"', (-2, 1.75), (3, -0.75)),
    ],
)
def test_texture_of_planes(
    tmp_path: Path, size: str, attributes: str, bottom_left: tuple[float, float], top_right: tuple[float, float]
) -> None:
    """As MuJoCo 4.0 draws them: upright, from a corner; on infinite planes around the origin, 2 m / texrepeat large."""
    asset = f'{CHECKER}<material name="m" texture="t" {attributes}/>'
    robot = read(tmp_path, mjcf(f'<geom type="plane" size="{size}" material="m"/>', f"<asset>{asset}</asset>"))
    mesh = mesh_of(robot.parts[0][0])
    order = mesh.positions[:, :2].sum(axis=1).argsort()
    np.testing.assert_allclose(mesh.uv0[order[[0, -1]]], (bottom_left, top_right), atol=1e-6)


@pytest.mark.parametrize(("uniform", "repeats"), [("false", (3, 2)), ("true", (1.5, 2))])
def test_texture_repeats_of_meshes(tmp_path: Path, uniform: str, repeats: tuple[float, float]) -> None:
    """As MuJoCo 4.0 draws them; "true" counts in half lengths of the inertia box, whose shortest side is its first."""
    corners = [(x, y, z) for x in (-2, 2) for y in (-1, 1) for z in (-0.5, 0.5)]
    uv = " ".join(f"{(x + 2) / 4} {(y + 1) / 2}" for x, y, _ in corners)
    faces = "0 1 3 0 3 2 4 6 7 4 7 5 0 4 5 0 5 1 2 3 7 2 7 6 0 2 6 0 6 4 1 5 7 1 7 3"
    vertices = " ".join(f"{x} {y} {z}" for x, y, z in corners)
    robot = read(
        tmp_path,
        mjcf(
            '<geom type="mesh" mesh="box" material="m"/>',
            f'<asset><mesh name="box" vertex="{vertices}" texcoord="{uv}" face="{faces}"/>'
            '<texture name="t" type="2d" builtin="flat" rgb1="1 0 0" width="8" height="8"/>'
            f'<material name="m" texture="t" texrepeat="3 2" texuniform="{uniform}"/></asset>',
        ),
    )
    mesh = mesh_of(robot.parts[0][0])
    half_lengths = np.sort(np.ptp(mesh.positions, axis=0) / 2)
    np.testing.assert_allclose(half_lengths, (0.5, 1, 2), atol=1e-6)
    np.testing.assert_allclose(np.ptp(mesh.uv0, axis=0), repeats, atol=1e-5)


def test_cube_maps_of_boxes(tmp_path: Path) -> None:
    """As MuJoCo 4.0 draws them: each face of the box shows one of the cube map's, which lie in a column.

    Other shapes show the image of the axis to which a point is nearest; so do boxes with ``texuniform``.
    """
    names = ("right", "left", "up", "down", "front", "back")
    colors = np.array([(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0), (0, 255, 255), (255, 0, 255)], np.uint8)
    for name, color in zip(names, colors, strict=True):
        image = np.full((8, 8, 3), color)
        image[0, 0] = 255  # top left
        cv2.imwrite(str(tmp_path / f"{name}.png"), image[:, :, ::-1])
    files = " ".join(f'file{name}="{name}.png"' for name in names)
    robot = read(
        tmp_path,
        mjcf(
            '<geom type="box" size="3 2 1" material="m"/><geom type="sphere" size="1" material="m"/>'
            '<geom type="box" size="3 2 1" material="u"/>',
            f'<asset><texture name="t" type="cube" {files}/><material name="m" texture="t"/>'
            '<material name="u" texture="t" texuniform="true"/></asset>',
        ),
    )
    box, sphere, uniform = robot.parts[0]
    mesh = mesh_of(box)
    pixels = box.material.base_color_texture.image.decode()
    assert pixels.shape == (48, 8, 4)
    axes = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)])
    for part in (sphere, uniform):  # the colour is that of the nearest axis
        shown = mesh_of(part)
        middles = shown.positions[shown.elements].mean(axis=1)
        rows, columns = (shown.uv0[shown.elements].mean(axis=1) * (8, 48)).astype(int).T[::-1]
        face_colors = pixels[rows, columns, :3]
        is_plain = face_colors.min(axis=1) == 0
        assert is_plain.mean() > 0.9
        assert (face_colors[is_plain] == colors[(middles @ axes.T).argmax(axis=1)][is_plain]).all()
        assert_outward(shown.positions[shown.elements], middles)
    top_left = np.array([(3, 2, 1), (-3, 2, -1), (-3, 2, -1), (-3, -2, 1), (-3, 2, 1), (3, 2, -1)])
    for axis, color, corner in zip(axes, colors, top_left, strict=True):
        face = (mesh.normals == axis).all(axis=1)
        column, row = (mesh.uv0[face].mean(axis=0) * (8, 48)).astype(int)
        assert pixels[row, column, :3].tolist() == color.tolist()
        columns, rows = (mesh.uv0[face] * (8, 48)).astype(int).T
        white = pixels[rows, columns].min(axis=1) == 255
        assert np.unique(mesh.positions[face][white], axis=0).tolist() == [corner.tolist()]
    assert_outward(mesh.positions[mesh.elements], mesh.normals[mesh.elements[:, 0]])


def test_cube_maps_of_one_image(tmp_path: Path) -> None:
    """All faces show it. Boxes of collision geometry stay boxes."""
    asset = '<texture name="t" type="cube" file="t.png"/><material name="m" texture="t"/>'
    cv2.imwrite(str(tmp_path / "t.png"), np.arange(192, dtype=np.uint8).reshape(8, 8, 3))
    content = mjcf('<geom type="box" size="3 2 1" material="m"/>', f"<asset>{asset}</asset>")
    part = read(tmp_path, content).parts[0][0]
    assert part.material.base_color_texture is not None
    uv = mesh_of(part).uv0
    np.testing.assert_allclose((uv.min(axis=0), uv.max(axis=0)), ((1 / 16, 1 / 16), (15 / 16, 15 / 16)), atol=1e-6)
    (box,) = read(tmp_path, content, geometry="collision").parts[0]
    assert box.shape == Box((6.0, 4.0, 2.0))
    assert box.material.base_color_texture is None


def test_images_on_boxes(tmp_path: Path) -> None:
    """As MuJoCo 4.0 draws them: the top left corner of the image lies at these corners."""
    asset = f'{CHECKER}<material name="m" texture="t" texrepeat="2 3"/>'
    robot = read(tmp_path, mjcf('<geom type="box" size="3 2 1" material="m"/>', f"<asset>{asset}</asset>"))
    part = robot.parts[0][0]
    assert part.material.base_color_texture is not None
    mesh = mesh_of(part)
    np.testing.assert_allclose(mesh.uv0.max(axis=0), (2, 3))
    corners = mesh.positions[(mesh.uv0 == 0).all(axis=1)]
    assert corners.tolist() == [[3, -2, 1], [-3, -2, 1], [-3, 2, 1], [-3, -2, 1], [-3, 2, 1], [-3, 2, -1]]
    assert_outward(mesh.positions[mesh.elements], mesh.normals[mesh.elements[:, 0]])


def test_meshes_keep_their_place(tmp_path: Path) -> None:
    """MuJoCo moves meshes to their centre of mass, and their geometry back."""
    write(tmp_path, TETRAHEDRON, "meshes/t.obj")
    robot = read(
        tmp_path,
        mjcf(
            '<body name="a"><geom type="mesh" mesh="t" pos="0 0 1"/></body>',
            '<compiler meshdir="meshes"/><asset><mesh file="t.obj" scale="2 2 2"/></asset>',
        ),
    )
    ((), (part,)) = robot.parts
    mesh, X = mesh_of(part), part.X_node_part
    vertices = mesh.positions @ X[:3, :3].T + X[:3, 3]
    expected = {(0, 0, 1), (2, 0, 1), (0, 2, 1), (0, 0, 3)}
    assert {tuple(row) for row in np.round(vertices, 5).tolist()} == expected
    corners = vertices[mesh.elements]
    assert_outward(corners, corners.mean(axis=1) - (0.5, 0.5, 1.5))
    assert list(robot.digests) == ["robot.xml", "meshes/t.obj"]


def test_normals_of_meshes_are_outward(tmp_path: Path) -> None:
    """MuJoCo's at corners of a box are the z axis."""
    vertices = " ".join(f"{x} {y} {z}" for x in (0, 1) for y in (0, 1) for z in (0, 1))
    mesh = f'<asset><mesh name="box" vertex="{vertices}"/></asset>'
    robot = read(tmp_path, mjcf('<body><geom type="mesh" mesh="box"/></body>', mesh))
    box = mesh_of(robot.parts[1][0])
    assert box.normals is not None
    for corner in range(3):
        assert_outward(box.positions[box.elements], box.normals[box.elements[:, corner]])


def test_joint_equality_is_a_mimic(tmp_path: Path) -> None:
    body = "".join(
        f'<body><joint name="{name}" type="slide" ref="{ref}"/><geom size="1"/></body>'
        for name, ref in (("lead", 1), ("follow", 2), ("free", 0))
    )
    robot = read(
        tmp_path,
        mjcf(
            body,
            '<equality><joint joint1="follow" joint2="lead" polycoef="0.5 2 3 0 0"/>'
            '<joint joint1="lead" joint2="follow"/><joint joint1="free" polycoef="1 0 0 0 0"/></equality>',
        ),
    )
    assert robot.joint_values({"lead": 2})["follow"] == (2 + 0.5 + 2 + 3,)
    assert robot.joint_values({})["free"] == (0.0,)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (mjcf('<geom type="cone" size="1"/>'), "MuJoCo cannot compile it: XML Error: invalid keyword: 'cone'"),
        (mjcf('<body><geom type="mesh" mesh="x"/></body>'), "MuJoCo cannot compile it: "),
        (
            mjcf(
                '<body name="arm"><geom type="mesh" mesh="x"/></body>',
                '<asset><mesh name="x" file="robot.xml" content_type="model/stl"/></asset>',
            ),
            "MuJoCo cannot compile it: ",
        ),
        ('<mujoco><include file="none.xml"/></mujoco>', "MuJoCo cannot compile it: "),
    ],
)
def test_errors_are_mujocos(tmp_path: Path, content: str, message: str) -> None:
    with pytest.raises(RobotFileError) as caught:
        read(tmp_path, content)
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / "robot.xml"))


def test_what_needs_a_missing_file_is_left_out(tmp_path: Path) -> None:
    """The body of the mesh has no other geom, so that MuJoCo needs a mass for it."""
    if version("mujoco") < "4":
        pytest.skip("MuJoCo 3 refuses a height field without its file")
    robot = read(
        tmp_path,
        mjcf(
            '<body name="arm"><joint/><geom type="mesh" mesh="no"/></body><geom type="hfield" hfield="h"/>'
            '<geom name="box" type="box" size="1 1 1" material="m"/>',
            '<asset><mesh file="no.stl"/><hfield name="h" file="no.png" size="1 1 1 1"/>'
            '<texture name="t" type="2d" file="none.png"/><material name="m" texture="t" rgba="1 0 0 1"/></asset>',
        ),
    )
    drawn = [part for parts in robot.parts for part in parts if part.material.base_color[3] > 0.0]
    assert len(drawn) == 1
    assert drawn[0].material.base_color[:3] == pytest.approx((1.0, 0.0, 0.0))
    left_out = [warning.partition(":")[0] for warning in robot.warnings]
    assert sorted(left_out) == ["asset 'h'", "asset 'no'", "asset 't'"]


def test_what_does_not_change_the_image_is_a_note(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MuJoCo would write these warnings to a file in the working directory."""
    import mujoco

    monkeypatch.chdir(tmp_path)
    body = '<body name="b"><joint/><geom size="1"/></body>'
    write(tmp_path, mjcf(body), "part.xml")
    attach = '<frame><attach model="part" body="b" prefix=""/></frame>'
    part = '<asset><model name="part" file="part.xml"/></asset>'
    robot = read(tmp_path, mjcf(attach, f'<compiler settotalmass="1"/>{part}'), strict=True)
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()
    assert any("empty prefix" in note for note in robot.notes)
    if mujoco.__version__ >= "4":  # earlier versions have nothing against it
        assert any("'settotalmass' is deprecated" in note for note in robot.notes)


def test_included_files_are_recorded(tmp_path: Path) -> None:
    write(tmp_path, "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>", "part.xml")
    robot = read(tmp_path, '<mujoco><include file="part.xml"/></mujoco>')
    assert list(robot.digests) == ["robot.xml", "part.xml"]
    assert [part.shape for part in robot.parts[0]] == [Sphere(1.0)]


def test_elements_of_included_files_are_limited(tmp_path: Path) -> None:
    write(tmp_path, "<mujoco><worldbody><geom size='1'/><include file='part.xml'/></worldbody></mujoco>", "part.xml")
    document = '<mujoco><include file="part.xml"/><include file="part.xml"/></mujoco>'
    with pytest.raises(RobotFileError, match="6 XML elements"):
        read(tmp_path, document, limits=RobotLimits(max_elements=6))
    with pytest.raises(RobotFileError, match=r"MuJoCo cannot compile it: .*already included"):  # each is read once
        read(tmp_path, document, limits=RobotLimits(max_elements=7))


def test_limits(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match="it has 2 geometries, the limit is 1"):
        read(tmp_path, mjcf('<geom size="1"/><geom size="1"/>'), limits=RobotLimits(max_geometries=1))
    field = '<asset><hfield name="h" nrow="20" ncol="10" size="1 1 1 1"/></asset>'
    limits = RobotLimits(mesh=GltfLimits(max_vertices=199))
    with pytest.raises(RobotFileError, match="it has 200 vertices, the limit is 199"):
        read(tmp_path, mjcf('<geom type="hfield" hfield="h"/>', field), limits=limits)


def test_height_fields(tmp_path: Path) -> None:
    """MuJoCo scales heights to 0 to 1 of the size's third number; the file's first row is the one of the largest y."""
    field = '<hfield name="h" nrow="2" ncol="3" size="3 2 0.5 0.1" elevation="0 0 4  1 2 3"/>'
    image = '<texture name="t" type="2d" builtin="flat" width="4" height="4"/><material name="m" texture="t"/>'
    geom = '<geom type="hfield" hfield="h" pos="0 0 1" material="m"/>'
    robot = read(tmp_path, mjcf(geom + geom, f"<asset>{field}{image}</asset>"))
    ((part, same),) = robot.parts
    mesh = mesh_of(part)
    assert mesh_of(same) is mesh
    expected = [(-3, -2, 0.125), (0, -2, 0.25), (3, -2, 0.375), (-3, 2, 0), (0, 2, 0), (3, 2, 0.5)]
    np.testing.assert_allclose(mesh.positions, expected)
    np.testing.assert_allclose(mesh.uv0[[0, -1]], [(0, 1), (1, 0)])
    assert part.X_node_part[2, 3] == 1.0
    assert robot.warnings == ()


@pytest.mark.parametrize(
    "size", ['size="1 1 inf 1"', 'size="1 1 1 1" elevation="0 inf 0 1"'], ids=["infinite size", "infinite height"]
)
def test_height_fields_without_finite_heights_are_not_shown(tmp_path: Path, size: str) -> None:
    field = f'<asset><hfield name="h" nrow="2" ncol="2" {size}/></asset>'
    robot = read(tmp_path, mjcf('<geom type="hfield" hfield="h"/><geom size="1"/>', field))
    assert [part.shape for part in robot.parts[0]] == [Sphere(1.0)]
    assert len(robot.warnings) == 1


def test_vertices_of_textures_that_repeat_are_limited(tmp_path: Path) -> None:
    """Each way of repeating has its own texture coordinates."""
    count = 4
    assets = '<hfield name="h" nrow="2" ncol="3" size="1 1 1 1" elevation="0 0 4  1 2 3"/>'
    assets += '<texture name="t" type="2d" builtin="flat" width="4" height="4"/>'
    assets += "".join(f'<material name="m{k}" texture="t" texrepeat="{k + 2} 1"/>' for k in range(count))
    geoms = "".join(f'<geom type="hfield" hfield="h" material="m{k}"/>' for k in range(count))
    content = mjcf(geoms, f"<asset>{assets}</asset>")
    assert len(read(tmp_path, content, limits=RobotLimits(mesh=GltfLimits(max_vertices=24))).parts[0]) == count
    with pytest.raises(RobotFileError, match="vertices"):
        read(tmp_path, content, limits=RobotLimits(mesh=GltfLimits(max_vertices=23)))


def test_urdf_in_a_file_called_xml(tmp_path: Path) -> None:
    write(tmp_path, TRIANGLE, "m.obj")
    assert read(tmp_path, '<robot name="r"><link name="a"/></robot>').links == ("a",)


def test_without_mujoco_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ImportError, match=r"mujoco .*'scenegate\[robots\]'"):
        read(tmp_path, mjcf(""))


HEIGHT_FIELD = '<asset><hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/></asset>'
HUGE_TEXTURE = '<asset><texture name="t" type="2d" builtin="checker" width="100000" height="100000"/></asset>'


@pytest.mark.skipif(sys.platform != "linux", reason="the memory of a process is limited on Linux only")
@pytest.mark.parametrize("content", [HEIGHT_FIELD, HUGE_TEXTURE, '<size memory="1000G"/>'])
def test_memory_of_the_compiler_is_limited(tmp_path: Path, content: str) -> None:
    with pytest.raises(RobotFileError) as caught:
        read(tmp_path, mjcf('<body><freejoint/><geom size="1"/></body>', content))
    assert str(caught.value) == (
        f"{tmp_path / 'robot.xml'}: MuJoCo cannot compile it: it needs more than max_compiler_bytes = 8589934592 of "
        "memory, or crashes"
    )


def test_time_of_the_compiler_is_limited(tmp_path: Path) -> None:
    content = '<geom size="1"/>'
    for axis in ("1 0 0", "0 1 0", "0 0 1"):
        content = f'<replicate count="1000" offset="{axis}">{content}</replicate>'
    with pytest.raises(RobotFileError, match=r"robot\.xml: .*max_compiler_seconds = 1$"):
        read(tmp_path, mjcf(content), limits=RobotLimits(max_compiler_seconds=1))


def test_a_pipe_as_a_mesh_does_not_block(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.stl")
    for assets in ('<mesh name="m" file="pipe.stl"/>', '<texture name="t" type="cube" fileup="pipe.stl"/>'):
        with pytest.raises(RobotFileError, match=r"pipe.stl is not a regular file$"):
            read(tmp_path, mjcf('<geom size="1"/>', f"<asset>{assets}</asset>"))
    with pytest.raises(RobotFileError, match=r"pipe.stl is not a regular file$"):
        read(tmp_path, mjcf('<geom size="1"/>', '<include file="pipe.stl"/>'))


def test_size_of_the_model_is_limited(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match=r"\d+ bytes, .*max_model_bytes = 100"):
        read(tmp_path, mjcf('<geom size="1"/>'), limits=RobotLimits(max_model_bytes=100))


def test_a_stop_flag_ends_the_compiler(tmp_path: Path) -> None:
    flag = StopFlag()
    flag.set(RuntimeError("late"))
    with pytest.raises(RuntimeError, match="late"):
        flag.run(lambda: read(tmp_path, mjcf('<geom size="1"/>')))


def test_poses_that_are_no_numbers(tmp_path: Path) -> None:
    robot = read(tmp_path, mjcf('<body name="a" pos="nan 0 0"><geom size="1"/></body>'))
    with pytest.raises(RobotFileError, match="the pose of the link 'a' is not finite"):
        robot.link_poses({})


def test_a_keyframe_has_the_joint_values(tmp_path: Path) -> None:
    body = '<body name="a"><joint name="turn"/><geom size="1"/></body>'
    keys = '<keyframe><key name="home" qpos="0.5"/><key qpos="1"/></keyframe>'
    content = mjcf(body, "<compiler angle='radian'/>").replace("</mujoco>", f"{keys}</mujoco>")
    assert read(tmp_path, content, keyframe="home").joints["turn"].default == (0.5,)
    assert read(tmp_path, content).joints["turn"].default == (0.0,)
    with pytest.raises(RobotFileError, match="it has no keyframe 'hom'; did you mean home"):
        read(tmp_path, content, keyframe="hom")


CABLE = """<composite type="cable" curve="s" count="5 1 1" size="1" initial="none">
<joint kind="main"/><geom type="capsule" size="0.01"/></composite>"""
CLOTH = '<flexcomp name="f" type="grid" count="3 3 1" spacing="1 1 1" dim="2">{}</flexcomp>'


@pytest.mark.parametrize(
    "content",
    [
        mjcf(f'<body name="a">{CABLE}</body>'),
        mjcf('<geom size="1"/>', '<extension><plugin plugin="mujoco.elasticity.cable"/></extension>'),
        mjcf(CLOTH.format(""), '<equality><flexvert flex="f"/></equality>'),
        mjcf(CLOTH.format('<edge equality="vert"/>')),
        mjcf(CLOTH.format('<contact internal="true"/>')),
    ],
)
def test_an_error_of_what_mujoco_3_reads_says_so(tmp_path: Path, content: str) -> None:
    if version("mujoco") < "4":
        assert read(tmp_path, content).links
        return
    with pytest.raises(RobotFileError, match="mujoco<4"):
        read(tmp_path, content)


def test_what_mujoco_3_refuses_too_has_no_hint_at_it(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match="global coordinates no longer supported") as error:
        read(tmp_path, mjcf('<geom size="1"/>', '<compiler coordinate="global"/>'))
    assert "mujoco<4" not in str(error.value)


def test_tendons_that_mujoco_shows_are_a_warning(tmp_path: Path) -> None:
    """A fixed tendon has no shape, and the viewer hides those of group 3."""
    ends = '<site site="a"/><site site="b"/></spatial>'
    tendons = f'<tendon><spatial>{ends}<spatial group="3">{ends}<fixed><joint joint="j" coef="1"/></fixed></tendon>'
    body = '<site name="a"/><body pos="0 0 1"><joint name="j"/><geom size="0.1"/><site name="b"/></body>'
    assert read(tmp_path, mjcf(body, tendons)).warnings == ("1 spatial tendons are not shown",)


@pytest.mark.skipif(version("mujoco") < "4", reason="it is an error, or bodies cannot sleep")
def test_warnings_of_the_first_state_are_not_logged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A body that shall sleep touches one that is awake. Later warnings of other models are MuJoCo's own again."""
    import mujoco

    mujoco.set_mju_user_warning(None)  # the simulation of objects at rest leaves its own
    monkeypatch.chdir(tmp_path)
    body = '<body {}><freejoint/><geom size="1"/></body>'
    bodies = body.format('sleep="init"') + body.format('pos="0 0 1"')
    assert read(tmp_path, mjcf(bodies, '<option><flag sleep="enable"/></option>')).links == (
        "world",
        "body_1",
        "body_2",
    )
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()
    assert mujoco.get_mju_user_warning() is None


def test_pixels_of_a_texture_are_searched_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A capsule has the mean colour of its texture: 300 of them with a cube map of 800 x 4800 pixels took 28 s."""
    means: list[object] = []

    def mean_color(image: object) -> tuple[float, float, float]:
        means.append(image)
        return 0.0, 1.0, 0.0

    monkeypatch.setattr("gateway.files.robots.mjcf_materials.mean_color", mean_color)
    capsules = '<geom type="capsule" size="1 1" material="m"/>' * 3
    (parts,) = read(tmp_path, mjcf(capsules, f'<asset>{CHECKER}<material name="m" texture="t"/></asset>')).parts
    assert [part.material.base_color[:3] for part in parts] == [(0.0, 1.0, 0.0)] * 3
    assert len(means) == 1
