"""Files that a robot file refers to: where they are found, and where not."""

from __future__ import annotations

import hashlib
import os
import threading
from pathlib import Path

import pytest

from gateway.robots.errors import RobotFileError
from gateway.robots.limits import RobotLimits
from gateway.robots.reader import read_robot
from tests.parsers.test_mesh import nested
from tests.robots.files import TRIANGLE, visual, write
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
    ],
)
def test_files_around_the_robot_are_found(tmp_path: Path, name: str, mesh_file: str) -> None:
    folder = tmp_path / "pkg"
    write(folder, TRIANGLE, mesh_file)
    robot = read_robot(write(folder, mesh(name), "urdf/robot.urdf"))
    assert len(robot.parts[0]) == 1
    assert list(robot.digests) == ["robot.urdf", mesh_file.removeprefix("urdf/").replace("meshes", "../meshes")]
    assert list(robot.digests.values())[1] == hashlib.sha256(TRIANGLE.encode()).hexdigest()


def test_packages_are_found_by_their_manifest_beside_others_and_below_roots(tmp_path: Path) -> None:
    folder = package(tmp_path / "src" / "folder", "pkg")
    write(folder, TRIANGLE, "meshes/m.obj")
    robot_file = write(folder, mesh("package://pkg/meshes/m.obj"), "a/b/robot.urdf")
    assert read_robot(robot_file).parts[0]
    write(tmp_path / "src" / "beside", TRIANGLE, "m.obj")
    write(folder, mesh("package://beside/m.obj"), "a/b/robot.urdf")
    assert read_robot(robot_file).parts[0]
    write(package(tmp_path / "far" / "away", "other"), TRIANGLE, "m.obj")
    write(folder, mesh("package://other/m.obj"), "a/b/robot.urdf")
    with pytest.raises(
        RobotFileError, match=r"link 'a': .* the package 'other', which is not around the robot file; name"
    ):
        read_robot(robot_file)
    assert read_robot(robot_file, roots=[tmp_path / "far"]).parts[0]
    with pytest.raises(
        RobotFileError, match="the package 'other', which is not around the robot file nor below --root"
    ):
        read_robot(robot_file, roots=[tmp_path / "src"])


def test_names_may_be_relative_to_a_root(tmp_path: Path) -> None:
    write(tmp_path / "meshes", TRIANGLE, "m.obj")
    robot_file = write(tmp_path / "deep" / "folder", mesh("m.obj"))
    with pytest.raises(RobotFileError, match=r"link 'a': the file m.obj does not exist"):
        read_robot(robot_file)
    assert read_robot(robot_file, roots=[tmp_path / "meshes"]).parts[0]


def test_other_folders_are_not_read(tmp_path: Path) -> None:
    write(tmp_path, TRIANGLE, "m.obj")
    folder = tmp_path / "robots" / "one"
    (tmp_path / "robots" / "m.obj").parent.mkdir()
    (tmp_path / "robots" / "m.obj").symlink_to(tmp_path / "m.obj")
    for name in ("../../m.obj", "../m.obj", f"file://{tmp_path}/m.obj"):
        robot_file = write(folder, mesh(name))
        with pytest.raises(
            RobotFileError, match=r"link 'a': .* lies outside of the robot's folders; name a folder above"
        ):
            read_robot(robot_file)
        assert read_robot(robot_file, roots=[tmp_path]).parts[0]


def test_a_link_does_not_make_other_folders_a_package(tmp_path: Path) -> None:
    write(tmp_path / "elsewhere", TRIANGLE, "m.obj")
    robot_file = write(tmp_path / "robots" / "one", mesh("package://pkg/m.obj"))
    (tmp_path / "robots" / "pkg").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(RobotFileError, match="the package 'pkg', which is not around the robot file"):
        read_robot(robot_file)
    assert read_robot(robot_file, roots=[tmp_path]).parts[0]


def test_the_home_folder_is_no_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home = tmp_path / "users" / "alice"
    write(home, TRIANGLE, "m.obj")
    monkeypatch.setenv("HOME", str(home))
    for name in ("package://alice/m.obj", "package://users/alice/m.obj", "../m.obj"):
        robot_file = write(home / "robot", mesh(name))
        with pytest.raises(RobotFileError, match=r"not around the robot file|outside of the robot's folders"):
            read_robot(robot_file)
        assert read_robot(robot_file, roots=[home.parent, home]).parts[0]
    write(home / "robot", TRIANGLE, "meshes/m.obj")
    assert read_robot(write(home / "robot", mesh("../meshes/m.obj"), "urdf/robot.urdf")).parts[0]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("http://example.com/m.obj", "only package:// and file:// can be read, nothing is fetched"),
        ("m.step", "m.step is none of the formats dae, glb, gltf, obj, ply, stl"),
        ("package://../m.obj", "the package '..', which is not around the robot file"),
        ("package:///m.obj", "the package 'm.obj', which is not around the robot file"),
        ("a&#10;b.obj", "does not exist"),
    ],
)
def test_other_names_are_rejected(tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(RobotFileError, match=message) as caught:
        read_robot(write(tmp_path, mesh(name)))
    assert "link 'a'" in str(caught.value)


def test_a_pipe_is_no_file(tmp_path: Path) -> None:
    """It would block for ever."""
    os.mkfifo(tmp_path / "m.mtl")
    write(tmp_path, "mtllib m.mtl\n" + TRIANGLE, "m.obj")
    assert read_robot(write(tmp_path, mesh("m.obj"))).parts[0]
    os.mkfifo(tmp_path / "m.stl")
    with pytest.raises(RobotFileError, match=r"link 'a': the file m.stl does not exist"):
        read_robot(write(tmp_path, mesh("m.stl")))


def test_a_package_without_the_file_is_named(tmp_path: Path) -> None:
    folder = package(tmp_path / "pkg", "pkg")
    with pytest.raises(RobotFileError, match=f"the file package://pkg/none.stl does not exist in {folder}"):
        read_robot(write(folder, mesh("package://pkg/none.stl")))


def test_total_size_is_limited(tmp_path: Path) -> None:
    write(tmp_path, TRIANGLE, "m.obj")
    robot_file = write(tmp_path, mesh("m.obj"))
    size = robot_file.stat().st_size
    with pytest.raises(RobotFileError, match=r"m.obj has more than 1 bytes, the remaining limit$"):
        read_robot(robot_file, limits=RobotLimits(max_total_bytes=size + 1))
    with pytest.raises(RobotFileError, match=r"m.obj has more than 2 bytes, the remaining limit$"):
        read_robot(robot_file, limits=RobotLimits(max_mesh_bytes=2))


def test_other_files_than_regular_ones_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "m.obj")
    robot_file = write(tmp_path, mesh("m.obj"))
    with pytest.raises(RobotFileError, match=r"m.obj"):
        read_robot(robot_file)
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
    with pytest.raises(RobotFileError, match="its XML has more than 10000 levels, which is the limit"):
        read_robot(write(tmp_path, "<robot>" + "<a>" * 3_000_000))


def test_a_mesh_that_unfolds_is_named(tmp_path: Path) -> None:
    write(tmp_path, nested(40, 2), "m.dae")
    with pytest.raises(RobotFileError, match=r"robot.urdf: link .*: m.dae: it has more than 10\^12 parts"):
        read_robot(write(tmp_path, mesh("m.dae")))
