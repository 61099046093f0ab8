"""Objects of a scene: the nodes that are annotated, each with one pose, model, class, masks and boxes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from gateway.scene.tree import Node
from gateway.scene.tree import Path as TreePath


@dataclass(frozen=True, slots=True)
class SceneObject:
    """A node that is annotated. It owns the geometry of its subtree, without that of objects below it."""

    path: TreePath
    """Path of the node."""
    model: str
    """Name of the model. Objects with one model have the same geometry in the frame of their node."""


def objects_of(root: Node, models: Mapping[TreePath, str] = MappingProxyType({})) -> tuple[SceneObject, ...]:
    """Return an object for each node with geometry: each mesh node of a glTF file, link of a robot, path of a tree.

    Args:
        root: root of the scene's tree.
        models: names of models by path; other models are called after their path.
    """
    return tuple(
        SceneObject(path, models.get(path) or "/".join(map(str, path))) for path, node in root.walk() if node.parts
    )
