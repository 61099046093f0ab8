"""What is in the scene, as JSON."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.scene.bounds import Bounds, union
from gateway.scene.labels import LabelTable
from gateway.scene.live import Snapshot
from gateway.scene.names import json_element
from gateway.scene.tree import Node, Path
from renderers.drawlist import LABEL_NONE, DrawList


class Listed(msgspec.Struct):
    """One node. Children follow their parents."""

    path: list[str | int]
    kinds: list[str]
    """Of the node's own parts, as their client called them."""
    has_geometry: bool
    """Whether geometry was ever set here, an empty one included."""
    visible: bool
    """The node's own flag; a hidden parent hides it, too."""
    label: int | None
    """In label pictures: red + 256 green + 65536 blue. Null: the node has no geometry."""
    bounds: list[list[float]] | None
    """Lowest and highest corner of all that is drawn here and below, metres, in the world."""
    transform: list[list[float]]
    """4x4, row-major, from the node to the world; null for numbers that are not finite."""


class Listing(msgspec.Struct):
    """The answer of ``GET /scene``."""

    revision: int
    nodes: list[Listed]
    node_count: int
    """Of the whole tree; ``nodes`` ends at the server's limit."""
    bounds: list[list[float]] | None


def list_scene(
    snapshot: Snapshot, drawn: DrawList, boxes: list[Bounds | None], labels: LabelTable, max_nodes: int
) -> bytes:
    """The JSON of a snapshot.

    Args:
        drawn: the snapshot's draw list, labelled by ``labels``.
        boxes: of its instances, in the world.
    """
    at: dict[Path, int] = {}
    nodes: list[Listed] = []
    parents: list[int] = []
    count = 0
    stack: list[tuple[Path, Node, NDArray[np.float64], int]] = [((), snapshot.root, np.eye(4), 0)]
    with np.errstate(all="ignore"):
        while stack:
            path, node, parent, parent_index = stack.pop()
            count += 1
            if len(nodes) >= max_nodes:
                stack.extend(((), child, parent, 0) for child in node.children.values())
                continue
            world = parent @ node.matrix
            index = at[path] = len(nodes)
            nodes.append(_listed(path, node, world, labels))
            parents.append(parent_index)
            stack.extend(((*path, name), child, world, index) for name, child in reversed(node.children.items()))
    _put_bounds(nodes, parents, at, drawn, boxes, labels)
    whole = union([box for box in boxes if box is not None])
    return msgspec.json.encode(Listing(snapshot.revision, nodes, count, None if whole is None else whole.tolist()))


def _listed(path: Path, node: Node, world: NDArray[np.float64], labels: LabelTable) -> Listed:
    label = labels.label_of(path) if node.parts else LABEL_NONE
    return Listed(
        path=[json_element(element) for element in path],
        kinds=[part.kind or type(part.shape).__name__.lower() for part in node.parts or ()],
        has_geometry=node.parts is not None,
        visible=node.visible,
        label=None if label == LABEL_NONE else label,
        bounds=None,
        transform=world.tolist(),
    )


def _put_bounds(
    nodes: list[Listed],
    parents: list[int],
    at: dict[Path, int],
    drawn: DrawList,
    boxes: list[Bounds | None],
    labels: LabelTable,
) -> None:
    """Boxes of instances to their nodes, then of nodes to their parents, from the leaves up."""
    gathered: dict[int, list[Any]] = {}
    for instance, box in zip(drawn.instances, boxes, strict=True):
        path = labels.path_of(instance.label)
        if box is not None and path in at:
            gathered.setdefault(at[path], []).append(box)
    for index in range(len(nodes) - 1, -1, -1):
        box = union(gathered.pop(index, []))
        if box is None:
            continue
        nodes[index].bounds = box.tolist()
        if index:
            gathered.setdefault(parents[index], []).append(box)
