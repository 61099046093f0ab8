"""Scenes ready to be drawn, of every kind of source, with what the dataset says about them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from gateway.assets.mesh_formats import parse_mesh
from gateway.assets.scene_file import FolderFiles, SceneFileError, Up, read_scene_file
from gateway.client import manifest
from gateway.datasets.sources import Kind, Source
from gateway.gltf import GltfCamera, GltfLimits
from gateway.render.config import RenderConfig
from gateway.render.errors import RequestError
from gateway.render.form import RenderRequest, read_form
from gateway.render.labels import labels_of
from gateway.render.multipart import FormReader
from gateway.scene.flatten import flatten
from gateway.scene.geometry import Part
from gateway.scene.labels import LabelTable
from gateway.scene.live import LiveTree
from gateway.scene.transforms import scaling
from gateway.scene.tree import Node
from gateway.scene.tree import Path as TreePath
from gateway.treeviewer.apply import RequestApplier
from gateway.treeviewer.config import Limits
from gateway.treeviewer.json_reader import JsonReader
from gateway.treeviewer.protocol import ALL_COMMANDS
from gateway.treeviewer.quota import TreeQuota
from renderers.drawlist import DrawList
from renderers.interface import LookName

MESH_LIMITS: Final = GltfLimits(max_vertices=10_000_000, max_elements=10_000_000)
"""As for the mesh files of the live tree."""
_BOUNDARY_BYTES: Final = 200
"""A boundary has at most 70 characters (RFC 2046, 5.1.1)."""

Labels = Mapping[int, tuple[TreePath, ...]]


class SceneError(ValueError):
    """A scene cannot be drawn; the message says why, without the scene's name."""


@dataclass(frozen=True, slots=True, eq=False)
class LoadedScene:
    """A scene in our world: Z up, metres."""

    root: Node
    drawn: DrawList
    own_camera: GltfCamera | None
    """The file's first."""
    look: LookName
    """With ``auto``."""
    request: RenderRequest | None
    """Of a recorded request, which says itself how it is drawn."""
    record: manifest.Scene
    """For the dataset."""


def load_scene(source: Source, up: Up = "auto") -> LoadedScene:
    """Reads a scene.

    Args:
        up: which axis of a glTF file is up; requests and the others are used as they are.

    Raises:
        SceneError: it cannot be read.
    """
    files = FolderFiles(Path(source.path))
    try:
        return _LOADERS[source.kind](source, files, up)
    except OSError as error:
        raise SceneError(error.strerror or str(error)) from None
    except SceneFileError as error:
        raise SceneError(str(error).removeprefix(f"{source.path}: ")) from None
    except (RequestError, ValueError) as error:  # those of mesh files, glTF and trees are ValueErrors
        raise SceneError(str(error)) from None


def _gltf(source: Source, files: FolderFiles, up: Up) -> LoadedScene:
    scene = read_scene_file(Path(source.path), up=up, files=files)
    look: LookName = "studio"
    if scene.from_drake:
        look = "phong" if scene.generator == "VTK" else "pbr"
    drawn, labels = _painted(scene.root) if scene.from_drake else _numbered(scene.root)
    drawn = replace(drawn, lights=scene.lights)
    own = scene.cameras[0] if scene.cameras else None
    record = _record(source, files, labels, scene.generator, scene.warnings)
    return LoadedScene(scene.root, drawn, own, look, None, record)


def _mesh(source: Source, files: FolderFiles, up: Up) -> LoadedScene:
    suffix = Path(source.path).suffix[1:].lower()
    parts = parse_mesh(files.read_scene(), suffix, files, MESH_LIMITS)
    root = Node(None, children={Path(source.path).stem: Node(parts)})
    drawn, labels = _numbered(root)
    return LoadedScene(root, drawn, None, "studio", None, _record(source, files, labels))


