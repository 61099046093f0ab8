"""``scenegate publish``: put a file into the live scene of a running viewer, Scenegate's or Director's."""

import argparse
import contextlib
import json
import logging
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from scenegate.cli.options import add_lcm_url, at_least, existing_file, existing_folder
from scenegate.cli.output import print_line, print_note
from scenegate.messages.changes import Changes, Entry, path_of
from scenegate.messages.changes import Path as NodePath
from scenegate.messages.mesh_file import MeshFile
from scenegate.regular_files import is_pipe, read_file_or_pipe
from scenegate.robots.joint_text import parse_joints
from scenegate.robots.robot_reader import SUFFIXES
from scenegate.robots.xacro_args import parse_xacro_args
from scenegate.tree.answer import Answer, TreeViewerError
from scenegate.tree.control_panel import JointSliders
from scenegate.tree.node_handles import PublishedRobot
from scenegate.tree.viewer import TreeViewer
from scenegate.warning_text import NOTHING_DRAWN, NOTHING_OF_ROBOT, joined_warnings, strict_refusal

Y_UP: Final = {"translation": [0.0, 0.0, 0.0], "quaternion": [0.5**0.5, 0.5**0.5, 0.0, 0.0]}
"""Transform of a mesh file with Y up."""
RELOAD_SECONDS: Final = 0.5
"""Interval at which ``--reload`` checks the files of a robot for changes."""
_REQUEST_FIELDS: Final = frozenset({"timestamp", "delete", "setgeometry", "settransform"})
_GEOMETRY_FIELDS: Final = frozenset({"path", "geometry", "geometries"})


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments and options."""
    add = parser.add_argument
    help_text = (
        "a request of the protocol in JSON; a mesh: glb, gltf, obj, stl, ply, dae, vtk; or a robot file: urdf, sdf, "
        "xacro, xml (MJCF). A pipe is a robot: <(xacro robot.urdf.xacro), or - for the standard input"
    )
    add("source", metavar="SCENE.json|MESH|ROBOT", type=existing_file, help=help_text)
    add("--path", default="", help="path in the tree: robot/base")
    help_text = "up axis of a mesh file; auto: as its format and content say (default: auto)"
    add("--up", choices=("auto", "y", "z"), default="auto", help=help_text)
    help_text = "factor of all lengths of a mesh file: 0.001 for millimetres (default: 1)"
    add("--scale", type=at_least(1e-9), default=1.0, metavar="FACTOR", help=help_text)
    help_text = "refuse a file of which something cannot be drawn, instead of a warning"
    add("--strict", action="store_true", help=help_text)
    add_lcm_url(parser)
    help_text = "seconds to wait for the viewer (default: 10)"
    add("--timeout", type=at_least(0.1), default=10.0, metavar="SECONDS", help=help_text)
    robot = parser.add_argument_group("robots").add_argument
    help_text = (
        "joint value of a robot file, in radians or metres; several numbers separated by commas for joints that have "
        "several. Can be repeated"
    )
    robot("--joint", action="append", default=[], metavar="NAME=VALUE", help=help_text)
    help_text = "folder with the packages of a robot file's package:// names. Can be repeated"
    robot("--root", action="append", default=[], type=existing_folder, metavar="FOLDER", help=help_text)
    help_text = "value of an argument of a xacro file, $(arg NAME). Can be repeated"
    robot("--xacro-arg", action="append", default=[], metavar="NAME:=VALUE", help=help_text)
    help_text = "keyframe of an MJCF file, which has the joints' values"
    robot("--keyframe", default="", metavar="NAME", help=help_text)
    help_text = "up axis of a robot's glTF meshes; auto: the one that fits the collision geometry (default: y)"
    robot("--robot-gltf-up", choices=("y", "z", "auto"), default="y", help=help_text)
    help_text = "publish a robot's collision geometry, not its visual geometry"
    robot("--collision", action="store_true", help=help_text)
    help_text = "publish textures and colours of vertices; other viewers refuse them (default: --textures)"
    robot("--textures", action=argparse.BooleanOptionalAction, default=True, help=help_text)
    help_text = (
        "show a slider for each joint of a robot in the page, which moves it until Ctrl+C; without, the command ends "
        "when the robot is published (default: --sliders)"
    )
    robot("--sliders", action=argparse.BooleanOptionalAction, default=True, help=help_text)
    help_text = "publish a robot again whenever it or a mesh of it changes, until Ctrl+C"
    robot("--reload", action="store_true", help=help_text)


def run(options: argparse.Namespace) -> None:
    """Publish a file, in place of everything at and below the path."""
    source: Path = options.source
    logging.getLogger("scenegate.tree.viewer").setLevel(logging.ERROR)  # the command prints the viewer's warnings
    piped = is_pipe(source)
    if source.suffix.lower() in SUFFIXES or (piped and not source.suffix):
        if options.reload and piped:
            raise ValueError(f"{source}: --reload needs a file, not a pipe")
        if options.scale != 1.0:
            raise ValueError(f"{source}: --scale is for mesh files, a robot file has a scale for each mesh")
        if options.up != "auto":
            raise ValueError(f"{source}: --up is for mesh files; --robot-gltf-up is for a robot's glTF meshes")
        _publish_robot(options, path_of(options.path) or ("robot" if piped else source.stem,))
        return
    if any((options.joint, options.root, options.xacro_arg, options.keyframe, options.collision, options.reload)):
        flags = "--joint, --root, --xacro-arg, --keyframe, --collision and --reload"
        raise ValueError(f"{source}: {flags} are for robot files ({', '.join(SUFFIXES)})")
    if source.suffix.lower() == ".json":
        if options.up != "auto" or options.scale != 1.0:
            raise ValueError(f"{source}: --up and --scale are for mesh files")
        changes = Changes()
        _read_request(source, path_of(options.path), changes)
        with TreeViewer(options.lcm_url, options.timeout) as viewer:
            _print(viewer.send(changes))
    else:
        _publish_mesh(options, path_of(options.path) or (source.stem,))


def _publish_robot(options: argparse.Namespace, top: NodePath) -> None:
    """Publish a robot at a path. With sliders or ``--reload``, this goes on until Ctrl+C."""
    source: Path = options.source

    def publish(viewer: TreeViewer) -> PublishedRobot:
        return viewer.robot(
            top,
            source,
            joints=parse_joints(options.joint),
            roots=options.root,
            geometry="collision" if options.collision else "visual",
            textures=options.textures,
            keyframe=options.keyframe,
            gltf_up=options.robot_gltf_up,
            strict=options.strict,
            xacro_args=parse_xacro_args(options.xacro_arg),
        )

    with contextlib.suppress(KeyboardInterrupt), TreeViewer(options.lcm_url, options.timeout) as viewer:
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # the sliders are removed
        if options.reload:
            _publish_on_change(viewer, source, publish, options.sliders)
            return
        robot = publish(viewer)
        _print_robot(source, robot)
        if robot.drawn_count == 0:
            if options.strict or robot.warnings or robot.answer.warnings:
                raise ValueError(f"{source}: {NOTHING_OF_ROBOT}")
            print_note(f"{source}: {NOTHING_OF_ROBOT}")
        if options.sliders and _add_sliders(viewer, robot) is not None:
            print_note("The page shows a slider for each joint, until Ctrl+C.")
            while True:  # not an event: on Windows, Ctrl+C does not interrupt waiting for one
                time.sleep(1.0)


def _publish_mesh(options: argparse.Namespace, top: NodePath) -> None:
    """Publish a mesh file at a path; remove it again if nothing of it is drawn, or ``--strict`` refuses it."""
    source: Path = options.source
    mesh = MeshFile.read(source, scale=options.scale, up=None if options.up == "auto" else "z")
    changes = Changes()
    changes.delete(top)
    changes.set_entry(top, Entry([mesh.body()], Y_UP if options.up == "y" else None))
    with TreeViewer(options.lcm_url, options.timeout) as viewer:
        answer = viewer.send(changes)
        failed = joined_warnings([warning for warning in answer.warnings if warning.endswith(NOTHING_DRAWN)])
        if failed := (strict_refusal(answer.warnings) if options.strict else failed):
            viewer[top].delete()
            raise ValueError(f"{source}: {failed}")
    _print(answer)


def _read_request(source: Path, root: NodePath, changes: Changes) -> None:
    """Add the commands of a request in JSON, with ``root`` before their paths."""
    try:
        request = json.loads(read_file_or_pipe(source))
    except ValueError as error:
        raise ValueError(f"{source} is not JSON: {error}") from None
    except RecursionError:
        raise ValueError(f"{source} is nested too deeply") from None
    if not isinstance(request, dict) or not {"delete", "setgeometry", "settransform"} & request.keys():
        raise ValueError(f"{source} is not a request of the protocol: it has no delete, setgeometry or settransform")
    _note_unknown(request, _REQUEST_FIELDS, f"{source}")
    for path, _ in _commands(request, "delete", source):
        changes.delete(root + path)
    for path, command in _commands(request, "setgeometry", source):
        _note_unknown(command, _GEOMETRY_FIELDS, f"{source}: setgeometry of {path!r}")
        geometries = [command["geometry"]] if command.get("geometry") else command.get("geometries") or []
        if not isinstance(geometries, list):
            raise ValueError(f"{source}: the geometries of {path!r} are not a list")
        changes.set_entry(root + path, Entry(geometries))
    for path, command in _commands(request, "settransform", source):
        changes.set_entry(root + path, Entry(transform=command.get("transform") or {}))


def _note_unknown(fields: dict[str, Any], known: frozenset[str], place: str) -> None:
    if unknown := fields.keys() - known:
        print_note(f"{place}: publish ignores {', '.join(map(repr, sorted(unknown)))}")


def _commands(request: dict[str, Any], name: str, source: Path) -> Iterator[tuple[NodePath, dict[str, Any]]]:
    """Yield path and fields of each command in a list of the request."""
    commands = request.get(name) or []
    if not isinstance(commands, list):
        raise ValueError(f"{source}: {name} is not a list")
    for index, command in enumerate(commands):
        path = command.get("path") if isinstance(command, dict) else None
        if not isinstance(path, (list, str)):
            raise ValueError(f"{source}: {name}[{index}] has no path")
        if not all(isinstance(element, str | int) for element in path):
            raise ValueError(f"{source}: {name}[{index}].path has an element that is neither a name nor an integer")
        yield path_of(path) if isinstance(path, str) else tuple(path), command


def _publish_on_change(
    viewer: TreeViewer, source: Path, publish_robot: Callable[[TreeViewer], PublishedRobot], with_sliders: bool
) -> None:
    """Publish a robot, and again whenever one of its files changes. Errors of the files are printed."""
    change_times: dict[Path, float | None] = {source: None}
    """Time of the last change of each file of the robot that was published; None: to be read again."""
    sliders: JointSliders | None = None
    while True:
        if all(_change_time(path) == published_time for path, published_time in change_times.items()):
            time.sleep(RELOAD_SECONDS)
            continue
        began = time.time()
        change_times = {path: _change_time(path) for path in change_times}
        try:
            robot = publish_robot(viewer)
        except (ValueError, ImportError) as error:
            print_note(str(error))
            continue
        _print_robot(source, robot)
        if with_sliders:
            earlier_values = {} if sliders is None else sliders.values
            sliders = _add_sliders(viewer, robot)
            if sliders is not None:
                sliders.set({name: value for name, value in earlier_values.items() if name in sliders.sliders})
        for path in (source.parent / name for name in robot.files):
            change_time = _change_time(path)
            # A file that may have changed since it was read counts as changed: the robot is published once more.
            may_have_changed_since_read = change_time is not None and change_time >= began - RELOAD_SECONDS
            change_times.setdefault(path, None if may_have_changed_since_read else change_time)


def _add_sliders(viewer: TreeViewer, robot: PublishedRobot) -> JointSliders | None:
    """Show sliders for the joints of a robot. Return None if it has no such joints, or the viewer shows none."""
    try:
        viewer.controls.delete()
        sliders = viewer.controls.add_joint_sliders(robot)
    except (TreeViewerError, ValueError) as error:
        print_note(f"no sliders: {error}")
        return None
    return sliders if sliders.sliders else None


def _change_time(path: Path) -> float | None:
    """Return the time of a file's last change; None if there is no such file."""
    try:
        return path.stat().st_mtime
    except OSError:
        return None


def _print_robot(source: Path, robot: PublishedRobot) -> None:
    for sentence in (*robot.warnings, *robot.notes):
        print_note(f"{source}: {sentence}")
    _print(robot.answer)


def _print(answer: Answer) -> None:
    for warning in answer.warnings:
        print_note(warning)
    for name, paths in (("deleted", answer.deleted), ("set", answer.added), ("moved", answer.transformed)):
        if paths:
            more = f" and {len(paths) - 10} more" if len(paths) > 10 else ""
            print_line(f"{name}: {', '.join('/'.join(map(str, path)) or '/' for path in paths[:10])}{more}")
