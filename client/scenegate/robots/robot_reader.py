"""Reads robot files: URDF or SDF, decided by the root element.

MJCF and xacro need packages of the server's, ``scenegate[robots]``.
"""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Literal, get_args

from scenegate.messages.arguments import describe
from scenegate.messages.geometry import Geometry
from scenegate.regular_files import reason_of
from scenegate.robots.link_geometry import LinkGeometries
from scenegate.robots.link_kinematics import LinkKinematics
from scenegate.robots.link_model import LinkModel
from scenegate.robots.robot import GeometryUse, Robot
from scenegate.robots.robot_errors import RobotFileError
from scenegate.robots.robot_files import RobotFiles
from scenegate.robots.robot_limits import RobotFileLimits
from scenegate.robots.sdf import parse_sdf
from scenegate.robots.urdf import parse_urdf
from scenegate.robots.xacro_args import XacroArgs, as_texts, expand_args, warn_of_unused
from scenegate.robots.xml_text import Element, parse_xml, uses_xacro
from scenegate.warning_text import strict_refusal

SUFFIXES: Final = (".urdf", ".sdf", ".world", ".xml", ".mjcf", ".xacro")
"""Suffixes of robot files."""


class NeedsServerError(RobotFileError):
    """Only the server's distribution can read the file."""


def read_robot(
    path: str | Path,
    *,
    roots: Iterable[str | Path] = (),
    geometry: GeometryUse = "visual",
    gltf_up: Literal["y", "z"] = "y",
    strict: bool = False,
    xacro_args: XacroArgs | None = None,
    limits: RobotFileLimits | None = None,
) -> Robot[Geometry]:
    """Read a URDF or SDF file. Its mesh files are not decoded: the viewer reads them.

    ``Robot.warnings`` has a sentence for each thing that cannot be drawn.

    Args:
        path: The file, which may be a pipe.
        roots: Folders to search for the packages of ``package://`` names, and for relative file names.
        geometry: Geometry of the links to return.
        gltf_up: Up axis of glTF meshes.
        strict: True: a warning is an error.
        xacro_args: Values of ``$(arg name)`` by name.
        limits: Limits; None: ``RobotFileLimits()``.

    Raises:
        RobotFileError: The file cannot be read, has no tree of links, or is beyond a limit; or ``strict`` is true and
            it has a warning. The message names the robot file and the reason.
        NeedsServerError: The file is MJCF or has xacro elements.
    """
    limits = limits or RobotFileLimits()
    warnings: list[str] = []
    if gltf_up not in ("y", "z"):
        raise RobotFileError(f"gltf_up must be 'y' or 'z', not {describe(gltf_up)}")
    with errors_of(path):
        args = as_texts(xacro_args or {})
        files = RobotFiles(Path(path), [Path(root) for root in roots], limits, xacro_args=args)
        root = parse_xml(files.read_robot_file(), limits.max_elements, warnings)
        if root.tag == "mujoco" or files.path.suffix.lower() == ".xacro" or uses_xacro(root):
            what = "MJCF" if root.tag == "mujoco" else "xacro"
            if files.is_pipe:
                raise RobotFileError(f"{what} is read from files only, not pipes: write it into a file first")
            raise NeedsServerError(f"{what} needs packages of the server: pip install 'scenegate[robots]'")
        expand_args(root, args, files.used_args, warnings)
        model = parse_links(root, files, geometry, limits, warnings)
        warn_of_unused(args, files.used_args, warnings)
        joints, kinematics = model.moving_joints(warnings), LinkKinematics(model)
        parts = LinkGeometries(files, warnings, gltf_up).of_links(model.links)
        sentences = tuple(dict.fromkeys(warnings))
        if strict and (refusal := strict_refusal(sentences)):
            raise RobotFileError(refusal)
        name = model.name or files.path.stem
        notes = tuple(files.notes)
        return Robot(name, model.link_names, joints, parts, kinematics, sentences, notes, files.digests)


def parse_links(
    root: Element, files: RobotFiles, use: GeometryUse, limits: RobotFileLimits, warnings: list[str]
) -> LinkModel:
    """Return the content of a URDF or SDF file. Warnings are appended to the list."""
    if use not in get_args(GeometryUse):
        raise RobotFileError(f"geometry must be 'visual' or 'collision', not {describe(use)}")
    if root.tag == "robot":
        return parse_urdf(root, use, limits, warnings)
    if root.tag in ("sdf", "gazebo"):  # gazebo: SDF before version 1.3
        return parse_sdf(root, files, use, limits, warnings)
    start = f"its first element is <{root.tag[:60]}>"
    raise RobotFileError(f"{start}; URDF starts with <robot>, SDF with <sdf>, MJCF with <mujoco>")


@contextmanager
def errors_of(path: str | Path) -> Iterator[None]:
    """Add the file's name to errors inside the context, and raise RobotFileError in place of OSError."""
    try:
        yield
    except (RobotFileError, OSError) as error:
        kind = type(error) if isinstance(error, RobotFileError) else RobotFileError
        raise kind(f"{os.fspath(path)}: {reason_of(error)}") from None
