"""Links, joints, geometry and materials of URDF, and errors of files that are no good."""

import math
from pathlib import Path

import numpy as np
import pytest

from gateway.files.robots.reader import read_robot
from gateway.files.robots.robot import RobotLimits
from gateway.scene.tree.geometry import Shape
from renderers.color import linear_from_srgb
from renderers.drawlist import AlphaMode
from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere
from scenegate.robots.robot import JointValue
from scenegate.robots.robot_errors import RobotFileError
from scenegate.robots.robot_reader import read_robot as read_robot_of_client
from scenegate.robots.xml_text import pose_of_rpy
from tests.files.robots.files import ARM, link, read, visual, write


def joint(kind: str, content: str = "", ends: str = '<parent link="a"/><child link="b"/>') -> str:
    return (
        f'<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="{kind}">{ends}{content}</joint></robot>'
    )


def shape(content: str) -> str:
    return f"<visual><geometry>{content}</geometry></visual>"


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
    with pytest.raises(ValueError, match=r"'visual' or 'collision'.* 'visal'"):
        read_robot(tmp_path / "robot.urdf", geometry="visal")  # type: ignore[arg-type]  # refused at run time


def test_a_robot_without_visual_geometry_has_its_collision_geometry(tmp_path: Path) -> None:
    path = write(tmp_path, ARM.replace("<visual>", "<ignored>").replace("</visual>", "</ignored>"))
    for robot in read_robot(path), read_robot_of_client(path):
        assert [len(parts) for parts in robot.parts] == [0, 1, 0, 0, 0]
        assert ["collision" in note for note in robot.notes] == [True]
        assert not robot.warnings


def test_a_robot_without_a_name_has_that_of_its_file(tmp_path: Path) -> None:
    assert read_robot(write(tmp_path, '<robot><link name="a"/></robot>', "wheel.urdf")).name == "wheel"


@pytest.mark.parametrize(
    ("geometry", "shape"),
    [
        ('<sphere radius="2"/>', Sphere(2.0)),
        ('<capsule radius="1" length="3"/>', Capsule(1.0, 3.0)),
        ('<drake:capsule radius="1" length="3"/>', Capsule(1.0, 3.0)),
        ('<drake:ellipsoid a="1" b="2" c="3"/>', Ellipsoid((1.0, 2.0, 3.0))),
        ('<ellipsoid radii="1 2 3"/>', Ellipsoid((1.0, 2.0, 3.0))),
        ('<!-- size --> <box size=" 1  2 3 "/>', Box((1.0, 2.0, 3.0))),
    ],
)
def test_shapes(tmp_path: Path, geometry: str, shape: Shape) -> None:
    ((part,),) = read(tmp_path, visual(geometry)).parts
    assert part.shape == shape


def two_links(*materials: str) -> str:
    """A robot of two links that show a box of a green material, and the ends of its elements."""
    box = '<visual><geometry><box size="1 1 1"/></geometry><material name="green"'
    links = (f'<link name="{name}">{box}{end}</visual></link>' for name, end in zip("ab", materials, strict=True))
    return f'<robot name="r">{"".join(links)}</robot>'


def test_undefined_materials_are_reported_once(tmp_path: Path) -> None:
    robot = read(tmp_path, two_links("/>", "/>"))
    assert robot.warnings == ("link 'a', visual: material 'green' is not defined; what has it is grey",)


def test_a_material_may_be_defined_in_another_link(tmp_path: Path) -> None:
    robot = read(tmp_path, two_links("/>", '><color rgba="0 1 0 1"/></material>'))
    assert [part.material.base_color for (part,) in robot.parts] == [(0, 1, 0, 1)] * 2


