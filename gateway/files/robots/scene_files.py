"""Reads scene files that the operator names: glTF, meshes and robots, by the suffix of the file's name."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from gateway.files.assets.mesh_formats import FORMATS, MESH_LIMITS, MeshFormatError, parse_mesh
from gateway.files.assets.scene_file import SceneFile, SceneFileError, read_scene_file, scaled
from gateway.files.gltf import AnimationTime, GltfError, Up
from gateway.files.robots.reader import RobotGltfUp, read_robot
from gateway.scene.tree.nodes import Node
from gateway.scene.tree.transforms import IDENTITY, Y_UP_TO_Z_UP
from scenegate.regular_files import MAX_BYTES, errors_as, is_pipe
from scenegate.robots.joint_text import parse_joints
from scenegate.robots.robot_errors import RobotFileError, RobotFileLimits
from scenegate.robots.robot_files import RobotFiles
from scenegate.robots.robot_reader import SUFFIXES as ROBOT_SUFFIXES
from scenegate.robots.xacro_args import parse_xacro_args
from scenegate.warning_text import NOTHING_OF_ROBOT, strict_refusal

GLTF_SUFFIXES: Final = (".gltf", ".glb")
_OTHER_MESH_SUFFIXES: Final = sorted({f".{extension}" for extension in FORMATS} - {*GLTF_SUFFIXES})
SCENE_SUFFIXES: Final = (*GLTF_SUFFIXES, *_OTHER_MESH_SUFFIXES, *ROBOT_SUFFIXES)
"""Suffixes of scene files."""
AMBIGUOUS_SUFFIXES: Final = (".xml", ".world", ".xacro")
"""Suffixes of robots, but also of files that are none, or only a part of one."""
_MESH_FILE_LIMITS: Final = RobotFileLimits(max_mesh_bytes=MAX_BYTES, max_total_bytes=2 * MAX_BYTES)
FOLDER_SUFFIXES: Final = tuple(suffix for suffix in SCENE_SUFFIXES if suffix not in AMBIGUOUS_SUFFIXES)
"""Suffixes of the scene files in a folder. One with an ambiguous suffix is read only if it is named itself."""


@dataclass(frozen=True, slots=True)
class SceneOptions:
    """Options for reading a scene file. Those for another kind of file have no effect; a note says so."""

    up: Up = "auto"
    """Up axis of a glTF or mesh file; ``auto``: see ``read_scene_file`` and ``parse_mesh``."""
    scale: float = 1.0
    """Factor of all lengths: 0.001 for a file in millimetres."""
    joints: tuple[str, ...] = ()
    """Joint values of a robot, as ``name=value``. Other joints have the values of the file."""
    roots: tuple[str | Path, ...] = ()
    """Folders with the packages of a robot's ``package://`` names."""
    xacro_args: tuple[str, ...] = ()
    """Arguments of a xacro file, as ``name:=value``."""
    variant: str = ""
    """Variant of a glTF file's materials; empty: the default materials."""
    keyframe: str = ""
    """Keyframe of an MJCF robot."""
    robot_gltf_up: RobotGltfUp = "y"
    """Up axis of a robot's glTF meshes."""
    strict: bool = False
    """True: a warning is an error."""
    animation: AnimationTime | None = None
    """Animation of a glTF file, and its time; None: the pose in which its nodes are stored."""


DEFAULT_OPTIONS: Final = SceneOptions()
_FLAGS: Final = {
    "up": "--up",
    "scale": "--scale",
    "variant": "--variant",
    "joints": "--joint",
    "xacro_args": "--xacro-arg",
    "keyframe": "--keyframe",
    "robot_gltf_up": "--robot-gltf-up",
}
"""Flags by the names of options that some kinds of files have no use for."""


def without_effect(options: SceneOptions, used: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return a sentence for each option that differs from the default and is not among those that are ``used``."""
    given = [name for name in _FLAGS if getattr(options, name) != getattr(DEFAULT_OPTIONS, name)]
    return tuple(f"{_FLAGS[name]} has no effect on a file of this kind" for name in given if name not in used)


def read_scene(path: Path, options: SceneOptions = DEFAULT_OPTIONS) -> SceneFile:
    """Read a scene file. A mesh becomes a node with the file's name; a robot becomes a node with a child for each link.

    Raises SceneFileError, with the file's name, also for a warning if ``options.strict`` is true.
    """
    suffix = path.suffix.lower()
    if suffix in GLTF_SUFFIXES:
        scene = read_scene_file(path, up=options.up, variant=options.variant or None, animation=options.animation)
        notes = without_effect(options, ("up", "scale", "variant"))
    elif suffix in ROBOT_SUFFIXES or (not suffix and is_pipe(path)):
        scene = _read_robot(path, options)
        notes = without_effect(options, ("scale", "joints", "xacro_args", "keyframe", "robot_gltf_up"))
    elif suffix in SCENE_SUFFIXES:
        scene = _read_mesh(path, suffix, options.up)
        notes = without_effect(options, ("up", "scale"))
    else:
        raise SceneFileError(f"{path}: its suffix is not one of {', '.join(SCENE_SUFFIXES)}")
    scene = replace(scene, notes=(*scene.notes, *notes))
    if options.strict and (refusal := strict_refusal(scene.warnings)):
        raise SceneFileError(f"{path}: {refusal}")
    return scaled(scene, options.scale)


def _read_robot(path: Path, options: SceneOptions) -> SceneFile:
    try:
        robot = read_robot(
            path,
            roots=options.roots,
            keyframe=options.keyframe,
            gltf_up=options.robot_gltf_up,
            xacro_args=parse_xacro_args(options.xacro_args),
        )
        root = robot.tree(parse_joints(options.joints))
    except (RobotFileError, ImportError) as error:
        raise SceneFileError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None
    warnings = robot.warnings
    if not any(robot.parts):
        warnings = (*warnings, NOTHING_OF_ROBOT)
        if options.strict:
            raise SceneFileError(f"{path}: {strict_refusal((NOTHING_OF_ROBOT, *robot.warnings))}")
    return SceneFile(root, warnings=warnings, notes=robot.notes, digests=robot.digests)


def _read_mesh(path: Path, suffix: str, up: Up) -> SceneFile:
    """Read a mesh file, which may refer to files in any folder, as in a robot file."""
    files, mesh = RobotFiles(path, (), _MESH_FILE_LIMITS), path.resolve()
    warnings: list[str] = []
    with errors_as(SceneFileError, path, MeshFormatError, GltfError, RobotFileError):
        data = files.read(mesh)
        parts = parse_mesh(
            data,
            suffix[1:],
            lambda name: files.read_beside(mesh, name),
            MESH_LIMITS,
            warnings,
            collada_up_axis=up == "auto",
        )
    root = Node(None, Y_UP_TO_Z_UP if up == "y" else IDENTITY, {path.stem: Node(parts)})
    return SceneFile(root, warnings=tuple(warnings), digests=files.digests)
