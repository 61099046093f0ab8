"""Reads robot files: URDF or MJCF, decided by the root element."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from gateway.robots.errors import RobotFileError
from gateway.robots.files import RobotFiles
from gateway.robots.limits import RobotLimits
from gateway.robots.robot import GeometryUse, Robot, check_mimics
from gateway.robots.urdf import parse_urdf
from gateway.robots.urdf_kinematics import UrdfKinematics
from gateway.robots.urdf_parts import UrdfParts
from gateway.robots.xml_text import Element, parse_xml

SUFFIXES: Final = (".urdf", ".xml", ".mjcf")
"""Suffixes of robot files."""


def read_robot(
    path: str | Path,
    *,
    roots: Iterable[str | Path] = (),
    geometry: GeometryUse = "visual",
    limits: RobotLimits | None = None,
) -> Robot:
    """Read a robot file.

    Args:
        path: A URDF or MJCF file; for URDF, it may be a pipe.
        roots: Folders to search for the packages of ``package://`` names, and for relative file names.
        geometry: Geometry of the links to return.
        limits: Limits; None: ``RobotLimits()``.

    Raises:
        RobotFileError: The file or one that it refers to is missing, invalid or beyond a limit. The message names the
            robot file and the reason.
        ImportError: The file is MJCF, and the package ``mujoco`` is not installed.
    """
    try:
        return _read(Path(path), tuple(Path(root) for root in roots), geometry, limits or RobotLimits())
    except RobotFileError as error:
        raise RobotFileError(f"{os.fspath(path)}: {error}") from None
    except OSError as error:
        raise RobotFileError(f"{os.fspath(path)} cannot be read: {error.strerror}") from None


def _read(path: Path, roots: tuple[Path, ...], use: GeometryUse, limits: RobotLimits) -> Robot:
    if path.suffix.lower() == ".xacro":
        raise RobotFileError("xacro files must be expanded first: xacro robot.urdf.xacro > robot.urdf")
    files = RobotFiles(path, roots, limits)
    root = parse_xml(files.read_robot_file(), limits.max_elements)
    if root.tag == "robot":
        return _read_urdf(root, files, use, limits)
    if root.tag == "mujoco":
        if files.is_pipe:
            raise RobotFileError("MuJoCo reads files only, not pipes: write it into a file first")
        from gateway.robots.mjcf import read_mjcf

        return read_mjcf(root, files, use, limits)
    raise RobotFileError(f"its first element is <{root.tag[:60]}>; URDF starts with <robot>, MJCF with <mujoco>")


def _read_urdf(root: Element, files: RobotFiles, use: GeometryUse, limits: RobotLimits) -> Robot:
    model = parse_urdf(root, limits)
    names = tuple(link.name for link in model.links)
    kinematics = UrdfKinematics(names, model.joints)
    joints = {joint.name: joint.motion for joint in model.joints if joint.motion is not None}
    check_mimics(joints)
    converter = UrdfParts(files, limits)
    parts = tuple(
        converter.parts_of(link.name, link.visual if use == "visual" else link.collision) for link in model.links
    )
    return Robot(
        model.name or files.path.stem, names, joints, parts, kinematics, tuple(converter.warnings), files.digests
    )