@pytest.mark.parametrize("content", [joint("spherical"), joint("ball").replace("joint", "drake:joint")])
def test_ball_joints_of_pybullet_and_drake(tmp_path: Path, content: str) -> None:
    robot = read(tmp_path, content)
    assert robot.joints["j"].kind == "ball"
    X_world_b = robot.link_poses({"j": (0.0, 1.0, 0.0, 0.0)})[1]
    np.testing.assert_allclose(X_world_b, np.diag((1, -1, -1, 1)), atol=1e-12)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("<robot", "it is not XML: "),
        ('<!DOCTYPE a [<!ENTITY b "c">]><robot name="&b;"/>', "it declares the XML entity 'b'"),
        ("<a>" * 10_001, "its XML has more than 10000 levels"),
        ("<a/>", "its first element is <a>; URDF starts with <robot>, SDF with <sdf>, MJCF with <mujoco>"),
        ("<robot/>", "it has no links"),
        ("<robot><link/></robot>", "it has no links: "),
        (joint("fixed", ends='<parent link="a"/><child link="a"/>'), "the joints j form a circle"),
    ],
)
def test_errors_say_where_and_why(tmp_path: Path, content: str, message: str) -> None:
    path = write(tmp_path, content)
    with pytest.raises(RobotFileError) as caught:
        read_robot(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)


BOX = '<visual><geometry><box size="1 2 3"/></geometry></visual>'


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("<visual/>", "link 'a', visual 1: it has no shape; it is not shown"),
        ("<visual><geometry/></visual>", "link 'a', visual 1: it has no shape"),
        (shape("<cone/>"), "the shape <cone> is not supported; it is not shown"),
        (shape("<box/>"), "link 'a', visual 1: <box> has no size; it is not shown"),
        (shape('<box size="1 1"/>'), "size='1 1' of <box> must be 3 finite numbers; it is not shown"),
        (shape('<box size="1 -1 1"/>'), "size='1 -1 1' of <box> must be above 0; it is not shown"),
        (shape('<sphere radius="-1"/>'), "radius='-1' of <sphere> must be above 0; it is not shown"),
        (shape('<sphere radius="nan"/>'), "radius='nan' of <sphere> must be a finite number; it is not shown"),
        (shape('<cylinder radius="1" length="$(env l)"/>'), "length='$(env l)' of <cylinder> must be a finite number"),
        (shape('<ellipsoid radii="1 0 1"/>'), "radii='1 0 1' of <ellipsoid> must be above 0"),
        (shape("<mesh/>"), "link 'a', visual 1: <mesh> has no filename; it is not shown"),
    ],
)
def test_geometry_that_cannot_be_drawn_is_left_out_with_a_warning(tmp_path: Path, content: str, message: str) -> None:
    robot = read(tmp_path, link(content + BOX))
    assert [part.shape for part in robot.parts[0]] == [Box((1.0, 2.0, 3.0))]
    (warning,) = robot.warnings
    assert message in warning
    with pytest.raises(RobotFileError, match="link 'a', visual 1: "):
        read_robot(tmp_path / "robot.urdf", strict=True)


def test_each_visual_without_a_shape_has_its_warning(tmp_path: Path) -> None:
    robot = read(tmp_path, link('<visual/><visual name="lamp"/><visual/>' + BOX))
    names = [warning.partition(":")[0] for warning in robot.warnings]
    assert names == ["link 'a', visual 1", "link 'a', visual 'lamp'", "link 'a', visual 3"]


@pytest.mark.parametrize(
    ("content", "expected", "message"),
    [
        ('<box size="1,2, 3"/>', Box((1.0, 2.0, 3.0)), "size='1,2, 3' of <box> has commas, which are read as spaces"),
        ('<box size="1 2 3 4"/>', Box((1.0, 2.0, 3.0)), "has 4 numbers, the first 3 are used"),
        ('<box size="1 1 1"/><sphere radius="1"/>', Box((1.0, 1.0, 1.0)), "only the first, <box>, is shown"),
    ],
)
def test_shapes_that_are_mended_have_a_warning(tmp_path: Path, content: str, expected: Shape, message: str) -> None:
    robot = read(tmp_path, visual(content))
    assert [part.shape for part in robot.parts[0]] == [expected]
    assert message in robot.warnings[0]


def test_an_invalid_pose_is_the_identity(tmp_path: Path) -> None:
    robot = read(tmp_path, visual('<sphere radius="1"/>', '<origin xyz="0 0 inf" rpy=""/>'))
    np.testing.assert_array_equal(robot.parts[0][0].X_node_part, np.eye(4))
    assert [text.partition(": ")[2] for text in robot.warnings] == [
        "rpy='' of <origin> must be 3 finite numbers, 0 0 0 are used",
        "xyz='0 0 inf' of <origin> must be 3 finite numbers, 0 0 0 are used",
    ]


