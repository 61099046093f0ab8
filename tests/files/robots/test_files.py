"""Files that a robot file refers to: where they are found, and where not."""

import hashlib
import os
import re
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gateway.files.assets.scene_file import SceneFileError
from gateway.files.robots.reader import read_robot
from gateway.files.robots.robot import RobotLimits
from gateway.files.robots.scene_files import SceneOptions, read_scene
from scenegate.robots import Robot
from scenegate.robots import read_robot as read_robot_of_client
from scenegate.robots.robot_errors import RobotFileError
from scenegate.warning_text import NOTHING_OF_ROBOT
from tests.files.parsers.test_mesh import nested
from tests.files.robots.files import TRIANGLE, link, visual, write
from tests.support.waiting import SECONDS


def mesh(name: str) -> str:
    return visual(f'<mesh filename="{name}"/>')


def package(folder: Path, name: str) -> Path:
    write(folder, f"<package><name>{name}</name></package>", "package.xml")
    return folder


@pytest.mark.parametrize(
    ("name", "mesh_file"),
    [
        ("m.obj", "urdf/m.obj"),
        ("../meshes/m.obj", "meshes/m.obj"),
        ("package://pkg/meshes/m.obj", "meshes/m.obj"),
        ("package:///pkg/meshes/m.obj", "meshes/m.obj"),
        ("model://pkg/meshes/m.obj", "meshes/m.obj"),
        ("models://pkg/meshes/m.obj", "meshes/m.obj"),
        ("Package://pkg/meshes/m.obj", "meshes/m.obj"),
        ("package://pkg//meshes//m.obj", "meshes/m.obj"),
        ("file://../meshes/m.obj", "meshes/m.obj"),
        ("file://pkg/meshes/m.obj", "meshes/m.obj"),
    ],
)
def test_files_around_the_robot_are_found(tmp_path: Path, name: str, mesh_file: str) -> None:
    folder = tmp_path / "pkg"
    write(folder, TRIANGLE, mesh_file)
    robot = read_robot(write(folder, mesh(name), "urdf/robot.urdf"))
    assert len(robot.parts[0]) == 1
    assert list(robot.digests) == ["robot.urdf", mesh_file.removeprefix("urdf/").replace("meshes", "../meshes")]
    assert list(robot.digests.values())[1] == hashlib.sha256(TRIANGLE.encode()).hexdigest()


def warning(robot_file: Path) -> str:
    """Return the only warning about a robot whose link has no geometry that can be drawn."""
    robot = read_robot(robot_file)
    assert robot.parts == ((),)
    (text,) = robot.warnings
    with pytest.raises(RobotFileError, match=re.escape(f"{robot_file}: {text}")):
        read_robot(robot_file, strict=True)
    return text


def test_packages_are_found_by_their_manifest_beside_others_and_below_roots(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = package(tmp_path / "src" / "folder", "pkg")
    write(folder, TRIANGLE, "meshes/m.obj")
    robot_file = write(folder, mesh("package://pkg/meshes/m.obj"), "a/b/robot.urdf")
    assert read_robot(robot_file).parts[0]
    write(tmp_path / "src" / "beside", TRIANGLE, "m.obj")
    write(folder, mesh("package://beside/m.obj"), "a/b/robot.urdf")
    assert read_robot(robot_file).parts[0]
    write(package(tmp_path / "far" / "away", "other"), TRIANGLE, "m.obj")
    write(folder, mesh("package://other/m.obj"), "a/b/robot.urdf")
    assert warning(robot_file).startswith(
        "link 'a': the mesh package://other/m.obj is not shown: the package 'other' is not"
    )
    assert read_robot(robot_file, roots=[tmp_path / "far"]).parts[0]
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{tmp_path / 'none'}{os.pathsep}{tmp_path / 'far'}")
    assert read_robot(robot_file).parts[0]


def test_packages_are_found_below_ament_prefixes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "opt" / "share" / "other", TRIANGLE, "meshes/m.obj")
    robot_file = write(tmp_path / "robot", mesh("package://other/meshes/m.obj"))
    assert not read_robot(robot_file).parts[0]
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "opt"))
    assert read_robot(robot_file).parts[0]


