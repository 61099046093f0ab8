"""Reads robot files: URDF, SDF or MJCF, decided by the root element."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from gateway.robots.gltf_up import RobotGltfUp, nearer_up
from gateway.robots.limits import RobotLimits
from gateway.robots.link_parts import LinkParts
from gateway.robots.robot import Robot
from gateway.robots.xacro_files import expand_xacro
from gateway.scene.geometry import Part
from renderers.stop import check_stop
from scenegate.robots.errors import RobotFileError
from scenegate.robots.files import RobotFiles
from scenegate.robots.link_kinematics import LinkKinematics
from scenegate.robots.link_model import LinkModel
from scenegate.robots.reader import errors_of, parse_links
from scenegate.robots.robot import GeometryUse, without_invalid_mimics
from scenegate.robots.xml_text import parse_xml, uses_xacro
from scenegate.warning_text import strict_refusal


def read_robot(
    path: str | Path,
    *,
    roots: Iterable[str | Path] = (),
    geometry: GeometryUse = "visual",
    keyframe: str = "",
    gltf_up: RobotGltfUp = "y",
    strict: bool = False,
    limits: RobotLimits | None = None,
) -> Robot:
    """Read a robot file. All that can be drawn is drawn; ``Robot.warnings`` has a sentence for each thing that cannot.

    Args:
        path: A URDF, SDF, MJCF or xacro file.
        roots: Folders to search for the packages of ``package://`` names, and for relative file names.
        geometry: Geometry of the links to return.
        keyframe: Name of an MJCF file's ``<key>``, which has the joints' default values. Empty: those of the model.
        gltf_up: Up axis of glTF meshes in URDF and SDF.
        strict: True: a warning is an error.
        limits: Limits; None: ``RobotLimits()``.

    Raises:
        RobotFileError: The file cannot be read, has no tree of links, or is beyond a limit; or ``strict`` is true and
            it has a warning. The message names the robot file and the reason.
        ImportError: The file is MJCF or has xacro elements, and the package ``mujoco`` or ``xacro`` is not installed.
    """
    with errors_of(path):
        reader = _Reader(Path(path), tuple(Path(root) for root in roots), limits or RobotLimits())
        robot = reader.read(geometry, keyframe, gltf_up)
        if strict and robot.warnings:
            raise RobotFileError(strict_refusal(robot.warnings))
        return robot


class _Reader:
    """Reads one robot file."""

    def __init__(self, path: Path, roots: tuple[Path, ...], limits: RobotLimits) -> None:
        self._files = RobotFiles(path, roots, limits, check_stop)
        self._limits = limits
        self._warnings: list[str] = []
        self._root = parse_xml(self._files.read_robot_file(), limits.max_elements, self._warnings)
        if path.suffix.lower() == ".xacro" or uses_xacro(self._root):
            self._root = parse_xml(expand_xacro(self._files, limits), limits.max_elements, self._warnings)

    def read(self, use: GeometryUse, keyframe: str, gltf_up: RobotGltfUp) -> Robot:
        if self._root.tag == "mujoco":
            if self._files.is_pipe:
                raise RobotFileError("MuJoCo reads files only, not pipes: write it into a file first")
            from gateway.robots.mjcf import read_mjcf

            return read_mjcf(self._root, self._files, use, keyframe, self._limits)
        if keyframe:
            raise RobotFileError("only MJCF files have keyframes")
        model = parse_links(self._root, self._files, use, self._limits, self._warnings)
        joints = {joint.name: joint.motion for joint in model.joints if joint.motion is not None}
        joints = without_invalid_mimics(joints, self._warnings)
        kinematics = LinkKinematics(model)
        parts, notes = self._parts(model, use, gltf_up)
        return Robot(
            model.name or self._files.path.stem,
            tuple(link.name for link in model.links),
            joints,
            parts,
            kinematics,
            tuple(dict.fromkeys(self._warnings)),
            notes,
            self._files.digests,
        )

    def _parts(
        self, model: LinkModel, use: GeometryUse, gltf_up: RobotGltfUp
    ) -> tuple[tuple[tuple[Part, ...], ...], tuple[str, ...]]:
        """Return the parts of all links, and with ``gltf_up="auto"`` a note about the up axis that was chosen."""
        if gltf_up != "auto":
            return LinkParts(self._files, self._limits, self._warnings, gltf_up).parts_of_links(model.links), ()
        y_up = LinkParts(self._files, self._limits, self._warnings, "y").parts_of_links(model.links)
        z_up = LinkParts(self._files, self._limits, [], "z").parts_of_links(model.links)
        collision_links = parse_links(self._root, self._files, "collision", self._limits, []).links
        collision = LinkParts(self._files, self._limits, [], "y").parts_of_links(collision_links)
        up = nearer_up(y_up, z_up, collision)
        note = f"glTF meshes are taken as {up.upper()} up: their bounds are nearer to those of the collision geometry"
        return (z_up if up == "z" else y_up), (note,)
