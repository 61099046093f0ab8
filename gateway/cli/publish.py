"""``scenegate publish``: put a file into the live scene of a running viewer, Scenegate's or Director's."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from gateway.cli.lcm_log import LcmUrl
from gateway.cli.robot_options import GltfUp, Joints, Keyframe, Roots, Strict
from gateway.runtime.regular_files import read_file_or_pipe

if TYPE_CHECKING:
    from gateway.client.tree.answer import Answer
    from gateway.client.tree.geometry import Geometry
    from gateway.client.tree.published import Changes
    from gateway.client.tree.published import Path as NodePath
    from gateway.client.tree.robot import PublishedRobot
    from gateway.client.tree.viewer import TreeViewer

RELOAD_SECONDS: Final = 0.5
"""Interval at which ``--reload`` checks the files of a robot for changes."""


def publish(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="SCENE.json|MESH|ROBOT",
            exists=True,
            dir_okay=False,
            help="A request of the protocol in JSON; a mesh: glb, gltf, obj, stl, ply, dae, vtk; or a robot file: "
            "urdf, sdf, xacro, xml (MJCF). A pipe without a suffix is a robot: <(xacro robot.urdf.xacro).",
        ),
    ],
    path: Annotated[str, typer.Option(help="Path in the tree: robot/base.")] = "",
    joint: Joints = None,
    root: Roots = None,
    keyframe: Keyframe = "",
    robot_gltf_up: GltfUp = "y",
    collision: Annotated[
        bool, typer.Option("--collision", help="Publish a robot's collision geometry, not its visual geometry.")
    ] = False,
    textures: Annotated[
        bool, typer.Option(help="Publish textures and colours of vertices; other viewers refuse them.")
    ] = True,
    strict: Strict = False,
    reload: Annotated[
        bool, typer.Option("--reload", help="Publish a robot again whenever it or a mesh of it changes, until Ctrl+C.")
    ] = False,
    lcm_url: LcmUrl = None,
    timeout: Annotated[float, typer.Option(min=0.1, help="Seconds to wait for the viewer.")] = 10.0,
) -> None:
    """Publish a file at a path of the live scene, in place of everything at and below the path."""
    from gateway.client.tree.published import Changes, path_of
    from gateway.client.tree.viewer import TreeViewer
    from gateway.robots.joint_text import parse_joints
    from gateway.robots.reader import SUFFIXES

    top, name = path_of(path), source.stem if source.is_file() else "robot"
    if source.suffix.lower() in SUFFIXES or not (source.suffix or source.is_file()):
        if reload and not source.is_file():
            raise ValueError(f"{source}: --reload needs a file, not a pipe")

        def publish_robot(viewer: TreeViewer) -> PublishedRobot:
            return viewer.robot(
                top or (name,),
                source,
                joints=parse_joints(joint or ()),
                roots=root or (),
                geometry="collision" if collision else "visual",
                textures=textures,
                keyframe=keyframe,
                gltf_up=robot_gltf_up,
                strict=strict,
            )

        with TreeViewer(lcm_url, timeout=timeout) as viewer:
            if reload:
                _publish_on_change(viewer, source, publish_robot)
            else:
                _print_robot(source, publish_robot(viewer))
        return
    if joint or root or keyframe or collision or reload:
        flags = "--joint, --root, --keyframe, --collision and --reload"
        raise ValueError(f"{source}: {flags} are for robot files ({', '.join(SUFFIXES)})")
    changes = Changes()
    if source.suffix.lower() == ".json":
        _read_request(source, top, changes)
    else:
        top = top or (source.stem,)
        changes.delete(top)
        changes.set(top, [geometry.body() for geometry in _read_mesh(source, textures, strict)])
    with TreeViewer(lcm_url, timeout=timeout) as viewer:
        answer = viewer.send(changes)
    _print(answer)


def _read_request(source: Path, root: NodePath, changes: Changes) -> None:
    """Add the commands of a request in JSON, with ``root`` before their paths."""
    try:
        request = json.loads(read_file_or_pipe(source))
    except ValueError as error:
        raise ValueError(f"{source} is not JSON: {error}") from None
    if not isinstance(request, dict) or not {"delete", "setgeometry", "settransform"} & request.keys():
        raise ValueError(f"{source} is not a request of the protocol: it has no delete, setgeometry or settransform")
    for path, _ in _commands(request, "delete", source):
        changes.delete(root + path)
    for path, command in _commands(request, "setgeometry", source):
        geometries = [command["geometry"]] if command.get("geometry") else command.get("geometries") or []
        changes.set(root + path, geometries)
    for path, command in _commands(request, "settransform", source):
        changes.transform(root + path, command.get("transform") or {})


def _commands(request: dict[str, Any], name: str, source: Path) -> Iterator[tuple[NodePath, dict[str, Any]]]:
    """Yield path and fields of each command in a list of the request."""
    from gateway.client.tree.published import path_of

    for index, command in enumerate(request.get(name) or ()):
        path = command.get("path") if isinstance(command, dict) else None
        if not isinstance(path, (list, str)):
            raise ValueError(f"{source}: {name}[{index}] has no path")
        yield path_of(path) if isinstance(path, str) else tuple(path), command


def _read_mesh(source: Path, textures: bool, strict: bool) -> Iterator[Geometry]:
    """Yield a mesh file's triangles and points with their materials."""
    from gateway.assets.mesh_files import MeshFiles
    from gateway.client.tree.part_images import PartImages
    from gateway.client.tree.parts import geometries_of
    from gateway.runtime.warning_list import strict_refusal

    warnings: list[str] = []
    parts = MeshFiles([source.parent]).load(str(source.resolve()), warnings=warnings)
    if strict and warnings:
        raise ValueError(f"{source}: {strict_refusal(warnings)}")
    for warning in warnings:
        typer.echo(warning, err=True)
    images = PartImages() if textures else None
    for part in parts:
        yield from geometries_of(part, images)


def _publish_on_change(viewer: TreeViewer, source: Path, publish_robot: Callable[[TreeViewer], PublishedRobot]) -> None:
    """Publish a robot, and again whenever one of its files changes. Errors of the files are printed."""
    stamps: dict[Path, float | None] = {source: None}
    while True:
        if all(_changed(path) == stamp for path, stamp in stamps.items()):
            time.sleep(RELOAD_SECONDS)
            continue
        began = time.time()
        stamps = {path: _changed(path) for path in stamps}
        try:
            robot = publish_robot(viewer)
        except (ValueError, ImportError) as error:
            typer.echo(str(error), err=True)
            continue
        _print_robot(source, robot)
        for path in (source.parent / name for name in robot.files):
            changed = _changed(path)
            # A new file may have changed since it was read: then the robot is published once more.
            stamps.setdefault(path, changed if changed is None or changed < began - RELOAD_SECONDS else None)


def _changed(path: Path) -> float | None:
    """Return the time of a file's last change; None if there is no such file."""
    try:
        return path.stat().st_mtime
    except OSError:
        return None


def _print_robot(source: Path, robot: PublishedRobot) -> None:
    for sentence in (*robot.warnings, *robot.notes):
        typer.echo(f"{source}: {sentence}", err=True)
    _print(robot.answer)


def _print(answer: Answer) -> None:
    for warning in answer.warnings:
        typer.echo(warning, err=True)
    for name, paths in (("deleted", answer.deleted), ("set", answer.added), ("moved", answer.transformed)):
        if paths:
            more = f" and {len(paths) - 10} more" if len(paths) > 10 else ""
            typer.echo(f"{name}: {', '.join('/'.join(map(str, path)) or '/' for path in paths[:10])}{more}")
