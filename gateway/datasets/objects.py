"""Objects of a scene: the nodes that are annotated, with their frames, and the geometry that each of them owns."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.nodes import Node
from gateway.scene.tree.nodes import Path as TreePath
from gateway.scene.tree.transforms import IDENTITY, Matrix
from renderers.drawlist import Light
from scenegate.printable import encodable

_MAX_SHEAR: Final = 1e-6
"""Largest cosine between two axes of a frame that counts as not sheared."""


@dataclass(frozen=True, slots=True)
class SceneObject:
    """A node that is annotated. It owns the geometry of its subtree, without that of objects below it."""

    path: TreePath
    """Path of the node."""
    model: str
    """Name of the model. Objects with one model have the same geometry in the frame of their node."""


@dataclass(frozen=True, slots=True, eq=False)
class ObjectFrame:
    """Frame of an object: the node's, made rigid."""

    X_world_object: Matrix
    """(4, 4), rotation and translation."""
    scale: tuple[float, float, float]
    """Scale of the model along the axes of the object; the first is negative if the node is mirrored."""
    X_model_node: Matrix
    """(4, 4), identity, except for a sheared node: shear and scale become part of its model."""


def objects_of(root: Node, models: Mapping[TreePath, str] = MappingProxyType({})) -> tuple[SceneObject, ...]:
    """Return an object for each node with geometry: each mesh node of a glTF file, link of a robot, path of a tree.

    Models that ``models`` does not name are called after their path.
    """
    return tuple(
        SceneObject(path, models.get(path) or _model_name(path)) for path, node in root.walk() if has_geometry(node)
    )


def has_geometry(node: Node) -> bool:
    """Return True if a node has parts other than lights."""
    return any(not isinstance(part.shape, Light) for part in node.parts or ())


def joined_objects(objects: tuple[SceneObject, ...], is_whole: Callable[[TreePath], bool]) -> tuple[SceneObject, ...]:
    """Return objects, with those below a node that ``is_whole`` replaced by one that is called after the node."""
    joined: dict[TreePath, SceneObject] = {}
    for each in objects:
        top = next((each.path[:n] for n in range(1, len(each.path)) if is_whole(each.path[:n])), None)
        found = each if top is None else SceneObject(top, _model_name(top[-1:]))
        joined.setdefault(found.path, found)
    return tuple(joined.values())


def _model_name(path: TreePath) -> str:
    """Return the name of a model that is called after a path."""
    return encodable("/".join(map(str, path)))


def object_frame(X_world_node: Matrix) -> ObjectFrame | None:
    """Return the frame of an object, given its node's affine pose; None if the node is flat or not finite."""
    linear = X_world_node[:3, :3]
    lengths = np.linalg.norm(linear, axis=0)
    if not np.isfinite(X_world_node).all() or not (lengths > 0.0).all():
        return None
    axes = linear / lengths
    if abs(np.linalg.det(axes)) < _MAX_SHEAR:
        return None
    X_world_object = IDENTITY.copy()
    X_world_object[:3, 3] = X_world_node[:3, 3]
    if np.abs(axes.T @ axes - np.eye(3)).max() > _MAX_SHEAR:  # the nearest rotation (polar decomposition)
        U, _, Vt = np.linalg.svd(linear)
        X_world_object[:3, :3] = U @ np.diag((1.0, 1.0, np.linalg.det(U @ Vt))) @ Vt
        X_model_node = IDENTITY.copy()
        X_model_node[:3, :3] = X_world_object[:3, :3].T @ linear
        return ObjectFrame(X_world_object, (1.0, 1.0, 1.0), X_model_node)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0], lengths[0] = -axes[:, 0], -lengths[0]
    X_world_object[:3, :3] = axes
    x, y, z = (float(f"{length:.12g}") for length in lengths)  # equal in all poses
    return ObjectFrame(X_world_object, (x, y, z), IDENTITY)


def owner_numbers(root: Node, numbers: Mapping[TreePath, int]) -> NDArray[np.int64]:
    """Return the number of the object that owns each instance of a scene, (I,) in the order of its draw list; 0: none.

    The numbers of objects that are not annotated are 0.
    """

    def owner_of(path: TreePath) -> int:
        return next((numbers[path[:n]] for n in range(len(path), -1, -1) if path[:n] in numbers), 0)

    draw_list = flatten(root, label_of=lambda path, _: owner_of(path))
    return np.array([instance.label for instance in draw_list.instances], np.int64)


def own_subtree(node: Node, path: TreePath, paths: Mapping[TreePath, object]) -> Node:
    """Return the geometry of the object at a node as a tree in its frame, without the objects below it (``paths``)."""

    def copy(source: Node, path: TreePath, matrix: Matrix) -> Node:
        children = {
            name: copy(child, (*path, name), child.matrix)
            for name, child in source.children.items()
            if child.visible and child.nodes_with_parts and (*path, name) not in paths
        }
        return Node(source.parts, matrix, children)

    return copy(node, path, IDENTITY)
