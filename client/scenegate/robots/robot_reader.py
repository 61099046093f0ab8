"""Reads robot files: URDF or SDF, decided by the root element.

MJCF and xacro need packages of the server's, ``scenegate[robots]``.
"""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Literal, get_args

import msgspec
import numpy as np

from scenegate.messages.arguments import describe
from scenegate.messages.geometry import Box, Geometry, MeshGeometry, Transform
from scenegate.messages.mesh_file import MeshFile, referenced_files
from scenegate.regular_files import reason_of
from scenegate.robots.link_model import Cone, Link, LinkGeometry, LinkKinematics, LinkModel, MeshReference
from scenegate.robots.robot import GeometryUse, Robot
from scenegate.robots.robot_errors import RobotFileError, RobotFileLimits
from scenegate.robots.robot_files import LinkFiles, RobotFiles, color_of
from scenegate.robots.sdf import parse_sdf
from scenegate.robots.textured_box import obj_file, textured_box
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
    """Return the content of a URDF or SDF file. Warnings are appended to the list, notes to those of ``files``.

    In place of visual geometry, a robot that has none gets its collision geometry.
    """
    if use not in get_args(GeometryUse):
        raise RobotFileError(f"geometry must be 'visual' or 'collision', not {describe(use)}")
    if root.tag == "robot":
        model = parse_urdf(root, use, limits, warnings)
    elif root.tag in ("sdf", "gazebo"):  # gazebo: SDF before version 1.3
        model = parse_sdf(root, files, use, limits, warnings)
    else:
        start = f"its first element is <{root.tag[:60]}>"
        raise RobotFileError(f"{start}; URDF starts with <robot>, SDF with <sdf>, MJCF with <mujoco>")
    if use == "visual" and not any(link.geometries for link in model.links):
        collision = parse_links(root, files, "collision", limits, warnings)
        if any(link.geometries for link in collision.links):
            files.notes.append("it has no visual geometry that can be drawn; its collision geometry is drawn")
            return collision
    return model


@contextmanager
def errors_of(path: str | Path) -> Iterator[None]:
    """Add the file's name to errors inside the context, and raise RobotFileError in place of OSError."""
    try:
        yield
    except (RobotFileError, OSError) as error:
        kind = type(error) if isinstance(error, RobotFileError) else RobotFileError
        raise kind(f"{os.fspath(path)}: {reason_of(error)}") from None


_CONE_SEGMENTS: Final = 48


class LinkGeometries:
    """Converts geometry. Mesh and image files are sent as they are, with the files that meshes refer to."""

    def __init__(self, files: RobotFiles, warnings: list[str], gltf_up: Literal["y", "z"]) -> None:
        """``gltf_up``: up axis of glTF meshes. Those that Drake merged are Z up in any case."""
        self._files = files
        self._link_files = LinkFiles(files, warnings)
        self._warnings = warnings
        self._gltf_up = gltf_up

    def of_links(self, links: Iterable[Link]) -> tuple[tuple[Geometry, ...], ...]:
        """Return the geometry of each link. What cannot be read is left out with a warning."""
        return tuple(tuple(each for part in link.geometries for each in self._of(link.name, part)) for link in links)

    def _of(self, link: str, geometry: LinkGeometry) -> Iterator[Geometry]:
        shape, color, transform = geometry.shape, color_of(geometry.material), Transform.of(geometry.X_link_geometry)
        texture = self._link_files.texture(link, geometry.material, lambda path, data: data)
        if isinstance(shape, MeshReference):
            content = self._link_files.mesh(link, shape, lambda path, data: self._content(link, shape, path, data))
            if content is None:
                return
            if shape.center:
                self._warnings.append(f"link {link!r}, {shape.filename}: <center> is ignored, the mesh is not moved")
            is_gltf = shape.filename.lower().endswith((".gltf", ".glb"))
            yield MeshFile(
                shape.filename,
                shape.scale,
                data=content[0],
                files=content[1],
                up=None if is_gltf and self._gltf_up == "y" else "z",
                default_color=color,
                default_texture=texture,
                transform=transform,
            )
            return
        if texture is not None and isinstance(shape, Box):
            data = obj_file(textured_box(0.5 * np.array(shape.lengths)))
            yield MeshFile("box.obj", data=data, default_color=color, default_texture=texture, transform=transform)
            return
        if texture is not None:
            self._warnings.append(
                f"link {link!r}: its material's texture is not shown, only on meshes, boxes and planes"
            )
        if isinstance(shape, Cone):
            yield _cone(shape, color, transform)
        else:
            yield msgspec.structs.replace(shape, color=color, transform=transform)

    def _content(self, link: str, mesh: MeshReference, path: Path, data: bytes) -> tuple[bytes, dict[str, bytes]]:
        if mesh.submesh:
            self._warnings.append(f"link {link!r}, {mesh.filename}: <submesh> is ignored, the whole mesh is shown")
        suffix = Path(mesh.filename).suffix.lower()
        return data, referenced_files(data, suffix, lambda other: self._files.read_beside(path, other))


def _cone(cone: Cone, color: tuple[float, float, float, float], transform: Transform) -> MeshGeometry:
    """Return a cone: its tip is at length / 2, its base at -length / 2, as in FCL."""
    angles = np.linspace(0.0, 2.0 * np.pi, _CONE_SEGMENTS, endpoint=False)
    height, radius = 0.5 * cone.length, cone.radius
    rim = np.column_stack((radius * np.cos(angles), radius * np.sin(angles), np.full(len(angles), -height)))
    vertices = np.concatenate((rim, [(0.0, 0.0, height), (0.0, 0.0, -height)]))
    this, after = np.arange(_CONE_SEGMENTS), np.roll(np.arange(_CONE_SEGMENTS), -1)
    tip, centre = np.full(_CONE_SEGMENTS, _CONE_SEGMENTS), np.full(_CONE_SEGMENTS, _CONE_SEGMENTS + 1)
    faces = np.concatenate((np.column_stack((this, after, tip)), np.column_stack((after, this, centre))))
    return MeshGeometry(vertices, faces, color=color, transform=transform)
