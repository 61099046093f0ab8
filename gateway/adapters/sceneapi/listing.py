"""Makes the JSON of ``GET /scene``."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.scene.draw.bounds import Bounds, instance_bounds, union
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import Snapshot
from gateway.scene.tree.nodes import Node, Path, json_element
from renderers.drawlist import LABEL_NONE, DrawList


class ListedNode(msgspec.Struct):
    """One node of the scene."""

    path: list[str | int]
    """Names from the root to the node."""
    kinds: list[str]
    """Kinds of the node's own parts, as the client named them."""
    has_geometry: bool
    """True if a client has set the node's geometry, even if it is empty."""
    visible: bool
    """The node's own flag. A node is also hidden if an ancestor's flag is false."""
    opacity: float
    """The node's own factor of alpha, 0 to 1, which also applies to its descendants."""
    label: int | None
    """Label in label images, as red + 256 green + 65536 blue; null without geometry."""
    bounds: list[list[float]] | None
    """Bounds of the visible subtree in the world: minimum and maximum corner, metres. Null if nothing is drawn."""
    transform: list[list[float]]
    """X_world_node, (4, 4), row-major. Values that are not finite are null."""


class Listing(msgspec.Struct):
    """The response of ``GET /scene``."""

    revision: int
    """Revision of the live tree."""
    nodes: list[ListedNode]
    """The first nodes, up to the server's limit. Parents come before their children."""
    node_count: int
    """Number of nodes of the whole tree."""
    bounds: list[list[float]] | None
    """Bounds of the whole scene, as ``ListedNode.bounds``."""


def list_scene(snapshot: Snapshot, draw_list: DrawList, labels: LabelTable, max_nodes: int) -> bytes:
    """Return the JSON of a snapshot, with at most ``max_nodes`` nodes, at least 1.

    The draw list is the snapshot's, with labels from ``labels``.
    """
    instance_boxes = instance_bounds(draw_list.instances)
    index_by_path: dict[Path, int] = {}
    nodes: list[ListedNode] = []
    parents: list[int] = []
    """Index of each node's parent in ``nodes``; 0 for the root."""
    pending: list[tuple[Path, Node, NDArray[np.float64], int]] = [((), snapshot.root, np.eye(4), 0)]
    """Stack of nodes with their paths, X_world_parent, and the indices of their parents."""
    with np.errstate(all="ignore"):  # clients may set transforms that overflow
        while pending and len(nodes) < max_nodes:
            path, node, X_world_parent, parent_index = pending.pop()
            X_world_node = X_world_parent @ node.matrix
            index = index_by_path[path] = len(nodes)
            nodes.append(_listed_node(path, node, X_world_node, labels))
            parents.append(parent_index)
            for name, child in reversed(node.children.items()):
                pending.append(((*path, name), child, X_world_node, index))
    _set_bounds(nodes, parents, index_by_path, draw_list, instance_boxes, labels)
    bounds = union([box for box in instance_boxes if box is not None])
    return msgspec.json.encode(
        Listing(snapshot.revision, nodes, snapshot.root.node_count, None if bounds is None else bounds.tolist())
    )


def _listed_node(path: Path, node: Node, X_world_node: NDArray[np.float64], labels: LabelTable) -> ListedNode:
    label = labels.label_of(path) if node.parts else LABEL_NONE
    return ListedNode(
        path=[json_element(element) for element in path],
        kinds=[part.kind or type(part.shape).__name__.lower() for part in node.parts or ()],
        has_geometry=node.parts is not None,
        visible=node.visible,
        opacity=node.opacity,
        label=None if label == LABEL_NONE else label,
        bounds=None,
        transform=X_world_node.tolist(),
    )


def _set_bounds(
    nodes: list[ListedNode],
    parents: list[int],
    index_by_path: dict[Path, int],
    draw_list: DrawList,
    instance_boxes: list[Bounds | None],
    labels: LabelTable,
) -> None:
    """Set the bounds of all nodes from their instances and their children's bounds, children first."""
    boxes_below: list[list[Bounds]] = [[] for _ in nodes]
    """Boxes of each node's instances, and of its children when those have their bounds."""
    for instance, box in zip(draw_list.instances, instance_boxes, strict=True):
        path = labels.path_of(instance.label)
        if box is None or path is None:
            continue
        while path and path not in index_by_path:  # beyond the limit: it counts for the nearest listed ancestor
            path = path[:-1]
        boxes_below[index_by_path[path]].append(box)
    for index in range(len(nodes) - 1, -1, -1):
        box = union(boxes_below[index])
        if box is None:
            continue
        nodes[index].bounds = box.tolist()
        if index:
            boxes_below[parents[index]].append(box)
