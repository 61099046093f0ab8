"""Load scene files of all kinds into draw lists, and describe them for ``scene.json``."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec

from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.errors import RequestError
from gateway.adapters.render.form import FormReader
from gateway.adapters.render.labels import labels_of
from gateway.adapters.render.request import RenderRequest
from gateway.adapters.treeviewer.apply import RequestApplier
from gateway.adapters.treeviewer.config import Limits
from gateway.adapters.treeviewer.context import ReadContext
from gateway.adapters.treeviewer.quota import TreeQuota
from gateway.adapters.treeviewer.request_reader import JsonReader
from gateway.datasets.objects import SceneObject, objects_of
from gateway.datasets.scenario.catalogue import Catalogue, read_catalogue
from gateway.datasets.scenario.choices import SceneChoices
from gateway.datasets.scenario.tables import ScenarioError
from gateway.datasets.scene_sources import Source, SourceKind
from gateway.datasets.views import SceneCamera, View, scene_views, usable_camera
from gateway.files.assets.mesh_formats import MESH_LIMITS, parse_mesh
from gateway.files.assets.scene_file import FolderFiles, SceneFileError
from gateway.files.gltf import PlacedCamera, read_mesh_names
from gateway.files.robots.scene_files import DEFAULT_OPTIONS, GLTF_SUFFIXES, SceneOptions, read_scene, without_effect
from gateway.runtime.logs.warning_list import WarningList
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Node
from gateway.scene.tree.nodes import Path as TreePath
from gateway.scene.tree.transforms import scaling
from renderers.drawlist import DrawList, Light
from renderers.interface import LookName
from scenegate.datasets import manifest
from scenegate.printable import encodable
from scenegate.warning_text import strict_refusal

if TYPE_CHECKING:
    from gateway.datasets.scenario.scenery import Scenery

_BOUNDARY_BYTES: Final = 200
"""Bytes at the start of a request in which its boundary is found. It has at most 70 characters (RFC 2046, 5.1.1)."""

Labels = Mapping[int, tuple[TreePath, ...]]
"""Paths of nodes by their label."""


class SceneError(ValueError):
    """A scene cannot be loaded; the message is the reason, without the scene's name."""


@dataclass(frozen=True, slots=True, eq=False)
class ScenarioScene:
    """Origin of a scenario's scene."""

    catalogue: Catalogue
    choices: SceneChoices
    scenery: Scenery
    """Lights, background and sensor of the frame, and its number."""


@dataclass(frozen=True, slots=True, eq=False)
class LoadedScene:
    """A scene in world coordinates (Z up, metres), or a recorded request."""

    root: Node
    """Root of the scene's tree; empty for a recorded request."""
    draw_list: DrawList
    """The tree as a draw list; empty for a recorded request."""
    description: manifest.SceneRecord
    """Content of ``scene.json``."""
    look: LookName = "studio"
    """Look that ``--look auto`` chooses for this scene."""
    file_camera: PlacedCamera | None = None
    """First camera of a glTF file; None if there is none."""
    request: RenderRequest | None = None
    """The recorded request, which has its own scene, camera, size and type of image; None for other scenes."""
    objects: tuple[SceneObject, ...] = ()
    """Nodes that can be annotated, in the order of the tree; empty for a recorded request."""
    scenario: ScenarioScene | None = None
    """Scenario and choices of the scene; None for other scenes."""

    @property
    def first_view(self) -> View:
        """View of a scene for which a command names none."""
        if self.scenario is None:
            return View("default", None)
        return scene_views(1, self.scenario.catalogue.scenario.frame_count)[0]

    def at_frame_of(self, view: View) -> tuple[LoadedScene, View]:
        """Return the scene and the view at the frame of a view, usually unchanged. Raises ScenarioError."""
        if not isinstance(view.pose, SceneCamera):
            return self, view
        assert self.scenario is not None
        frame = view.pose.frame or 0
        camera = self.scenario.choices.cameras[view.pose.index]
        pose = camera.X_world_camera[frame if len(camera.X_world_camera) > 1 else 0]
        view = replace(view, pose=pose, intrinsics=msgspec.structs.replace(view.intrinsics, fovy=camera.fovy))
        return (self if frame == self.scenario.scenery.frame else self._at(frame)), view

    def _at(self, frame: int) -> LoadedScene:
        """Return another frame of a scenario's scene."""
        from gateway.datasets.scenario.build import build_scene

        assert self.scenario is not None
        built = build_scene(self.scenario.catalogue, self.scenario.choices, frame)
        draw_list, _ = _flatten_numbered(built.root)
        scenario = replace(self.scenario, scenery=built.scenery)
        return replace(self, root=built.root, draw_list=draw_list, scenario=scenario)


