"""Robots from packages, in SCENEGATE_ROBOTS: they load, and their link poses equal those of Drake and MuJoCo.

Mesh files are found and read for all robots. They are parsed for one of four where they are large, and for all of them
with SCENEGATE_ALL_CASES, which takes minutes.
"""

import hashlib
import json
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.files.assets.mesh_formats import parse_mesh
from gateway.files.robots import reader
from gateway.files.robots.reader import read_robot
from gateway.files.robots.robot import Robot
from gateway.scene.tree.geometry import Part
from renderers.drawlist import Material
from scenegate.messages.geometry import Box
from scenegate.robots.robot_errors import RobotFileError
from tests.support.waiting import SECONDS

pytestmark = pytest.mark.slow

TOLERANCE = 1e-9
"""Maximum difference of an element of a link's pose: metres, and elements of rotation matrices."""
ALL_CASES = "SCENEGATE_ALL_CASES" in os.environ
FOURTH = slice(None, None, 4)
URDF_FOLDER = "cmeel.prefix/share/example-robot-data"
BROKEN_URDF = {"ur3.urdf": "it has no links"}
"""Files of the package that no program can use, and why."""
MJCF = (
    "robosuite/models/assets/robots/*/robot.xml",
    "dm_control/suite/*.xml",
    "dm_control/locomotion/walkers/assets/*.xml",
    "gymnasium_robotics/envs/assets/fetch/reach.xml",
    "gymnasium_robotics/envs/assets/hand/reach.xml",
    "gymnasium_robotics/envs/assets/adroit_hand/adroit_door.xml",
    "gymnasium_robotics/envs/assets/kitchen_franka/kitchen_assets/kitchen_env_model.xml",
)


@pytest.fixture(scope="module")
def folder() -> Path:
    found = os.environ.get("SCENEGATE_ROBOTS")
    if not found:
        pytest.skip("SCENEGATE_ROBOTS does not name a folder with packages of robot files")
    return Path(found)


class Meshes:
    """Stands for ``parse_mesh``: parses equal files once, and where ``parses`` is False none."""

    def __init__(self) -> None:
        self.parses = True
        self._parsed: dict[tuple[Any, ...], tuple[tuple[Part, ...], list[str]]] = {}

    def __call__(
        self, data: bytes, extension: str, read: Any, limits: Any, warnings: list[str], **options: Any
    ) -> tuple[Part, ...]:
        if not self.parses:
            return (Part(Box((1, 1, 1)), Material()),)
        key = (hashlib.sha256(data).digest(), extension, *options.values())
        if key not in self._parsed:
            found: list[str] = []
            self._parsed[key] = parse_mesh(data, extension, read, limits, found, **options), found
        parts, found = self._parsed[key]
        warnings += found
        return parts


@pytest.fixture(scope="module")
def meshes() -> Iterator[Meshes]:
    meshes = Meshes()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reader, "parse_mesh", meshes)
        yield meshes


def read_all(paths: list[Path], meshes: Meshes, parsed: slice, broken: dict[str, str]) -> dict[Path, Robot]:
    """Return the robots of all files that can be used, those of a part with their meshes.

    Args:
        broken: files that must fail, and the reasons.
    """
    robots, failures = {}, {}
    for path in paths:
        meshes.parses = path in paths[parsed] or ALL_CASES
        try:
            robots[path] = read_robot(path)
        except RobotFileError as error:
            failures[path.name] = str(error)
    assert failures.keys() == broken.keys(), failures
    for name, reason in broken.items():
        assert reason in failures[name]
    return robots


@pytest.fixture(scope="module")
def urdf_robots(folder: Path, meshes: Meshes) -> dict[Path, Robot]:
    """Return the robots of all URDF files of a package that can be used."""
    return read_all(sorted((folder / URDF_FOLDER / "robots").rglob("*.urdf")), meshes, FOURTH, BROKEN_URDF)


def some_values(robot: Robot, seed: int) -> dict[str, float]:
    """Return values of the joints that have one and follow no other one."""
    rng = np.random.default_rng(seed)
    free = [name for name, joint in robot.joints.items() if len(joint.default) == 1 and joint.mimic is None]
    return {name: float(value) for name, value in zip(free, rng.uniform(-1.0, 1.0, len(free)), strict=True)}