def test_outside_of_ros_the_rest_of_a_package_path_is_looked_for_upward(tmp_path: Path) -> None:
    write(tmp_path / "download", TRIANGLE, "meshes/visual/m.obj")
    robot_file = write(tmp_path / "download", mesh("package://gone_description/meshes/visual/m.obj"), "urdf/robot.urdf")
    assert read_robot(robot_file).parts[0]


def test_relative_paths_may_begin_in_a_folder_above(tmp_path: Path) -> None:
    """As in Isaac Gym, and in PyBullet."""
    write(tmp_path / "assets" / "ycb", TRIANGLE, "mug/m.obj")
    robot = read_robot(write(tmp_path / "assets" / "ycb" / "mug", mesh("ycb/mug/m.obj"), "mug.urdf"))
    assert robot.parts[0]
    (note,) = robot.notes
    assert note == f"files of ycb, which are not beside the robot file, are read from {tmp_path / 'assets'}"
    for name in ("./ycb/mug/m.obj", "ycb\\mug\\m.obj", "ycb/mug/%6D.obj"):
        assert read_robot(write(tmp_path / "assets" / "ycb" / "mug", mesh(name), "mug.urdf")).notes == (note,)
    write(tmp_path, TRIANGLE, "other.obj")
    assert "there is no such file" in warning(write(tmp_path / "urdf", mesh("other.obj")))


def test_names_may_be_relative_to_a_root(tmp_path: Path) -> None:
    write(tmp_path / "meshes", TRIANGLE, "m.obj")
    robot_file = write(tmp_path / "deep" / "folder", mesh("m.obj"))
    assert "there is no such file" in warning(robot_file)
    assert read_robot(robot_file, roots=[tmp_path / "meshes"]).parts[0]


def test_any_file_of_the_user_may_be_named(tmp_path: Path) -> None:
    write(tmp_path / "hands", TRIANGLE, "m.obj")
    path = f"{tmp_path}/hands/m.obj"
    for name in ("../../hands/m.obj", path, f"file://{path}", f"file:{path}", f"FILE://{path}", f"File:{path}"):
        assert read_robot(write(tmp_path / "robots" / "one", mesh(name))).parts[0]


@pytest.mark.parametrize(
    "name",
    [
        "file:///ws/install/pkg/share/pkg/visual/m.obj",
        "/opt/ros/share/pkg/visual/m.obj",
        r"file:///C:\ws\share\pkg\visual\m.obj",
        "/home/ann/src/pkg/meshes/m.obj",
        "file:///home/ann/src/pkg/meshes/m.obj",
        "C:/ws/src/pkg/meshes/m.obj",
        "~/src/pkg/meshes/m.obj",
        "../../../src/pkg/meshes/m.obj",
        "/home/ann/ws/src/repository/pkg/visual/m.obj",
    ],
)
@pytest.mark.parametrize("read", [read_robot, read_robot_of_client])
def test_paths_of_another_machine_are_those_of_a_package(
    tmp_path: Path, read: Callable[..., Robot[Any]], name: str
) -> None:
    folder = package(tmp_path / "src" / "folder", "pkg")
    for path in ("visual/m.obj", "visual/n.obj", "meshes/m.obj", "meshes/n.obj"):
        write(folder, TRIANGLE, path)
    other = name.replace("m.obj", "n.obj")
    two = link("".join(f'<visual><geometry><mesh filename="{each}"/></geometry></visual>' for each in (name, other)))
    robot = read(write(tmp_path / "robot", two), roots=[tmp_path / "src"])
    assert [len(parts) for parts in robot.parts] == [2]
    assert robot.warnings == ()
    (note,) = robot.notes
    assert str(folder) in note
    if "/src/repository/" not in name:
        assert "'pkg'" in warning(write(tmp_path / "robot", mesh(name)))


def test_a_robot_of_which_nothing_is_drawn(tmp_path: Path) -> None:
    for content in (mesh("/gone/m.obj"), '<robot><link name="a"/></robot>'):
        robot_file = write(tmp_path, content)
        assert read_scene(robot_file).warnings[-1] == NOTHING_OF_ROBOT
        with pytest.raises(SceneFileError, match=NOTHING_OF_ROBOT):
            read_scene(robot_file, SceneOptions(strict=True))