def load_options(settings: manifest.Settings) -> SceneOptions:
    """Return the options in a dataset's settings, which have the same names."""
    names = {each.name for each in fields(SceneOptions)} & {*manifest.Settings.__struct_fields__}
    values: dict[str, Any] = {name: getattr(settings, name) for name in names}
    return SceneOptions(**values)


def load_scene(source: Source, options: SceneOptions = DEFAULT_OPTIONS) -> LoadedScene:
    """Load a scene. Raises SceneError if it cannot be loaded."""
    files = FolderFiles(Path(source.path))
    try:
        match source.kind:
            case SourceKind.FILE:
                return _load_file(source, options)
            case SourceKind.TREE:
                scene = _load_tree(source, files, options)
            case SourceKind.REQUEST:
                scene = _load_request(source, files)
            case SourceKind.SCENARIO:
                scene = _load_scenario(source, options)
        warnings = (*without_effect(options), *scene.description.warnings)
        return replace(scene, description=msgspec.structs.replace(scene.description, warnings=warnings))
    except OSError as error:
        raise SceneError(error.strerror or str(error)) from None
    except (SceneFileError, RequestError, ValueError) as error:  # those of meshes, glTF and trees are ValueErrors
        raise SceneError(str(error).removeprefix(f"{source.path}: ")) from None


def model_names(source: Source, options: SceneOptions = DEFAULT_OPTIONS) -> frozenset[str]:
    """Return the names of the models of a scene's objects; empty if the scene cannot be loaded. glTF files are fast."""
    try:
        if source.kind is SourceKind.SCENARIO:
            from gateway.datasets.scenario.build import model_names as scenario_model_names

            return scenario_model_names(read_catalogue(Path(source.path)))
        if source.path.lower().endswith(GLTF_SUFFIXES):
            return read_mesh_names(FolderFiles(Path(source.path)).read_scene())
        return frozenset(each.model for each in load_scene(source, options).objects)
    except (OSError, ValueError):
        return frozenset()


def _load_file(source: Source, options: SceneOptions) -> LoadedScene:
    """Load a glTF file, a mesh or a robot."""
    scene = read_scene(Path(source.path), options)
    look: LookName = "pbr" if scene.from_drake else "studio"
    draw_list, labels = _flatten_with_drake_labels(scene.root) if scene.from_drake else _flatten_numbered(scene.root)
    file_camera, flaws = usable_camera(scene.cameras, draw_list)
    warnings = (*scene.notes, *scene.warnings, *flaws)
    description = _describe(source, scene.digests, labels, scene.generator, warnings, draw_list.lights)
    objects = objects_of(scene.root, scene.models)
    return LoadedScene(scene.root, draw_list, description, look, file_camera, objects=objects)


def _load_tree(source: Source, files: FolderFiles, options: SceneOptions) -> LoadedScene:
    """Apply a tree viewer request to an empty tree."""
    limits = Limits()
    live = LiveTree()
    context = ReadContext(limits, meshes=_MeshFileReader(files))
    request = JsonReader(limits).read(memoryview(files.read_scene()), context)
    if not request.commands:
        raise SceneError("no setgeometry and no settransform command is in it")
    applier = RequestApplier(request, live, TreeQuota(limits), limits, WarningList())
    applier.apply()
    response = applier.response(0)
    if response.error:
        raise SceneError(response.error)
    if options.strict and (refusal := strict_refusal(response.warnings)):
        raise SceneError(refusal)
    root = live.snapshot.root
    draw_list, labels = _flatten_numbered(root)
    description = _describe(source, files.digests, labels, "", tuple(response.warnings), draw_list.lights)
    return LoadedScene(root, draw_list, description, objects=objects_of(root))


def _load_request(source: Source, files: FolderFiles) -> LoadedScene:
    """Parse a recorded render request."""
    config = RenderConfig()
    body = files.read_scene()
    boundary = body[:_BOUNDARY_BYTES].partition(b"\r\n")[0].removeprefix(b"--").decode("latin-1")
    reader = FormReader(f'multipart/form-data; boundary="{boundary}"', config)
    try:
        reader.feed(body)
        request = reader.request()
    finally:
        reader.close()
    # Only the form is parsed here. The render pipeline reads the glTF scene in it.
    description = _describe(source, files.digests, {}, warnings=request.warnings)
    return LoadedScene(Node(), DrawList(), description, "pbr", request=request)


