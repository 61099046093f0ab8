"""``scenegate publish``: put a file into the live scene of a running viewer, Scenegate's or Director's."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gateway.cli.lcm_log import LcmUrl

if TYPE_CHECKING:
    from gateway.client.tree.answer import Answer
    from gateway.client.tree.geometry import Geometry
    from gateway.client.tree.published import Changes
    from gateway.client.tree.published import Path as NodePath
    from gateway.scene.geometry import Part


def publish(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="SCENE.json|MESH",
            exists=True,
            dir_okay=False,
            help="A request of the protocol in JSON, or a mesh: glb, gltf, obj, stl, ply, dae.",
        ),
    ],
    path: Annotated[str, typer.Option(help="Path in the tree: robot/base.")] = "",
    lcm_url: LcmUrl = None,
    timeout: Annotated[float, typer.Option(min=0.1, help="Seconds to wait for the viewer.")] = 10.0,
) -> None:
    """Publish a file at a path of the live scene, in place of everything at and below the path."""
    from gateway.client.tree.published import Changes, path_of
    from gateway.client.tree.viewer import TreeViewer

    root = path_of(path)
    changes = Changes()
    if source.suffix.lower() == ".json":
        _read_request(source, root, changes)
    else:
        root = root or (source.stem,)
        changes.delete(root)
        changes.set(root, [geometry.body() for geometry in _read_mesh(source)])
    with TreeViewer(lcm_url, timeout=timeout) as viewer:
        answer = viewer.send(changes)
    _print(answer)


def _read_request(source: Path, root: NodePath, changes: Changes) -> None:
    """Add the commands of a request in JSON, with ``root`` before their paths."""
    try:
        request = json.loads(source.read_text())
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


def _read_mesh(source: Path) -> Iterator[Geometry]:
    """Yield a mesh file's triangles and points in the colours of their materials; the protocol has no textures."""
    from gateway.assets.mesh_files import MeshFiles
    from gateway.scene.geometry import Surface

    complete = True
    for part in MeshFiles([source.parent]).load(str(source.resolve())):
        colored = isinstance(part.shape, Surface) and part.shape.mesh.colors is not None
        complete = complete and not colored and part.material.base_color_texture is None
        yield from _geometries(part)
    if not complete:
        typer.echo(f"{source}: textures and vertex colours are not published; mesh_file shows them", err=True)


def _geometries(part: Part) -> Iterator[Geometry]:
    import numpy as np

    from gateway.client.tree.geometry import Mesh, PointCloud
    from gateway.scene.geometry import PointCloud as Points
    from gateway.scene.meshing import meshes_of
    from renderers.color import srgb_from_linear

    X = part.X_node_part
    red, green, blue, alpha = part.material.base_color
    # colour factors of a file may exceed 1
    color = np.clip((srgb_from_linear(red), srgb_from_linear(green), srgb_from_linear(blue), alpha), 0.0, 1.0)
    if isinstance(part.shape, Points):
        points = part.shape.points @ X[:3, :3].T + X[:3, 3]
        yield PointCloud(points, rgb=part.shape.channels.get("rgb"), color=color)
        return
    for mesh, _, X_part_mesh in meshes_of(part.shape, part.material):
        if mesh.elements.shape[1] != 3:
            continue
        X_path_mesh = X @ X_part_mesh
        mirrored = np.linalg.det(X_path_mesh[:3, :3]) < 0
        faces = mesh.elements[:, ::-1] if mirrored else mesh.elements
        yield Mesh(mesh.positions @ X_path_mesh[:3, :3].T + X_path_mesh[:3, 3], faces, color=color)


def _print(answer: Answer) -> None:
    for warning in answer.warnings:
        typer.echo(warning, err=True)
    for name, paths in (("deleted", answer.deleted), ("set", answer.added), ("moved", answer.transformed)):
        if paths:
            typer.echo(f"{name}: {', '.join('/'.join(map(str, path)) or '/' for path in paths[:10])}")