def test_urdf_robots_load_with_geometry(urdf_robots: dict[Path, Robot]) -> None:
    assert len(urdf_robots) >= 60
    without = {path.name for path, robot in urdf_robots.items() if not any(robot.parts)}
    assert without == {"romeo_laas_small.urdf", "simple_humanoid_classical.urdf"}
    mentioned = {path.name for path, robot in urdf_robots.items() if robot.warnings}
    assert mentioned >= {"alex_psyonic_hands.urdf", "romeo_laas_small.urdf", "talos_reduced_corrected.urdf"}


@pytest.mark.drake
def test_urdf_poses_equal_drakes(urdf_robots: dict[Path, Robot], folder: Path) -> None:
    python = os.environ.get("SCENEGATE_DRAKE_PYTHON")
    if not python:
        pytest.skip("SCENEGATE_DRAKE_PYTHON does not name an interpreter with pydrake")
    packages = {"example-robot-data": str(folder / URDF_FOLDER)}
    requests = [
        {"file": str(path), "packages": packages, "joints": robot.joint_values(some_values(robot, seed))}
        for seed, (path, robot) in enumerate(urdf_robots.items())
    ]
    command = [python, str(Path(__file__).with_name("drake_poses.py"))]
    answer = subprocess.run(
        command, input=json.dumps(requests), capture_output=True, text=True, timeout=SECONDS, check=True
    )
    compared, refused = 0, []
    for seed, (result, (path, robot)) in enumerate(zip(json.loads(answer.stdout), urdf_robots.items(), strict=True)):
        if "error" in result:
            refused.append(path.name)
            continue
        ours = dict(zip(robot.links, robot.link_poses(some_values(robot, seed)), strict=True))
        assert len(result.keys() & ours.keys()) >= len(ours) - 1  # Drake's world is a link called "world"
        assert difference(ours, result) < TOLERANCE, path.name
        compared += 1
    assert compared >= 60
    # Fixed joints with <mimic>, and joints that mimic one that does not exist.
    assert all(name.startswith("talos_") or name == "alex_psyonic_hands.urdf" for name in refused), refused


@pytest.mark.parametrize(
    ("package", "parsed", "count", "warned", "broken"),
    [
        ("airo_models", FOURTH, 16, 0, {}),
        ("armar", slice(4, 5), 8, 8, {}),  # armar6; the files of armar4 are of the same kinds, 100 MB of them
        ("jvrc_description", slice(None), 1, 1, {}),
        ("pybullet_data", slice(None), 95, 23, {"torus_deform.urdf": "it has no links"}),
    ],
)
def test_robots_of_other_packages(
    folder: Path, meshes: Meshes, package: str, parsed: slice, count: int, warned: int, broken: dict[str, str]
) -> None:
    """All that can be drawn is drawn: what was left out is in the warnings."""
    paths = sorted(path for path in (folder / package).rglob("*.urdf") if "random_urdfs" not in path.parts)
    if not paths:
        pytest.skip(f"SCENEGATE_ROBOTS has no {package}")
    robots = read_all(paths, meshes, parsed, broken)
    assert len(paths) == count
    assert sum(bool(robot.warnings) for robot in robots.values()) == warned
    for path, robot in robots.items():
        assert np.isfinite(robot.link_poses({})).all(), path


def difference(ours: dict[str, Any], theirs: dict[str, Any]) -> float:
    """Return the maximum difference of poses relative to the first link that both have."""
    names = [name for name in ours if name in theirs]
    first, other_first = np.linalg.inv(ours[names[0]]), np.linalg.inv(np.array(theirs[names[0]]))
    return max(float(np.abs(first @ ours[name] - other_first @ np.array(theirs[name])).max()) for name in names)


def test_mjcf_poses_equal_mujocos(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log there when a program calls it directly
    mujoco: Any = pytest.importorskip("mujoco", reason="the package mujoco is not installed (scenegate[robots])")
    paths = sorted(path for pattern in MJCF for path in folder.glob(pattern))
    assert len(paths) >= 30
    for seed, path in enumerate(paths):
        robot = read_robot(path)
        assert any(robot.parts), path
        values = robot.joint_values(some_values(robot, seed))
        model = mujoco.MjModel.from_xml_path(str(path))
        data = mujoco.MjData(model)
        for index, value in enumerate(values.values()):
            address = model.jnt_qposadr[index]
            data.qpos[address : address + len(value)] = value
        mujoco.mj_forward(model, data)
        poses = robot.link_poses(values)
        assert np.abs(poses[:, :3, 3] - data.xpos).max() < TOLERANCE, path
        assert np.abs(poses[:, :3, :3] - data.xmat.reshape(-1, 3, 3)).max() < TOLERANCE, path
