"""Joint values as users give them, and the tree of a robot."""

import re
from pathlib import Path

import numpy as np
import pytest

from scenegate.robots.joint_text import parse_joints
from scenegate.robots.robot import MAX_MIMIC_CHAIN, JointValue
from scenegate.robots.robot_errors import RobotFileError
from tests.files.robots.files import ARM, read


def test_a_mimic_joint_follows_unless_it_has_a_value(tmp_path: Path) -> None:
    robot = read(tmp_path, ARM)
    assert robot.joint_values({}) == {"shoulder": (0.0,), "elbow": (0.0,), "grip": (0.1,)}
    assert robot.joint_values({"elbow": 2})["grip"] == (1.1,)
    assert robot.joint_values({"elbow": 2, "grip": np.float32(0.5)})["grip"] == (0.5,)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"elbw": 0}, "the robot has no joint 'elbw'; did you mean elbow?"),
        ({"xyz": 0}, "the robot has no joint 'xyz'; there are shoulder, elbow, grip"),
        ({"GRIP": 0}, "did you mean grip?"),
        ({"elbow": float("nan")}, "the value of the revolute joint 'elbow' must be one finite number, not nan"),
        ({"elbow": "abc"}, "the value of the revolute joint 'elbow' must be one finite number, not 'abc'"),
        ({"elbow": [(1,), (1, 2)]}, "the value of the revolute joint 'elbow' must be one finite number, not [(1,), (1"),
        ({"elbow": (1, 2)}, "the value of the revolute joint 'elbow' must be one finite number, not (1, 2)"),
    ],
)
def test_values_that_do_not_fit(tmp_path: Path, values: dict[str, JointValue], message: str) -> None:
    with pytest.raises(RobotFileError, match=re.escape(message)):
        read(tmp_path, ARM).link_poses(values)


def test_a_floating_joint_needs_a_quaternion(tmp_path: Path) -> None:
    robot = read(
        tmp_path,
        '<robot><link name="a"/><link name="b"/>'
        '<joint name="j" type="floating"><parent link="a"/><child link="b"/></joint></robot>',
    )
    with pytest.raises(RobotFileError, match=r"'j' must be 7 .*not 1"):
        robot.link_poses({"j": 1})
    with pytest.raises(RobotFileError, match=r"quaternion .*'j'"):
        robot.link_poses({"j": (1, 2, 3, 0, 0, 0, 0)})


def test_the_tree_has_a_node_for_each_link(tmp_path: Path) -> None:
    robot = read(tmp_path, ARM)
    tree = robot.tree({"elbow": 1.0})
    top = tree.children["arm"]
    assert tuple(top.children) == robot.links
    for name, X in zip(robot.links, robot.link_poses({"elbow": 1.0}), strict=True):
        np.testing.assert_array_equal(tree.world_matrix(("arm", name)), X)


def test_joint_values_as_text() -> None:
    assert parse_joints(["a=1.5", "b/c= -2", "base=0,0,1,1,0,0,0", "x=y=3"]) == {
        "a": (1.5,),
        "b/c": (-2.0,),
        "base": (0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0),
        "x=y": (3.0,),
    }


@pytest.mark.parametrize("text", ["a", "a=", "a=b", "=1", "a=1,,2"])
def test_other_texts_are_rejected(text: str) -> None:
    with pytest.raises(RobotFileError, match=re.escape(f"--joint {text!r}: must be name=value")):
        parse_joints([text])


def test_a_joint_has_one_value() -> None:
    with pytest.raises(RobotFileError, match="--joint 'a=2': a has a value already"):
        parse_joints(["a=1", "a=2"])


def test_a_pose_beyond_float64_is_an_error(tmp_path: Path) -> None:
    robot = read(
        tmp_path,
        '<robot><link name="a"/><link name="b"/><link name="c"/>'
        '<joint name="j" type="prismatic"><parent link="a"/><child link="b"/></joint>'
        '<joint name="k" type="prismatic"><parent link="b"/><child link="c"/>'
        '<mimic joint="j" multiplier="10"/></joint></robot>',
    )
    assert np.isfinite(robot.link_poses({"j": 1.0})).all()
    with pytest.raises(RobotFileError, match=r"link 'c' .*not finite"):
        robot.link_poses({"j": 1e308})


def test_long_chains_of_mimics_are_cut(tmp_path: Path) -> None:
    count = MAX_MIMIC_CHAIN + 2
    links = "".join(f'<link name="l{i}"/>' for i in range(count + 1))
    joints = "".join(
        f'<joint name="j{i}" type="prismatic"><parent link="l{i}"/><child link="l{i + 1}"/>'
        + (f'<mimic joint="j{i + 1}"/>' if i < count - 1 else "")
        + "</joint>"
        for i in range(count)
    )
    robot = read(tmp_path, f"<robot>{links}{joints}</robot>")
    (warning,) = robot.warnings
    assert warning.startswith("joint 'j0': it mimics a chain of more than 100 joints")
    assert robot.joint_values({f"j{count - 1}": 2.0})["j1"] == (2.0,)


def test_only_a_joint_of_a_circle_of_mimics_loses_its_rule(tmp_path: Path) -> None:
    """``c`` is read first and follows the circle of ``a`` and ``b``."""
    leaders = {"c": "a", "a": "b", "b": "a"}
    joints = "".join(
        f'<joint name="{name}" type="prismatic"><parent link="base"/><child link="{name}_link"/>'
        f'<mimic joint="{leader}" multiplier="2"/></joint>'
        for name, leader in leaders.items()
    )
    links = "".join(f'<link name="{name}"/>' for name in ("base", "a_link", "b_link", "c_link"))
    robot = read(tmp_path, f"<robot>{links}{joints}</robot>")
    (warning,) = robot.warnings
    assert warning == "joint 'a': the joints a, b mimic each other in a circle; it does not follow another joint"
    assert robot.joint_values({"a": 1.0}) == {"c": (2.0,), "a": (1.0,), "b": (2.0,)}
