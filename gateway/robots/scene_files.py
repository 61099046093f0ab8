"""Reads scene files that the operator names: glTF, meshes and robots, by the suffix of the file's name."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

from gateway.assets.mesh_formats import FORMATS, MESH_LIMITS, MeshFormatError, parse_mesh
from gateway.assets.scene_file import FolderFiles, SceneFile, SceneFileError, Up, read_scene_file
from gateway.gltf import GltfError
from gateway.robots.errors import RobotFileError
from gateway.robots.joint_text import parse_joints
from gateway.robots.reader import SUFFIXES, read_robot
from gateway.scene.tree import Node

_GLTF_SUFFIXES: Final = (".gltf", ".glb")
SCENE_SUFFIXES: Final = (*_GLTF_SUFFIXES, *sorted({f".{name}" for name in FORMATS} - set(_GLTF_SUFFIXES)), *SUFFIXES)
"""Suffixes of scene files."""


def read_scene(
    path: Path, *, up: Up = "auto", joints: Iterable[str] = (), roots: Iterable[str | Path] = ()
) -> SceneFile:
    """Read a scene file. A mesh becomes a node with the file's name; a robot becomes a node with a child for each link.

    Args:
        up: Up axis of a glTF file, see ``read_scene_file``. Other files are not rotated.
        joints: Joint values of a robot, as ``name=value``. Other joints have the values of the file.
        roots: Folders with the packages of a robot's ``package://`` names.

    Raises:
        SceneFileError: The file or a joint value is invalid, or a limit is exceeded. The message names the file.
    """
    suffix = path.suffix.lower()
    if suffix in _GLTF_SUFFIXES:
        return read_scene_file(path, up=up)
    if suffix in SUFFIXES:
        return _read_robot(path, joints, roots)
    if suffix in SCENE_SUFFIXES:
        return _read_mesh(path, suffix)
    raise SceneFileError(f"{path}: its suffix is not one of {', '.join(SCENE_SUFFIXES)}")


def _read_robot(path: Path, joints: Iterable[str], roots: Iterable[str | Path]) -> SceneFile:
    try:
        robot = read_robot(path, roots=roots)
        root = robot.tree(parse_joints(joints))
    except (RobotFileError, ImportError) as error:
        raise SceneFileError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None
    return SceneFile(root, warnings=robot.warnings, digests=robot.digests)


def _read_mesh(path: Path, suffix: str) -> SceneFile:
    files = FolderFiles(path)
    try:
        parts = parse_mesh(files.read_scene(), suffix[1:], files.resolve, MESH_LIMITS)
    except OSError as error:
        raise SceneFileError(f"{path}: {error.strerror or error}") from None
    except (MeshFormatError, GltfError) as error:
        raise SceneFileError(f"{path}: {error}") from None
    return SceneFile(Node(None, children={path.stem: Node(parts)}), digests=files.digests)
