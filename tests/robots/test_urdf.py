"""Links, joints, geometry and materials of URDF, and errors of files that are no good."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from gateway.robots.errors import RobotFileError
from gateway.robots.limits import RobotLimits
from gateway.robots.reader import read_robot
from gateway.scene.geometry import Box, Capsule, Cylinder, Shape, Sphere
from renderers.color import linear_from_srgb
from renderers.drawlist import AlphaMode
from tests.robots.files import ARM, link, read, visual, write


def joint(kind: str, content: str = "", ends: str = '<parent link="a"/><child link="b"/>') -> str:
    return (
        f'<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="{kind}">{ends}{content}</joint></robot>'
    )


def test_links_joints_and_geometry(tmp_path: Path) -> None:
    robot = read(tmp_path, ARM)
    assert robot.name == "arm"
    assert robot.links == ("base", "upper", "hand", "finger", "tool")
    assert {name: (joint.kind, joint.limits) for name, joint in robot.joints.items()} == {
        "shoulder": ("revolute", (-1.0, 2.0)),
        "elbow": ("revolute", None),
        "grip": ("prismatic", None),
    }
    (base,), (upper,), *others = robot.parts
    assert others == [(), (), ()]
    assert base.shape == Box((0.4, 0.4, 0.1))
    assert base.material.base_color == pytest.approx((1, 0, 0, 0.5))
    assert base.material.alpha_mode is AlphaMode.BLEND
    assert upper.shape == Cylinder(0.05, 1.0)
    assert upper.material.base_color[0] == pytest.approx(linear_from_srgb(0.9))
    np.testing.assert_allclose(upper.X_node_part[:3, 3], (0, 0, 0.5))


def test_collision_geometry_is_read_on_request(tmp_path: Path) -> None:
    robot = read_robot(write(tmp_path, ARM), geometry="collision")
    assert [[part.shape for part in parts] for parts in robot.parts] == [[], [Sphere(0.2)], [], [], []]


def test_a_robot_without_a_name_has_that_of_its_file(tmp_path: Path) -> None:
    assert read_robot(write(tmp_path, '<robot><link name="a"/></robot>', "wheel.urdf")).name == "wheel"


@pytest.mark.parametrize(
    ("geometry", "shape"),
    [
        ('<sphere radius="2"/>', Sphere(2.0)),
        ('<capsule radius="1" length="3"/>', Capsule(1.0, 3.0)),
        ('<!-- size --> <box size=" 1  2 3 "/>', Box((1.0, 2.0, 3.0))),
    ],
)
def test_shapes(tmp_path: Path, geometry: str, shape: Shape) -> None:
    ((part,),) = read(tmp_path, visual(geometry)).parts
    assert part.shape == shape


def test_a_material_may_be_defined_in_another_link(tmp_path: Path) -> None:
    box = '<geometry><box size="1 1 1"/></geometry>'
    robot = read(
        tmp_path,
        f'<robot name="r"><link name="a"><visual>{box}<material name="green"/></visual></link>'
        f'<link name="b"><visual>{box}<material name="green"><color rgba="0 1 0 1"/></material></visual></link>'
        "</robot>",
    )
    for (part,) in robot.parts:
        assert part.material.base_color == (0, 1, 0, 1)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("<robot", "it is not XML: "),
        ("<!DOCTYPE a><robot/>", "XML with a DOCTYPE is refused"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><robot name="&b;"/>', "XML with a DOCTYPE is refused"),
        ("<sdf/>", "its first element is <sdf>; URDF starts with <robot>, MJCF with <mujoco>"),
        ("<robot/>", "it has no links"),
        ('<robot xmlns:x="http://www.ros.org/wiki/xacro"><x:macro/></robot>', "expand it first"),
        ("<robot><link/></robot>", "a link: <link> has no name"),
        ('<robot><link name="a"/><link name="a"/></robot>', "two links are called 'a'"),
        (link("<visual/>"), "link 'a', visual: <geometry> must have one shape, not 0"),
        (visual('<box size="1 1 1"/><sphere radius="1"/>'), "must have one shape, not 2"),
        (visual("<cone/>"), "link 'a', visual: the shape <cone> is none of box, sphere,"),
        (visual("<box/>"), "link 'a', visual: <box> has no size"),
        (visual('<box size="1 1"/>'), "size='1 1' of <box> must be 3 finite numbers"),
        (visual('<sphere radius="-1"/>'), "radius='-1' of <sphere> must be a number above 0"),
        (visual('<sphere radius="nan"/>'), "radius='nan' of <sphere> must be a number above 0"),
        (visual('<sphere radius="1"/>', '<origin xyz="0 0 inf"/>'), "xyz='0 0 inf' of <origin> must be 3 finite"),
        (visual("<mesh/>"), "link 'a', visual: <mesh> has no filename"),
        (joint("screw"), "joint 'j': its type 'screw' is none of revolute, continuous,"),
        (joint("fixed", ends='<parent link="a"/>'), "joint 'j' has no <child>"),
        (joint("fixed", ends='<parent link="a"/><child link="bb"/>'), "there is no link 'bb'; did you mean b?"),
        (joint("revolute", '<axis xyz="0 0 0"/>'), "joint 'j': its axis is zero"),
        (joint("revolute", '<axis xyz="1.7e308 1.7e308 0"/>'), "joint 'j': its axis is too long"),
        (joint("revolute", '<mimic joint="k"/>'), "joint 'j' mimics 'k', which is not a joint that moves"),
        (joint("revolute", '<mimic joint="j"/>'), "the joints j mimic each other in a circle"),
        (joint("floating", '<mimic joint="j"/>'), "joint 'j' cannot mimic 'j': one has several values"),
        (joint("fixed", ends='<parent link="a"/><child link="a"/>'), "the joints j form a circle"),
    ],
)
def test_errors_say_where_and_why(tmp_path: Path, content: str, message: str) -> None:
    path = write(tmp_path, content)
    with pytest.raises(RobotFileError) as caught:
        read_robot(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)


def test_a_circle_and_two_parents_are_named(tmp_path: Path) -> None:
    links = "".join(f'<link name="{name}"/>' for name in "abc")

    def fixed(name: str, parent: str, child: str) -> str:
        return f'<joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/></joint>'

    circle = fixed("j", "a", "b") + fixed("k", "b", "c") + fixed("l", "c", "a")
    with pytest.raises(RobotFileError, match="the joints j, k, l form a circle: the links must be a tree"):
        read(tmp_path, f"<robot>{links}{circle}</robot>")
    with pytest.raises(RobotFileError, match="link 'c' is the child of two joints, 'j' and 'k'"):
        read(tmp_path, f"<robot>{links}{fixed('j', 'a', 'c')}{fixed('k', 'b', 'c')}</robot>")


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (RobotLimits(max_links=4), "it has 5 links, the limit is 4"),
        (RobotLimits(max_elements=5), "it has more than 5 XML elements, which is the limit"),
        (RobotLimits(max_attribute_chars=10), r"size='0.4 0.4 0.1'\.\.\. of <box> has 11 characters, the limit is 10"),
        (RobotLimits(max_geometries=2), "it has 3 geometries, the limit is 2"),
        (RobotLimits(max_file_bytes=10), r"robot.urdf has more than 10 bytes, the remaining limit"),
    ],
)
def test_limits(tmp_path: Path, limits: RobotLimits, message: str) -> None:
    with pytest.raises(RobotFileError, match=message):
        read_robot(write(tmp_path, ARM), limits=limits)


def test_missing_files_and_xacro(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match=r"none.urdf cannot be read: No such file"):
        read_robot(tmp_path / "none.urdf")
    with pytest.raises(RobotFileError, match="xacro files must be expanded first"):
        read_robot(write(tmp_path, ARM, "arm.xacro"))


def test_poses_are_products_of_the_joints(tmp_path: Path) -> None:
    robot = read(tmp_path, ARM)
    q1, q2 = 0.7, -0.4
    poses = dict(zip(robot.links, robot.link_poses({"shoulder": q1, "elbow": q2}), strict=True))

    def rotation(axis: int, angle: float) -> np.ndarray:
        X, (i, j) = np.eye(4), [(1, 2), (2, 0), (0, 1)][axis]
        X[i, i] = X[j, j] = math.cos(angle)
        X[j, i], X[i, j] = math.sin(angle), -math.sin(angle)
        return X

    def moved(*xyz: float) -> np.ndarray:
        X = np.eye(4)
        X[:3, 3] = xyz
        return X

    upper = moved(0, 0, 0.05) @ rotation(1, q1)
    hand = upper @ moved(0, 0, 1) @ rotation(2, 0.3) @ rotation(1, 0.2) @ rotation(0, 0.1) @ rotation(0, q2)
    expected = {
        "base": np.eye(4),
        "upper": upper,
        "hand": hand,
        "finger": hand @ moved(0, 0.1 + 0.5 * q2, 0),
        "tool": hand @ moved(0.1, 0, 0),
    }
    for name, X in expected.items():
        np.testing.assert_allclose(poses[name], X, atol=1e-15)


def test_joints_with_several_values(tmp_path: Path) -> None:
    robot = read(tmp_path, joint("floating", '<origin xyz="1 0 0"/>'))
    _, X = robot.link_poses({"j": (0, 2, 3, 0, 0, 0, 2)})
    np.testing.assert_allclose(X, [[-1, 0, 0, 1], [0, -1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    robot = read(tmp_path, joint("planar", '<axis xyz="0 0 1"/>'))
    _, X = robot.link_poses({"j": (1, 2, math.pi / 2)})
    np.testing.assert_allclose(X, [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1]], atol=1e-15)


def test_a_long_axis_is_normalised(tmp_path: Path) -> None:
    robot = read(tmp_path, joint("revolute", '<axis xyz="0 0 1e200"/>'))
    np.testing.assert_allclose(robot.link_poses({"j": 0.5})[1][:2, 0], (np.cos(0.5), np.sin(0.5)))


def test_long_names_are_refused_and_not_repeated(tmp_path: Path) -> None:
    """The hint at similar names would compare them for minutes."""
    with pytest.raises(RobotFileError, match="of <link> has 5000 characters, the limit is 4096") as caught:
        read(tmp_path, f'<robot><link name="{"a" * 5000}"/></robot>')
    assert len(str(caught.value).removeprefix(str(tmp_path))) < 200
    names = [f"{number}{'a' * 4000}" for number in range(3)]
    links = "".join(f'<link name="{name}"/>' for name in names)
    ends = f'<parent link="{"a" * 4000}"/><child link="{names[0]}"/>'
    with pytest.raises(RobotFileError, match="there is no link") as caught:
        read(tmp_path, f'<robot>{links}<joint name="j" type="fixed">{ends}</joint></robot>')
    assert "did you mean" not in str(caught.value)