@pytest.mark.parametrize(
    ("rgba", "expected", "message"),
    [
        ("1 0 0", (1, 0, 0, 1), "has 3 numbers: the first 3 are used, with the opacity 1"),
        ("1 0 0 0 1", (1, 0, 0, 1), "has 5 numbers: the first 3 are used, with the opacity 1"),
        ("1,0,0,1", (1, 0, 0, 1), "has commas"),
        ("255 0 0 255", (1, 0, 0, 1), "is read as 0 to 255"),
        ("255 0 0 1", (1, 0, 0, 1), "is read as 0 to 255"),
        ("1.5 0 -0.5 1", (1, 0, 0, 1), "is clamped to 0 to 1"),
        ("red", (1, 1, 1, 1), "must be 4 finite numbers, 1 1 1 1 are used"),
    ],
)
def test_colours_that_are_mended_have_a_warning(
    tmp_path: Path, rgba: str, expected: tuple[float, ...], message: str
) -> None:
    material = f'<material name="m"><color rgba="{rgba}"/></material>'
    robot = read(tmp_path, visual('<sphere radius="1"/>', material))
    assert robot.parts[0][0].material.base_color == pytest.approx(expected)
    (warning,) = robot.warnings
    assert warning.startswith("material 'm': ")
    assert message in warning


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            joint("gearbox"),
            "joint 'j': type='gearbox' is not one of revolute, continuous, prismatic, planar, floating,",
        ),
        (joint("gearbox2").replace("joint", "drake:joint"), "joint 'j': type='gearbox2' is not one of "),
        (joint("revolute", '<axis xyz="0 0 0"/>'), "joint 'j': its axis is zero; the joint stays at rest"),
        (joint("revolute", '<axis xyz="1.7e308 1.7e308 0"/>'), "joint 'j': its axis is too long"),
        (joint("fixed", ends='<parent link="a"/>'), "joint 'j': it has no <child link>; the joint is left out"),
        (joint("fixed", ends='<parent link="a"/><child link="bb"/>'), "there is no link 'bb'; did you mean b?; the"),
    ],
)
def test_joints_that_cannot_move_stay_at_rest(tmp_path: Path, content: str, message: str) -> None:
    robot = read(tmp_path, content)
    assert robot.joints == {}
    np.testing.assert_array_equal(robot.link_poses({})[1], np.eye(4))
    (warning,) = robot.warnings
    assert message in warning


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (joint("revolute", '<mimic joint="k"/>'), "joint 'j': it mimics 'k', which is not a joint that moves"),
        (joint("revolute", '<mimic joint="j"/>'), "joint 'j': the joints j mimic each other in a circle; it does not"),
        (joint("floating", '<mimic joint="j"/>'), "joint 'j': it cannot mimic 'j', as one of them has several values"),
    ],
)
def test_joints_that_cannot_follow_move_by_themselves(tmp_path: Path, content: str, message: str) -> None:
    robot = read(tmp_path, content)
    assert robot.joints["j"].mimic is None
    assert message in robot.warnings[0]


def test_joints_without_a_name_or_with_that_of_another_get_one(tmp_path: Path) -> None:
    turn = joint("continuous", ends='<parent link="a"/><child link="b"/>').replace("</robot>", "")
    second = '<link name="c"/><joint name="j" type="continuous"><parent link="b"/><child link="c"/></joint>'
    third = '<link name="d"/><joint type="continuous"><parent link="c"/><child link="d"/></joint></robot>'
    robot = read(tmp_path, turn + second + third)
    assert list(robot.joints) == ["j", "j_", "joint_2"]
    assert [text.partition(",")[0] for text in robot.warnings] == [
        "joint 'j': a second joint has this name",
        "joint 2: it has no name",
    ]


def test_geometry_that_is_not_shown_gives_no_warning(tmp_path: Path) -> None:
    write(tmp_path, link("<collision><geometry><plane/></geometry></collision>" + BOX))
    assert read_robot(tmp_path / "robot.urdf").warnings == ()
    assert "the shape <plane> is not supported" in read_robot(tmp_path / "robot.urdf", geometry="collision").warnings[0]


COMMENTS = "comments before its declaration, with -- inside or in another encoding, which XML forbids, are ignored"