def _load_scenario(source: Source, options: SceneOptions) -> LoadedScene:
    """Draw a scene of a scenario, or make it again from the choices of an earlier run if its files have not changed."""
    # Here, because they load kernels, which takes 0.2 s.
    from gateway.datasets.scenario.build import build_scene
    from gateway.datasets.scenario.choices import choices_of
    from gateway.datasets.scenario.drawing import draw_choices

    catalogue = read_catalogue(Path(source.path))
    record = None
    path = Path(source.recorded) / manifest.SCENES_FOLDER / source.name / manifest.SCENE_FILE
    if source.recorded and path.is_file():
        record = manifest.read_file(path, manifest.SceneRecord)
    if record is not None and record.scenario is not None:
        try:
            choices = choices_of(record.scenario, catalogue, source.number)
        except (ScenarioError, msgspec.ValidationError) as error:
            raise SceneError(f"{path}: scenario: {error}") from None
        built = build_scene(catalogue, choices, 0)
    if record is None or record.scenario is None or record.sha256 != scene_digest(_sources(source, built.digests)):
        choices = draw_choices(catalogue, source.number)
        built = build_scene(catalogue, choices, 0)
    if options.strict and (refusal := strict_refusal(built.warnings)):
        raise SceneError(refusal)
    draw_list, labels = _flatten_numbered(built.root)
    description = _describe(source, built.digests, labels, "", built.warnings, built.scenery.rig.lights)
    description = msgspec.structs.replace(description, scenario=msgspec.to_builtins(choices))
    scenario = ScenarioScene(catalogue, choices, built.scenery)
    return LoadedScene(built.root, draw_list, description, objects=built.objects, scenario=scenario)


class _MeshFileReader:
    """Reads the mesh files that a tree viewer request names. They must be in the request's folder or below."""

    def __init__(self, files: FolderFiles) -> None:
        self._files = files

    def load(self, filename: str, scale: tuple[float, float, float], warnings: list[str]) -> tuple[Part, ...]:
        """Return the parts of a mesh file, scaled along x, y and z."""
        data, extension = self._files.resolve(filename), Path(filename).suffix[1:].lower()
        found: list[str] = []
        parts = parse_mesh(data, extension, self._files.resolve, MESH_LIMITS, found)
        warnings += [f"{filename}: {text}" for text in found]
        X_scale = scaling(*scale)
        return tuple(msgspec.structs.replace(part, X_node_part=X_scale @ part.X_node_part) for part in parts)


def _flatten_numbered(root: Node) -> tuple[DrawList, Labels]:
    """Flatten a scene. Each path has its own label, from 1 in the order of the tree."""
    table = LabelTable()
    draw_list = flatten(root, label_of=lambda path, _: table.label_of(path))
    return draw_list, {label: (path,) for label, path in table.paths_by_label().items()}


def _flatten_with_drake_labels(root: Node) -> tuple[DrawList, Labels]:
    """Flatten a scene. Labels are those that Drake's client encodes in the materials' base colours."""
    paths: dict[int, dict[TreePath, None]] = {}
    """Paths by label. The inner dict is an ordered set."""
    drake_label_of = labels_of(root)

    def label_of(path: TreePath, part: Part) -> int:
        label = drake_label_of(path, part)
        paths.setdefault(label, {})[path] = None
        return label

    draw_list = flatten(root, label_of=label_of)
    return draw_list, {label: tuple(paths[label]) for label in sorted(paths)}


def _describe(
    source: Source,
    digests: Mapping[str, str],
    labels: Labels,
    generator: str = "",
    warnings: tuple[str, ...] = (),
    lights: tuple[Light, ...] = (),
) -> manifest.SceneRecord:
    """Return the description of a scene. ``digests`` has those of the files that were read."""
    sources = _sources(source, digests)
    return manifest.SceneRecord(
        scene=source.name,
        sha256=scene_digest(sources),
        sources=sources,
        generator=encodable(generator),
        warnings=tuple(encodable(text) for text in warnings),
        labels={str(label): tuple(utf8_path(path) for path in paths) for label, paths in labels.items()},
        lights=tuple(
            manifest.LightRecord(
                kind=light.kind.value,
                color=light.color,
                intensity=light.intensity,
                position=light.position,
                direction=light.direction,
            )
            for light in lights
        ),
    )


def _sources(source: Source, digests: Mapping[str, str]) -> tuple[manifest.SourceFile, ...]:
    """Return the files with these digests, the scene file first."""
    scene_file = Path(source.path).name
    names = sorted(digests, key=lambda name: (name != scene_file, name))
    return tuple(manifest.SourceFile(name, digests[name]) for name in names)


def scene_digest(sources: tuple[manifest.SourceFile, ...]) -> str:
    """Return the digest of a scene: the SHA-256 of the names and digests of its files."""
    file_list = json.dumps([[file.path, file.sha256] for file in sources], ensure_ascii=True)
    return hashlib.sha256(file_list.encode()).hexdigest()


def utf8_path(path: TreePath) -> TreePath:
    """Return a path whose names can be encoded as UTF-8."""
    return tuple(encodable(name) if isinstance(name, str) else name for name in path)
