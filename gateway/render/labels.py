"""Labels of the parts of posted scenes, which Drake's client encodes in the base colours of materials."""

from __future__ import annotations

from collections.abc import Callable

from gateway.gltf import DEFAULT_MATERIAL, label_from_material
from gateway.scene.geometry import Part
from gateway.scene.tree import Node, Path
from renderers.drawlist import LABEL_NONE


def labels_of(root: Node) -> Callable[[Path, Part], int]:
    """Return a function that returns the label of a part at a path.

    Drake's client cannot label a primitive without a material. But it puts each glTF file below one top-level node, and
    a whole file has one label. A primitive without a material gets the label of the other primitives below its
    top-level node. If these have no label, or several, it has ``LABEL_NONE``, which is white in images.
    """
    labels_of_root: dict[Path, set[int]] = {}
    """Labels below each top-level node."""
    for path, node in root.walk():
        for part in node.parts or ():
            if part.material is not DEFAULT_MATERIAL:
                labels_of_root.setdefault(path[:1], set()).add(label_from_material(part.material))

    def label_of(path: Path, part: Part) -> int:
        if part.material is not DEFAULT_MATERIAL:
            return label_from_material(part.material)
        labels = labels_of_root.get(path[:1], set())
        return next(iter(labels)) if len(labels) == 1 else LABEL_NONE

    return label_of