@pytest.mark.parametrize("name", [r"meshes\a b.obj", "meshes/a%20b.obj", r"package://pkg\meshes\a%20b.obj"])
def test_backslashes_and_url_escapes(tmp_path: Path, name: str) -> None:
    write(tmp_path / "pkg", TRIANGLE, "meshes/a b.obj")
    assert read_robot(write(tmp_path / "pkg", mesh(name))).parts[0]


def test_a_file_with_the_literal_name_comes_first(tmp_path: Path) -> None:
    write(tmp_path, TRIANGLE, "a b.obj")
    literal = write(tmp_path, TRIANGLE, "a%20b.obj")
    assert list(read_robot(write(tmp_path, mesh("a%20b.obj"))).digests)[1] == literal.name


def test_a_name_that_differs_in_case_is_not_read_but_named(tmp_path: Path) -> None:
    write(tmp_path, TRIANGLE, "Meshes/M.obj")
    if (tmp_path / "meshes").exists():
        pytest.skip("this file system does not tell upper case from lower case")
    assert f"one whose name differs in upper and lower case: {tmp_path}/Meshes/M.obj" in warning(
        write(tmp_path, mesh("meshes/m.obj"))
    )


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("http://example.com/m.obj", "only files, package:// and file:// can be read, nothing is fetched"),
        ("m.step", "it is not one of the formats dae, glb, gltf, obj, ply, stl"),
        ("package://../m.obj", "the package '..' is not above or beside the robot file"),
        ("package:///m.obj", "the package 'm.obj' is not above or beside the robot file"),
        ("a&#10;b.obj", "there is no such file"),
    ],
)
def test_other_names_are_not_read(tmp_path: Path, name: str, message: str) -> None:
    assert message in warning(write(tmp_path, mesh(name)))


def test_a_package_without_the_file_is_named(tmp_path: Path) -> None:
    folder = package(tmp_path / "pkg", "pkg")
    assert f"there is no such file in {folder}" in warning(write(folder, mesh("package://pkg/none.stl")))


def test_total_size_is_limited(tmp_path: Path) -> None:
    write(tmp_path, TRIANGLE, "m.obj")
    robot_file = write(tmp_path, mesh("m.obj"))
    size = robot_file.stat().st_size
    for limits, remaining in ((RobotLimits(max_total_bytes=size + 1), 1), (RobotLimits(max_mesh_bytes=2), 2)):
        robot = read_robot(robot_file, limits=limits)
        assert not robot.parts[0]
        assert f"m.obj has more than {remaining} bytes, the remaining limit" in robot.warnings[0]


def test_other_files_than_regular_ones_are_refused(tmp_path: Path) -> None:
    """A pipe would block for ever."""
    os.mkfifo(tmp_path / "m.mtl")
    write(tmp_path, "mtllib m.mtl\n" + TRIANGLE, "m.obj")
    assert read_robot(write(tmp_path, mesh("m.obj"))).parts[0]
    os.mkfifo(tmp_path / "m.stl")
    assert "the mesh m.stl is not shown: it is not a regular file" in warning(write(tmp_path, mesh("m.stl")))
    with pytest.raises(RobotFileError, match="it has more than 67108864 bytes"):
        read_robot("/dev/zero")


def test_a_robot_file_may_be_a_pipe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its relative names start at the working directory."""
    monkeypatch.chdir(tmp_path)
    write(tmp_path, TRIANGLE, "m.obj")
    os.mkfifo(tmp_path / "pipe")
    for content, expected in ((mesh("m.obj"), ""), ("<mujoco/>", "MuJoCo reads files only, not pipes")):
        writer = threading.Thread(target=(tmp_path / "pipe").write_text, args=(content,))
        writer.start()
        if expected:
            with pytest.raises(RobotFileError, match=expected):
                read_robot(tmp_path / "pipe")
        else:
            assert len(read_robot(tmp_path / "pipe").parts[0]) == 1
        writer.join(SECONDS)


def test_deep_xml_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match="10000 levels"):
        read_robot(write(tmp_path, "<robot>" + "<a>" * 3_000_000))


def test_a_mesh_that_unfolds_is_named(tmp_path: Path) -> None:
    write(tmp_path, nested(40, 2), "m.dae")
    assert "the mesh m.dae is not shown: it has more than 10^12 parts" in warning(write(tmp_path, mesh("m.dae")))