@pytest.mark.parametrize(
    ("content", "links", "warnings"),
    [
        ("\n  <?xml version='1.0'?><robot><link name='a'/></robot>", "a", ()),
        ("<!DOCTYPE robot><robot><link name='a'/></robot>", "a", ()),
        ("<robot xmlns='http://www.ros.org/urdf'><link name='a'/></robot>", "a", ()),
        ("<robot><link name='a'/><sensor:camera x:y='1'/></robot>", "a", ()),
        ("<robot><!-- a -- b --><link name='a'/><!-----></robot>", "a", (COMMENTS,)),
        ("<!-- made by -- a program --><?xml version='1.0'?><robot><link name='a'/></robot>", "a", (COMMENTS,)),
        ('<?xml version="1.0" encoding="utf-16"?><robot><link name="a"/></robot>'.encode("utf-16"), "a", ()),
        (
            '<robot name="r"><!-- Größe --><link name="ü"/></robot>'.encode("latin-1"),
            "ü",
            ("it is not in the encoding that it names; it is read as Latin-1",),
        ),
        ("<robot><link/><link name='a'/></robot>", "a", ("a <link> has no name, it is left out",)),
        (
            "<robot><link name='a'/><link name='b'/><link name='a'/></robot>",
            "ab",
            ("a second link is called 'a', it is left out",),
        ),
    ],
)
def test_xml_as_people_write_it(tmp_path: Path, content: str | bytes, links: str, warnings: tuple[str, ...]) -> None:
    robot = read(tmp_path, content)
    assert robot.links == tuple(links)
    assert robot.warnings == warnings


def test_the_world_needs_no_link(tmp_path: Path) -> None:
    """As in Drake, whose own robots have a joint to it."""
    joint = '<joint name="j" type="revolute"><parent link="world"/><child link="a"/><origin xyz="0 0 2"/></joint>'
    robot = read(tmp_path, f'<robot><link name="a"/>{joint}</robot>')
    assert (robot.links, [*robot.joints], robot.warnings) == (("a", "world"), ["j"], ())
    assert robot.link_poses({})[0, 2, 3] == 2.0


def test_a_circle_and_two_parents_are_named(tmp_path: Path) -> None:
    links = "".join(f'<link name="{name}"/>' for name in "abc")

    def fixed(name: str, parent: str, child: str) -> str:
        return f'<joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/></joint>'

    circle = fixed("j", "a", "b") + fixed("k", "b", "c") + fixed("l", "c", "a")
    with pytest.raises(RobotFileError, match=r"joints j, k, l .*circle"):
        read(tmp_path, f"<robot>{links}{circle}</robot>")
    with pytest.raises(RobotFileError, match=r"link 'c' .*'j' and 'k'"):
        read(tmp_path, f"<robot>{links}{fixed('j', 'a', 'c')}{fixed('k', 'b', 'c')}</robot>")


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (RobotLimits(max_links=4), "it has 5 links, the limit is 4"),
        (RobotLimits(max_elements=5), "it has more than 5 XML elements, which is the limit"),
        (RobotLimits(max_attribute_chars=10), r"size='0.4 0.4 0.1'\.\.\. of <box> has 11 characters, the limit is 10"),
        (RobotLimits(max_geometries=1), "it has 2 geometries, the limit is 1"),
        (RobotLimits(max_file_bytes=10), r"robot.urdf has more than 10 bytes, the remaining limit"),
    ],
)
def test_limits(tmp_path: Path, limits: RobotLimits, message: str) -> None:
    with pytest.raises(RobotFileError, match=message):
        read_robot(write(tmp_path, ARM), limits=limits)


def test_only_mjcf_files_have_keyframes(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match="only MJCF files have keyframes"):
        read_robot(write(tmp_path, ARM), keyframe="home")


def test_missing_files(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match=r"none.urdf: No such file"):
        read_robot(tmp_path / "none.urdf")


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


@pytest.mark.parametrize(
    ("version", "rpy", "is_turned", "count"),
    [
        ("1.1", "", True, 0),
        ("1.2", "", True, 0),
        ("1.1", 'rpy="1 0 0"', True, 1),
        ("1.0", "", False, 1),
        ("", "", False, 1),
    ],
)
def test_quaternions_of_urdf_1_1(tmp_path: Path, version: str, rpy: str, is_turned: bool, count: int) -> None:
    """As urdfdom 6.0 reads them, of any length; it refuses a file that has both."""
    origin = f'<origin xyz="1 0 0" quat_xyzw="0 0 2 2" {rpy}/>'
    robot = read(tmp_path, joint("fixed", origin).replace('name="r"', f'name="r" version="{version}"', 1))
    expected = [[0, -1, 0, 1], [1, 0, 0, 0], [0, 0, 1, 0]] if is_turned else [[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0]]
    np.testing.assert_allclose(robot.link_poses({})[1][:3], expected, atol=1e-15)
    assert len(robot.warnings) == count


