"""Labels of posted scenes: Drake encodes them in the base colours of the materials."""

from __future__ import annotations

from collections.abc import Callable

from gateway.gltf import DEFAULT_MATERIAL, label_from_material
from gateway.scene.geometry import Part
from gateway.scene.tree import Node, Path
from renderers.drawlist import LABEL_NONE, DrawList, Instance


def labels_of(root: Node) -> Callable[[Path, Part], int]:
    """Return a function from a part and its path to the part's label.

    Drake's client cannot label a primitive without a material. But it puts each glTF file, which has one label, below
    one node: such a primitive gets the label of the others below its top-level node. If they have none, or several, it
    has no label and is white.
    """
    labels_of_file: dict[Path, set[int]] = {}
    """Labels below each top-level node."""
    for path, node in root.walk():
        for part in node.parts or ():
            if part.material is not DEFAULT_MATERIAL:
                labels_of_file.setdefault(path[:1], set()).add(label_from_material(part.material))

    def label_of(path: Path, part: Part) -> int:
        if part.material is not DEFAULT_MATERIAL:
            return label_from_material(part.material)
        labels = labels_of_file.get(path[:1], set())
        return next(iter(labels)) if len(labels) == 1 else LABEL_NONE

    return label_of


def unlabelled(scene: DrawList) -> DrawList:
    """Return the draw list without labels, so that it is white in label images."""
    if all(instance.label == LABEL_NONE for instance in scene.instances):
        return scene
    instances = (Instance(i.mesh, i.material, i.X_world_mesh, LABEL_NONE, i.instance_id) for i in scene.instances)
    return DrawList(tuple(instances), scene.images)
