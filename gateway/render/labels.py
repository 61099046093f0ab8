"""Labels as Drake sends them: as the base colours of the materials."""

from __future__ import annotations

from collections.abc import Callable

from gateway.gltf import DEFAULT_MATERIAL, label_from_material
from gateway.scene.geometry import Part
from gateway.scene.tree import Node, Path
from renderers.drawlist import LABEL_NONE, DrawList, Instance


def labels_of(root: Node) -> Callable[[Path, Part], int]:
    """The labels of a posted scene's parts.

    A primitive without material has no place for a label (Drake's client colours materials). But the client hangs each
    glTF file below one node of its own, and the whole file has one label: the primitive has that of its neighbours.
    Without any, it has none, and is white.
    """
    neighbours: dict[Path, set[int]] = {}
    bare = False
    for path, node in root.walk():
        for part in node.parts or ():
            if part.material is DEFAULT_MATERIAL:
                bare = True
            else:
                neighbours.setdefault(path[:1], set()).add(label_from_material(part.material))
    if not bare:
        return lambda _path, part: label_from_material(part.material)

    def label_of(path: Path, part: Part) -> int:
        if part.material is not DEFAULT_MATERIAL:
            return label_from_material(part.material)
        labels = neighbours.get(path[:1], set())
        return next(iter(labels)) if len(labels) == 1 else LABEL_NONE

    return label_of


def unlabelled(scene: DrawList) -> DrawList:
    """The same things without labels: what exists in the server only is white in label pictures."""
    if all(instance.label == LABEL_NONE for instance in scene.instances):
        return scene
    instances = (Instance(i.mesh, i.material, i.X_world_mesh, LABEL_NONE, i.instance_id) for i in scene.instances)
    return DrawList(tuple(instances), scene.images)