@pytest.mark.parametrize(
    ("kind", "content", "value", "pose"),
    [
        ("floating", '<origin xyz="1 0 0"/>', (0, 2, 3, 0, 0, 0, 2), [[-1, 0, 0, 1], [0, -1, 0, 2], [0, 0, 1, 3]]),
        ("planar", '<axis xyz="0 0 1"/>', (1, 2, math.pi / 2), [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 0]]),
        ("revolute", '<axis xyz="0 0 1e200"/>', math.pi / 2, [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0]]),
    ],
)
def test_poses_of_one_joint(
    tmp_path: Path, kind: str, content: str, value: JointValue, pose: list[list[float]]
) -> None:
    _, X = read(tmp_path, joint(kind, content)).link_poses({"j": value})
    np.testing.assert_allclose(X[:3], pose, atol=1e-15)


@pytest.mark.parametrize(
    ("axis", "position"),
    [
        ("1 0 0", (0, 0.2, -0.1)),
        ("0 1 0", (0.1, 0, -0.2)),
        ("0 0 -1", (0.1, -0.2, 0)),
        ("-1 0 0", (0, 0.2, 0.1)),
        ("1 2 3", (0.08018, 0.16036, -0.13363)),
        ("-1 -2 -3", (-0.08018, -0.16036, 0.13363)),
        ("0.3 0 -0.9", (-0.09487, 0.2, -0.03162)),
        ("0 1e-7 -1", (0.1, -0.2, 0)),
    ],
)
def test_planar_joints_move_as_in_drake_and_mujoco(tmp_path: Path, axis: str, position: tuple[float, ...]) -> None:
    """Values of Drake 1.58 and MuJoCo 4.0."""
    _, X = read(tmp_path, joint("planar", f'<axis xyz="{axis}"/>')).link_poses({"j": (0.1, 0.2, 0.3)})
    np.testing.assert_allclose(X[:3, 3], position, atol=5e-6)
    normal = np.array([float(each) for each in axis.split()])
    np.testing.assert_allclose(X[:3, :3] @ normal, normal, atol=1e-12)
    assert np.trace(X[:3, :3]) == pytest.approx(1 + 2 * math.cos(0.3))


def test_joints_of_drake(tmp_path: Path) -> None:
    """Values of Drake 1.58."""
    origin = '<origin xyz="0 0 1" rpy="0.1 0.2 0.3"/>'
    screw = f'{origin}<axis xyz="1 0 0"/><drake:screw_thread_pitch value="0.1"/>'
    _, X = read(tmp_path, joint("screw", screw)).link_poses({"j": 1.0})
    np.testing.assert_allclose(X, pose_of_rpy((0.01490, 0.00461, 0.99684), (1.1, 0.2, 0.3)), atol=5e-6)
    _, X = read(tmp_path, joint("universal", origin)).link_poses({"j": (0.3, 0.4)})
    np.testing.assert_allclose(X, pose_of_rpy((0, 0, 1), (0.4685, 0.5639, 0.4804)), atol=1e-4)


def test_long_names_are_refused_and_not_repeated(tmp_path: Path) -> None:
    """The hint at similar names would compare them for minutes."""
    with pytest.raises(RobotFileError, match=r"<link> .*5000 .*4096") as caught:
        read(tmp_path, f'<robot><link name="{"a" * 5000}"/></robot>')
    assert len(str(caught.value).removeprefix(str(tmp_path))) < 200
    names = [f"{number}{'a' * 4000}" for number in range(3)]
    links = "".join(f'<link name="{name}"/>' for name in names)
    ends = f'<parent link="{"a" * 4000}"/><child link="{names[0]}"/>'
    (warning,) = read(tmp_path, f'<robot>{links}<joint name="j" type="fixed">{ends}</joint></robot>').warnings
    assert "did you mean" not in warning
    assert f"there is no link '{'a' * 60}'" in warning
