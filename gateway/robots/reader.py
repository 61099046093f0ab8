"""Reads robot files: URDF, SDF or MJCF, decided by the root element."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from gateway.robots.errors import RobotFileError, joined_warnings
from gateway.robots.files import RobotFiles
from gateway.robots.limits import RobotLimits
from gateway.robots.robot import GeometryUse, Robot, without_invalid_mimics
from gateway.robots.sdf import parse_sdf
from gateway.robots.urdf import parse_urdf
from gateway.robots.urdf_kinematics import UrdfKinematics
from gateway.robots.urdf_model import UrdfModel
from gateway.robots.urdf_parts import UrdfParts
from gateway.robots.xacro_files import expand_xacro
from gateway.robots.xml_text import parse_xml, uses_xacro

SUFFIXES: Final = (".urdf", ".sdf", ".world", ".xml", ".mjcf", ".xacro")
"""Suffixes of robot files."""


def read_robot(
    path: str | Path,
    *,
    roots: Iterable[str | Path] = (),
    geometry: GeometryUse = "visual",
    keyframe: str = "",
    strict: bool = False,
    limits: RobotLimits | None = None,
) -> Robot:
    """Read a robot file. All that can be drawn is drawn; ``Robot.warnings`` has a sentence for each thing that cannot.

    Args:
        path: A URDF, SDF or MJCF file.
        roots: Folders to search for the packages of ``package://`` names, and for relative file names.
        geometry: Geometry of the links to return.
        keyframe: Name of an MJCF file's ``<key>``, which has the joints' default values. Empty: those of the model.
        strict: True: a warning is an error.
        limits: Limits; None: ``RobotLimits()``.

    Raises:
        RobotFileError: The file cannot be read, has no tree of links, or is beyond a limit; or ``strict`` is true and
            it has a warning. The message names the robot file and the reason.
        ImportError: The file is MJCF or has xacro elements, and the package ``mujoco`` or ``xacro`` is not installed.
    """
    try:
        robot = _read(Path(path), tuple(Path(root) for root in roots), geometry, keyframe, limits or RobotLimits())
        if strict and robot.warnings:
            raise RobotFileError(joined_warnings(robot.warnings))
        return robot
    except RobotFileError as error:
        raise RobotFileError(f"{os.fspath(path)}: {error}") from None
    except OSError as error:
        raise RobotFileError(f"{os.fspath(path)} cannot be read: {error.strerror}") from None


def _read(path: Path, roots: tuple[Path, ...], use: GeometryUse, keyframe: str, limits: RobotLimits) -> Robot:
    files = RobotFiles(path, roots, limits)
    warnings: list[str] = []
    root = parse_xml(files.read_robot_file(), limits.max_elements, warnings)
    if path.suffix.lower() == ".xacro" or uses_xacro(root):
        root = parse_xml(expand_xacro(files, limits), limits.max_elements, warnings)
    if root.tag == "mujoco":
        from gateway.robots.mjcf import read_mjcf

        return read_mjcf(root, files, use, keyframe, limits)
    if keyframe:
        raise RobotFileError("only MJCF files have keyframes")
    if root.tag == "robot":
        model = parse_urdf(root, use, limits, warnings)
    elif root.tag == "sdf":
        model = parse_sdf(root, files, use, limits, warnings)
    else:
        raise RobotFileError(
            f"its first element is <{root.tag[:60]}>; URDF starts with <robot>, SDF with <sdf>, MJCF with <mujoco>"
        )
    return _robot(model, files, limits, warnings)


def _robot(model: UrdfModel, files: RobotFiles, limits: RobotLimits, warnings: list[str]) -> Robot:
    """Return the robot of a URDF or SDF file."""
    kinematics = UrdfKinematics(model)
    joints = {joint.name: joint.motion for joint in model.joints if joint.motion is not None}
    joints = without_invalid_mimics(joints, warnings)
    converter = UrdfParts(files, limits, warnings)
    parts = tuple(converter.parts_of(link.name, link.geometries) for link in model.links)
    links = tuple(link.name for link in model.links)
    name = model.name or files.path.stem
    return Robot(name, links, joints, parts, kinematics, tuple(dict.fromkeys(warnings)), files.digests)
