"""Labels of the parts of posted scenes, which Drake's client encodes in the base colours of materials."""

from collections.abc import Callable, Hashable, Iterable
from typing import TypeVar

from gateway.files.gltf import DEFAULT_MATERIAL, label_from_material
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Node, Path
from renderers.drawlist import LABEL_NONE

K = TypeVar("K", bound=Hashable)


def labels_by_root(parts: Iterable[tuple[K, Part]]) -> dict[K, int]:
    """Return the label of primitives without a material, by the root node above them.

    Drake's client cannot label a primitive without a material. But it puts each glTF file below one root node, and a
    whole file has one label: that of the other primitives below the root. Roots with several labels or none are left
    out. Their primitives have ``LABEL_NONE``, which is white in images.

    Args:
        parts: Root node and primitive.
    """
    labels_of_root: dict[K, set[int]] = {}
    for root, part in parts:
        if part.material is not DEFAULT_MATERIAL:
            labels_of_root.setdefault(root, set()).add(label_from_material(part.material))
    return {root: labels.pop() for root, labels in labels_of_root.items() if len(labels) == 1}


def labels_of(root: Node) -> Callable[[Path, Part], int]:
    """Return a function that returns the label of a part at a path."""
    label_of_root = labels_by_root((path[:1], part) for path, node in root.walk() for part in node.parts or ())

    def label_of(path: Path, part: Part) -> int:
        if part.material is not DEFAULT_MATERIAL:
            return label_from_material(part.material)
        return label_of_root.get(path[:1], LABEL_NONE)

    return label_of
