"""``scenegate publish``: put a file into the live scene of a running viewer, Scenegate's or Director's."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gateway.cli.lcm_log import LcmUrl
from gateway.cli.robot_options import Joints, Roots
from gateway.runtime.regular_files import read_file_or_pipe

if TYPE_CHECKING:
    from gateway.client.tree.answer import Answer
    from gateway.client.tree.geometry import Geometry
    from gateway.client.tree.published import Changes
    from gateway.client.tree.published import Path as NodePath
    from gateway.client.tree.viewer import TreeViewer


def publish(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="SCENE.json|MESH|ROBOT",
            exists=True,
            dir_okay=False,
            help="A request of the protocol in JSON; a mesh: glb, gltf, obj, stl, ply, dae, vtk; or a robot file: "
            "urdf, xml (MJCF). A pipe without a suffix is a robot: <(xacro robot.urdf.xacro).",
        ),
    ],
    path: Annotated[str, typer.Option(help="Path in the tree: robot/base.")] = "",
    joint: Joints = None,
    root: Roots = None,
    collision: Annotated[
        bool, typer.Option("--collision", help="Publish a robot's collision geometry, not its visual geometry.")
    ] = False,
    textures: Annotated[
        bool, typer.Option(help="Publish textures and colours of vertices; other viewers refuse them.")
    ] = True,
    lcm_url: LcmUrl = None,
    timeout: Annotated[float, typer.Option(min=0.1, help="Seconds to wait for the viewer.")] = 10.0,
) -> None:
    """Publish a file at a path of the live scene, in place of everything at and below the path."""
    from gateway.client.tree.published import Changes, path_of
    from gateway.client.tree.viewer import TreeViewer
    from gateway.robots.reader import SUFFIXES

    top, name = path_of(path), source.stem if source.is_file() else "robot"
    if source.suffix.lower() in SUFFIXES or not (source.suffix or source.is_file()):
        with TreeViewer(lcm_url, timeout=timeout) as viewer:
            _print(_publish_robot(viewer, source, top or (name,), joint or [], root or [], collision, textures))
        return
    if joint or root or collision:
        raise ValueError(f"{source}: --joint, --root and --collision are for robot files ({', '.join(SUFFIXES)})")
    changes = Changes()
    if source.suffix.lower() == ".json":
        _read_request(source, top, changes)
    else:
        top = top or (source.stem,)
        changes.delete(top)
        changes.set(top, [geometry.body() for geometry in _read_mesh(source, textures)])
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
        raise ValueError(f"{source} is no request of the protocol: it has no delete, setgeometry or settransform")
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


def _read_mesh(source: Path, textures: bool) -> Iterator[Geometry]:
    """Yield a mesh file's triangles and points with their materials."""
    from gateway.assets.mesh_files import MeshFiles
    from gateway.client.tree.part_images import PartImages
    from gateway.client.tree.parts import geometries_of

    parts = MeshFiles([source.parent]).load(str(source.resolve()))
    images = PartImages() if textures else None
    for part in parts:
        yield from geometries_of(part, images)


def _publish_robot(
    viewer: TreeViewer,
    source: Path,
    root: NodePath,
    joints: list[str],
    roots: list[Path],
    collision: bool,
    textures: bool,
) -> Answer:
    """Publish a robot file with a path for each link."""
    from gateway.robots.joint_text import parse_joints

    robot = viewer.robot(
        root,
        source,
        joints=parse_joints(joints),
        roots=roots,
        geometry="collision" if collision else "visual",
        textures=textures,
    )
    for warning in robot.warnings:
        typer.echo(f"{source}: {warning}", err=True)
    return robot.answer


def _print(answer: Answer) -> None:
    for warning in answer.warnings:
        typer.echo(warning, err=True)
    for name, paths in (("deleted", answer.deleted), ("set", answer.added), ("moved", answer.transformed)):
        if paths:
            more = f" and {len(paths) - 10} more" if len(paths) > 10 else ""
            typer.echo(f"{name}: {', '.join('/'.join(map(str, path)) or '/' for path in paths[:10])}{more}")
