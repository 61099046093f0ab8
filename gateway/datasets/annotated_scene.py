"""The annotated objects of a scene: what does not depend on the camera. ``annotations`` finds their pixels."""

import hashlib
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.datasets.classes import ClassTable
from gateway.datasets.objects import ObjectFrame, joined_objects, object_frame, own_subtree, owner_numbers
from gateway.datasets.scenes import LoadedScene, SceneError, utf8_path
from gateway.scene.draw.flatten import flatten, images_of
from gateway.scene.tree.nodes import Path as TreePath
from gateway.scene.tree.transforms import Matrix
from renderers.drawlist import DrawList, Instance, Topology, used_vertices
from renderers.stop import check_stop
from scenegate.datasets.manifest import MODELS_FOLDER, ModelRecord
from scenegate.datasets.ply import encode_ply

MAX_OBJECTS: Final = 10_000
"""Maximum number of annotated objects in a scene. Each may be drawn alone, and takes 900 bytes of a sample's line."""

_DIGEST_CHARS: Final = 32
"""Number of hexadecimal digits in the name of a model's file."""

SaveModel = Callable[[ModelRecord, bytes], object]
"""Function that gets the record of a model and the content of its file."""


@dataclass(frozen=True, slots=True, eq=False)
class AnnotatedObject:
    """An object; see ``ObjectRecord``."""

    instance: int
    path: TreePath
    model: str
    class_id: int
    object_frame: ObjectFrame
    box: NDArray[np.float64]
    """(2, 3): smallest and largest coordinates in the frame of the object, in metres."""
    draw_list: DrawList
    """The object alone."""
    margin: int
    """Pixels by which points and lines reach beyond their vertices."""


@dataclass(frozen=True, slots=True, eq=False)
class AnnotatedScene:
    """The annotated objects of a scene."""

    objects: tuple[AnnotatedObject, ...]
    """Objects by ``instance``."""
    models: dict[str, ModelRecord]
    """Value of ``SceneRecord.models``."""
    instance_of: NDArray[np.uint16]
    """(I + 1,): ``AnnotatedObject.instance`` by ``instance_id``; 0: none. The last is that of the background."""
    class_of: NDArray[np.uint16]
    """(N + 1,): class of each object by ``AnnotatedObject.instance``; 0 for the background."""


def annotate_scene(scene: LoadedScene, classes: ClassTable, save: SaveModel) -> AnnotatedScene:
    """Return the objects of a scene with a class, and save their models. Raises SceneError above ``MAX_OBJECTS``."""
    scene_name = scene.description.scene
    candidates = joined_objects(scene.objects, partial(classes.is_whole, scene_name))
    class_ids = {each.path: classes.class_of(scene_name, each.path, each.model) for each in candidates}
    wanted = [each for each in candidates if class_ids[each.path]]
    if len(wanted) > MAX_OBJECTS:
        raise SceneError(f"{len(wanted)} annotated objects are more than the limit, {MAX_OBJECTS}; --classes selects")
    numbers = dict.fromkeys(class_ids, 0) | {each.path: number for number, each in enumerate(wanted, 1)}
    owners = owner_numbers(scene.root, numbers)
    instances_of: dict[int, list[Instance]] = {}
    for number, instance in zip(owners.tolist(), scene.draw_list.instances, strict=True):
        instances_of.setdefault(number, []).append(instance)
    models = _Models(save)
    objects: list[AnnotatedObject] = []
    for number, each in enumerate(wanted, 1):
        check_stop()
        node, X_world_node = scene.root.find(each.path), scene.root.world_matrix(each.path)
        frame = object_frame(X_world_node) if X_world_node is not None else None
        if node is None or frame is None or number not in instances_of:
            continue  # hidden, flat or without geometry
        subtree = own_subtree(node, each.path, numbers)
        key = (each.model, id(node.parts), *map(id, node.children.values()), frame.X_model_node.tobytes())
        name = models.add(each.model, key, flatten(subtree), frame.X_model_node)
        if name is None:
            continue
        box = np.sort(np.array(models.records[name].box) * frame.scale, axis=0)
        drawn = tuple(instances_of[number])
        draw_list = DrawList(drawn, images_of(instance.material for instance in drawn))
        margin = max(map(_margin, drawn))
        objects.append(
            AnnotatedObject(number, utf8_path(each.path), name, class_ids[each.path], frame, box, draw_list, margin)
        )
    class_table = np.array([0, *(class_ids[each.path] for each in wanted)], np.uint16)
    return AnnotatedScene(tuple(objects), models.records, np.append(owners, 0).astype(np.uint16), class_table)


def _margin(instance: Instance) -> int:
    """Return the number of pixels by which an instance reaches beyond its vertices."""
    size = {Topology.POINTS: instance.material.point_size, Topology.LINES: instance.material.line_width}
    return int(size.get(instance.mesh.topology, 0.0)) + 1


class _Models:
    """Collects the models of a scene. Models of one name with different geometry get different names."""

    def __init__(self, save: SaveModel) -> None:
        self.records: dict[str, ModelRecord] = {}
        self._save = save
        self._names: dict[Hashable, str | None] = {}

    def add(self, name: str, key: Hashable, geometry: DrawList, X_model_node: Matrix) -> str | None:
        """Return the name of the model of an object with geometry in the frame of its node; None without geometry.

        Equal keys mean equal geometry.
        """
        if key not in self._names:
            model = make_model(geometry.instances, X_model_node)
            self._names[key] = None if model is None else self._unique(name, model[0])
            if model is not None:
                self._save(*model)
        return self._names[key]

    def _unique(self, name: str, record: ModelRecord) -> str:
        """Add a record under a name, or under ``name#2``, ``name#3`` … if others have that."""
        number, unique = 1, name
        while self.records.setdefault(unique, record) != record:
            number += 1
            unique = f"{name}#{number}"
        return unique


def make_model(instances: Iterable[Instance], X_model_node: Matrix) -> tuple[ModelRecord, bytes] | None:
    """Return the record of the model of an object, and its PLY file, called after its digest; None: no finite vertex.

    The instances are in the frame of its node. Points and lines have vertices, but no triangles.
    """
    all_vertices: list[NDArray[np.float32]] = []
    all_triangles: list[NDArray[np.int64]] = []
    count = 0
    for instance in instances:
        mesh = instance.mesh
        used, elements = used_vertices(mesh.elements, len(mesh.positions))
        X = X_model_node @ instance.X_world_mesh
        all_vertices.append((mesh.positions[used] @ X[:3, :3].T + X[:3, 3]).astype(np.float32))
        if mesh.topology is Topology.TRIANGLES:
            flip = np.linalg.det(X[:3, :3]) < 0.0  # fronts stay fronts
            all_triangles.append((elements[:, ::-1] if flip else elements).astype(np.int64) + count)
        count += len(used)
    vertices = np.concatenate(all_vertices or [np.zeros((0, 3), np.float32)])
    triangles = np.concatenate(all_triangles or [np.zeros((0, 3), np.int64)])
    finite = vertices[np.isfinite(vertices).all(axis=1)]
    if not len(finite):
        return None
    data = encode_ply(vertices, triangles, "metres")
    digest = hashlib.sha256(data).hexdigest()
    low, high = (tuple(corner.tolist()) for corner in (finite.min(axis=0), finite.max(axis=0)))
    path = f"{MODELS_FOLDER}/{digest[:_DIGEST_CHARS]}.ply"
    return ModelRecord(path=path, sha256=digest, box=(low, high)), data
