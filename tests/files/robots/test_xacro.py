"""xacro files, expanded with the package xacro."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gateway.files.robots.reader import read_robot
from scenegate.messages.geometry import Sphere
from scenegate.robots import Robot
from scenegate.robots import read_robot as read_robot_of_client
from scenegate.robots.robot_errors import RobotFileError
from scenegate.robots.xacro_args import parse_xacro_args
from tests.files.robots.files import TRIANGLE, write

NAMESPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
BALL = """<xacro:macro name="ball" params="name r">
  <link name="${name}"><visual><geometry><sphere radius="${r * 2}"/></geometry></visual></link>
</xacro:macro>"""


@pytest.fixture(autouse=True)
def _xacro() -> None:
    pytest.importorskip("xacro", reason="the package xacro is not installed (scenegate[robots])")


def xacro(content: str) -> str:
    return f'<robot name="r" {NAMESPACE}>{content}</robot>'


@pytest.mark.parametrize("name", ["robot.urdf.xacro", "robot.urdf"])
def test_macros_includes_and_packages(tmp_path: Path, name: str) -> None:
    write(tmp_path, xacro(BALL), "balls/macros/ball.xacro")
    include = '<xacro:include filename="$(find balls)/macros/ball.xacro"/>'
    path = write(
        tmp_path, xacro(f'{include}<xacro:property name="x" value="0.5"/><xacro:ball name="a" r="${{x}}"/>'), name
    )
    robot = read_robot(path)
    assert robot.links == ("a",)
    assert [part.shape for part in robot.parts[0]] == [Sphere(1.0)]
    assert robot.warnings == ()
    assert set(robot.digests) == {name, "balls/macros/ball.xacro"}


def test_pipes_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for content in ('<xacro:include filename="pipe"/>', "<link name=\"${xacro.load_yaml('pipe')}\"/>"):
        with pytest.raises(RobotFileError, match="it is not a regular file"):
            read_robot(write(tmp_path, xacro(content), "robot.urdf.xacro"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            '<xacro:include filename="$(find none)/a.xacro"/>',
            "xacro cannot expand it: the package 'none' is not found; name a folder that contains it with --root$",
        ),
        (BALL, "it has no links, perhaps only macros: name the file that uses them"),
        ("<xacro:none/>", "xacro cannot expand it: unknown macro name: xacro:none"),
        ('<link name="${none}"/>', "xacro cannot expand it: .*'none' is not defined"),
    ],
)
def test_errors(tmp_path: Path, content: str, message: str) -> None:
    with pytest.raises(RobotFileError, match=message):
        read_robot(write(tmp_path, xacro(content), "robot.urdf.xacro"))


def test_rests_of_an_expanded_file_are_ignored(tmp_path: Path) -> None:
    content = xacro('<link name="a"/><xacro:unknown/>')
    robot = read_robot(write(tmp_path, content, "robot.urdf"))
    assert robot.links == ("a",)
    (warning,) = robot.warnings
    assert warning.startswith("xacro cannot expand it: ")
    assert warning.endswith("; its xacro elements are ignored")
    with pytest.raises(RobotFileError, match="xacro cannot expand it: "):
        read_robot(write(tmp_path, content, "robot.xacro"))


@pytest.mark.parametrize(
    "content", ['<link name="$(arg a)"/>', "<link name=\"${'$(arg a)'}\"/>", "<link name=\"${xacro.arg('a')}\"/>"]
)
def test_an_argument(tmp_path: Path, content: str) -> None:
    path = write(tmp_path, xacro(content), "robot.urdf.xacro")
    assert read_robot(path, xacro_args={"a": 7}).links == ("7",)
    with pytest.raises(RobotFileError, match=r"\ba\b.*--xacro-arg|--xacro-arg.*\ba\b"):
        read_robot(path)


def test_an_argument_with_a_default(tmp_path: Path) -> None:
    content = '<xacro:arg name="a" default="d"/><xacro:arg name="b" default="d"/><link name="$(arg a)$(arg b)"/>'
    robot = read_robot(write(tmp_path, xacro(content), "robot.urdf.xacro"), xacro_args={"a": "x", "c": ""})
    assert robot.links == ("xd",)
    (warning,) = robot.warnings
    assert "--xacro-arg c" in warning


@pytest.mark.parametrize("read", [read_robot, read_robot_of_client])
def test_arguments_of_plain_urdf(tmp_path: Path, read: Callable[..., Robot[Any]]) -> None:
    folder = tmp_path / "parts"
    write(tmp_path, TRIANGLE, "parts/m.obj")
    for name in ("$(arg where)/m.obj", "file://$(find parts)/m.obj", "$(find parts)/m.obj"):
        mesh = f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
        robot = read(write(tmp_path, f'<robot><link name="a">{mesh}</link></robot>'), xacro_args={"where": folder.name})
        assert [len(parts) for parts in robot.parts] == [1]
    robot = read(write(tmp_path, '<robot><link name="$(arg where)"/></robot>'))
    assert robot.links == ("$(arg where)",)
    assert any("--xacro-arg where:=" in warning for warning in robot.warnings)


@pytest.mark.parametrize("read", [read_robot, read_robot_of_client])
def test_arguments_of_included_files(tmp_path: Path, read: Callable[..., Robot[Any]]) -> None:
    write(tmp_path, '<robot name="r"><arg name="b" default="d"/><link name="$(arg a)$(arg b)"/></robot>', "a.urdf")
    world = '<sdf version="1.9"><world name="w"><include><uri>a.urdf</uri></include></world></sdf>'
    for args, link in (({"a": "x"}, "r::xd"), ({"a": "x", "b": 2}, "r::x2")):
        robot = read(write(tmp_path, world, "world.sdf"), xacro_args=args)
        assert (robot.links, robot.warnings) == ((link,), ())
    (warning,) = read(write(tmp_path, world, "world.sdf")).warnings
    assert "--xacro-arg a:=" in warning


def test_arguments_that_mjcf_does_not_use_are_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    model = '<mujoco><worldbody><body name="a"><geom size="1"/></body></worldbody></mujoco>'
    (warning,) = read_robot(write(tmp_path, model, "model.xml"), xacro_args={"dof": 7}).warnings
    assert "--xacro-arg dof" in warning


def test_invalid_arguments(tmp_path: Path) -> None:
    assert parse_xacro_args(["a:=b:=c", "d:="]) == {"a": "b:=c", "d": ""}
    for texts in (["a"], [":=b"], ["a=b"], ["a:=1", "a:=2"]):
        with pytest.raises(RobotFileError, match="--xacro-arg"):
            parse_xacro_args(texts)
    with pytest.raises(RobotFileError, match="xacro_args"):
        read_robot(write(tmp_path, "<robot/>"), xacro_args=["a:=1"])  # type: ignore[arg-type]  # refused at run time