def _tree(source: Source, files: FolderFiles, up: Up) -> LoadedScene:
    limits = Limits()
    live = LiveTree()
    data = files.read_scene()
    request = JsonReader(limits, _MeshesBeside(files)).read(memoryview(data))
    if not request.commands:
        raise SceneError("no setgeometry and no settransform command is in it")
    applier = RequestApplier(request, live, TreeQuota(limits), limits)
    applier.step(ALL_COMMANDS)
    response = applier.response(0)
    if response.error:
        raise SceneError(response.error)
    root = live.snapshot.root
    drawn, labels = _numbered(root)
    record = _record(source, files, labels, warnings=tuple(response.warnings))
    return LoadedScene(root, drawn, None, "studio", None, record)


def _request(source: Source, files: FolderFiles, up: Up) -> LoadedScene:
    config = RenderConfig()
    body = files.read_scene()
    boundary = body[:_BOUNDARY_BYTES].partition(b"\r\n")[0].removeprefix(b"--").decode("latin-1")
    reader = FormReader(f'multipart/form-data; boundary="{boundary}"', config)
    try:
        reader.feed(body)
        request = read_form(reader.form(), config)
    finally:
        reader.close()
    # The pipeline of the endpoint reads the glTF; here only what the form says is of interest.
    record = _record(source, files, {}, warnings=request.warnings)
    return LoadedScene(Node(), DrawList(), None, "pbr", request, record)


_LOADERS: Final[dict[Kind, Callable[[Source, FolderFiles, Up], LoadedScene]]] = {
    Kind.GLTF: _gltf,
    Kind.MESH: _mesh,
    Kind.TREE: _tree,
    Kind.REQUEST: _request,
}


class _MeshesBeside:
    """Mesh files below the folder of the request that names them."""

    def __init__(self, files: FolderFiles) -> None:
        self._files = files

    def load(self, filename: str, scale: tuple[float, float, float]) -> tuple[Part, ...]:
        parts = parse_mesh(self._files(filename), Path(filename).suffix[1:].lower(), self._files, MESH_LIMITS)
        X = scaling(*scale)
        return tuple(replace(part, X_node_part=X @ part.X_node_part) for part in parts)


def _numbered(root: Node) -> tuple[DrawList, Labels]:
    """One label a path, counted from 1 in the tree's order."""
    table = LabelTable()
    drawn = flatten(root, label_of=lambda path, _: table.label_of(path))
    return drawn, {label: (path,) for label, path in table.known().items()}


def _painted(root: Node) -> tuple[DrawList, Labels]:
    """The labels that Drake's client paints."""
    found: dict[int, dict[TreePath, None]] = {}
    of_part = labels_of(root)

    def label_of(path: TreePath, part: Part) -> int:
        label = of_part(path, part)
        found.setdefault(label, {})[path] = None
        return label

    drawn = flatten(root, label_of=label_of)
    return drawn, {label: tuple(found[label]) for label in sorted(found)}


def _record(
    source: Source, files: FolderFiles, labels: Labels, generator: str = "", warnings: tuple[str, ...] = ()
) -> manifest.Scene:
    own = Path(source.path).name
    rest = sorted(name for name in files.digests if name != own)
    sources = tuple(manifest.SourceFile(name, files.digests[name]) for name in (own, *rest))
    return manifest.Scene(
        scene=source.name,
        sha256=digest_of(sources),
        sources=sources,
        generator=_utf8(generator),
        warnings=tuple(_utf8(text) for text in warnings),
        labels={str(label): tuple(_clean(path) for path in paths) for label, paths in labels.items()},
    )


def digest_of(sources: tuple[manifest.SourceFile, ...]) -> str:
    """The hash of a scene from those of its files."""
    listed = json.dumps([[file.path, file.sha256] for file in sources], ensure_ascii=True)
    return hashlib.sha256(listed.encode()).hexdigest()


def _clean(path: TreePath) -> TreePath:
    return tuple(_utf8(name) if isinstance(name, str) else name for name in path)


def _utf8(text: str) -> str:
    """Half characters (lone surrogates), which names in JSON can have, cannot be written."""
    return text.encode("utf-8", "replace").decode()
