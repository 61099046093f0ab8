"""Nodes of a document's scene: their order, and their local and world matrices."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Any, Final, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.files.gltf import schema
from gateway.files.gltf.gltf_errors import GltfError, GltfLimitError, GltfLimits, as_warning, checked_item
from gateway.files.gltf.parser import extension, vector_or_default
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.transforms import IDENTITY, affine_product, from_poses
from renderers.stop import check_stop

VISIBILITY: Final = "KHR_node_visibility"
INSTANCING: Final = "EXT_mesh_gpu_instancing"
_NODES_PER_STOP_CHECK: Final = 1 << 12
"""Nodes between two checks of the ``StopFlag``."""
_AFFINE_TOLERANCE: Final = 1e-6
"""Maximum deviation of a matrix's last row from (0, 0, 0, 1)."""
_DEFAULT_MATRIX: Final = tuple(IDENTITY.ravel().tolist())
_DEFAULT_TRANSLATION: Final = (0.0, 0.0, 0.0)
_DEFAULT_ROTATION: Final = (0.0, 0.0, 0.0, 1.0)
"""Quaternion (x, y, z, w), as in glTF."""
_DEFAULT_SCALE: Final = (1.0, 1.0, 1.0)

NodeParts: TypeAlias = list[tuple[Part, ...] | None]
"""The primitives of each node; None for a node without a mesh."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneNodes:
    """The nodes of the scene, parents before children. Entry i of each list and array belongs to the same node."""

    indices: list[int]
    """Indices of the nodes in the document."""
    sources: list[schema.GltfNode]
    """The nodes as parsed."""
    parents: list[int]
    """Positions of the parents in these lists; -1 for the roots of the scene."""
    meshes: list[int | None]
    """Indices of the nodes' meshes in the document; None for nodes without a mesh."""
    X_parent_node: NDArray[np.float64]
    """(N, 4, 4), poses in the frame of the parent."""
    X_world_node: NDArray[np.float64]
    """(N, 4, 4), poses in the document's world frame."""
    posed: list[int]
    """Positions of the nodes whose skin, morph weights or instances keep them from sharing the parts of their mesh."""
    warnings: list[str]
    """Sentences about properties of nodes and scenes that were ignored or repaired."""


def read_nodes(document: schema.Document, limits: GltfLimits) -> SceneNodes:
    """Return the nodes of the document's default scene. Raises GltfLimitError.

    A node that several nodes list as a child belongs to the first of them. Cycles therefore end.
    """
    nodes = document.nodes or []
    warnings: list[str] = []
    indices: list[int] = []
    sources: list[schema.GltfNode] = []
    parents: list[int] = []
    meshes: list[int | None] = []
    posed: list[int] = []
    extended: list[int] = []  # positions of the nodes with extensions
    levels: list[list[int]] = []  # positions of the nodes of each depth
    visited: set[int] = set()
    roots, roots_path = _roots(document, visited, warnings)
    stack: list[tuple[Iterator[int | None], int]] = [(roots, -1)]  # remaining children, position of their parent
    while stack:
        check_stop()
        children, parent = stack[-1]
        if len(levels) < len(stack):
            levels.append([])
        for index in children:
            if index is None:
                continue
            source = nodes[index] if 0 <= index < len(nodes) else None
            if not isinstance(source, schema.GltfNode) or index in visited:
                path = roots_path if parent < 0 else f"nodes[{indices[parent]}].children"
                with as_warning(warnings, "it is left out"):
                    checked_item(document.nodes, index, "nodes", path)  # raises for an invalid node
                    raise GltfError(f"{path}: nodes[{index}] is already in the scene")
                continue
            position = len(indices)
            if position == limits.max_nodes:
                raise GltfLimitError(f"the scene has more nodes than max_nodes = {limits.max_nodes}")
            visited.add(index)
            indices.append(index)
            sources.append(source)
            parents.append(parent)
            meshes.append(source.mesh)
            levels[len(stack) - 1].append(position)
            if source.extensions:
                extended.append(position)
            if source.mesh is not None and (
                source.skin is not None or source.weights is not None or INSTANCING in (source.extensions or ())
            ):
                posed.append(position)
            if source.children:
                stack.append((iter(source.children), position))
                break
        else:
            stack.pop()
    X_parent_node = _local_matrices(sources, indices, warnings)
    X_world_node = _world_matrices(X_parent_node, parents, levels)
    if len(levels) > limits.max_node_depth:
        _flatten_deep_nodes(parents, X_parent_node, limits.max_node_depth)
    if extended and (hidden := _hidden_nodes(sources, parents, indices, warnings)):
        for position in hidden:
            sources[position] = msgspec.structs.replace(sources[position], mesh=None, extensions=None)
            meshes[position] = None
        posed = [position for position in posed if position not in hidden]
    return SceneNodes(indices, sources, parents, meshes, X_parent_node, X_world_node, posed, warnings)


def _flatten_deep_nodes(parents: list[int], X_parent_node: NDArray[np.float64], max_depth: int) -> None:
    """Make nodes deeper than ``max_depth`` siblings of their ancestor at that depth. Their world matrices stay."""
    depths: list[int] = []
    with np.errstate(all="ignore"):
        for position, parent in enumerate(parents):
            if position % _NODES_PER_STOP_CHECK == 0:
                check_stop()
            if parent >= 0 and depths[parent] == max_depth:
                own, above = slice(position, position + 1), slice(parent, parent + 1)
                X_parent_node[own] = affine_product(X_parent_node[above], X_parent_node[own])
                parents[position] = parent = parents[parent]
            depths.append(depths[parent] + 1 if parent >= 0 else 1)


def _hidden_nodes(
    sources: list[schema.GltfNode], parents: list[int], indices: list[int], warnings: list[str]
) -> set[int]:
    """Return the positions of the nodes that KHR_node_visibility hides, and of their descendants."""
    hidden: set[int] = set()
    for position, (source, parent) in enumerate(zip(sources, parents, strict=True)):
        if source.extensions and VISIBILITY in source.extensions:
            name = f"nodes[{indices[position]}]"
            found = extension(source.extensions, VISIBILITY, schema.NodeVisibility, name, warnings)
            if found is not None and found.visible is False:
                hidden.add(position)
        if parent in hidden:
            hidden.add(position)
    return hidden


def _roots(document: schema.Document, visited: set[int], warnings: list[str]) -> tuple[Iterator[int | None], str]:
    """Return the indices of the root nodes, and the name of the property that lists them, for messages.

    The roots are those of the default scene, or else of the first one. In a document without scenes, all nodes without
    a parent are roots, and then one node of each cycle. The result reads ``visited`` while the caller adds nodes.
    """
    if document.scenes:
        index = document.scene or 0
        scene = document.scenes[index] if 0 <= index < len(document.scenes) else None
        if isinstance(scene, schema.Scene):
            return iter(scene.nodes or ()), f"scenes[{index}].nodes"
        with as_warning(warnings, "all nodes without a parent are drawn"):
            checked_item(document.scenes, index, "scenes", "scene")
    nodes = document.nodes or []
    children = {child for node in nodes if isinstance(node, schema.GltfNode) for child in node.children or ()}
    indices = [i for i, node in enumerate(nodes) if node is not None]
    return chain((i for i in indices if i not in children), (i for i in indices if i not in visited)), "nodes"


def _local_matrices(nodes: list[schema.GltfNode], indices: list[int], warnings: list[str]) -> NDArray[np.float64]:
    """Return X_parent_node of each node, (N, 4, 4). A property with the wrong number of numbers is ignored.

    The last row of each matrix is exactly (0, 0, 0, 1). ``indices``: those in the document, for messages.
    """
    X = np.empty((len(nodes), 4, 4))
    X[:] = IDENTITY
    with_matrix = [i for i, node in enumerate(nodes) if node.matrix is not None]
    with_trs = [
        i
        for i, node in enumerate(nodes)
        if node.matrix is None and (node.translation is not None or node.rotation is not None or node.scale is not None)
    ]
    if with_matrix:
        column_major = _values(nodes, with_matrix, "matrix", _DEFAULT_MATRIX, indices, warnings)
        matrices = column_major.reshape(-1, 4, 4).transpose(0, 2, 1)
        affine = (np.abs(matrices[:, 3] - IDENTITY[3]) <= _AFFINE_TOLERANCE).all(axis=1)
        for i in np.flatnonzero(~affine):
            name = f"nodes[{indices[with_matrix[i]]}].matrix"
            warnings.append(f"{name}: not affine, its last row {matrices[i, 3].tolist()} is ignored")
        X[with_matrix, :3] = matrices[:, :3]
    if with_trs:
        translations = _values(nodes, with_trs, "translation", _DEFAULT_TRANSLATION, indices, warnings)
        rotations = _values(nodes, with_trs, "rotation", _DEFAULT_ROTATION, indices, warnings)
        zeros = [indices[with_trs[i]] for i in np.flatnonzero(~rotations.any(axis=1))]
        warnings += [f"nodes[{index}].rotation: it has no length; the node is not rotated" for index in zeros]
        scales = _values(nodes, with_trs, "scale", _DEFAULT_SCALE, indices, warnings)
        poses = from_poses(np.concatenate((translations, rotations[:, (3, 0, 1, 2)]), axis=1))
        poses[:, :3, :3] *= scales[:, None, :]
        X[with_trs] = poses
    return X


def _values(
    nodes: list[schema.GltfNode],
    selected: list[int],
    name: str,
    default: tuple[float, ...],
    indices: list[int],
    warnings: list[str],
) -> NDArray[np.float64]:
    """Return a property of the nodes at the positions ``selected``, (len(selected), len(default)) float64."""
    values: list[Any] = [getattr(nodes[i], name) for i in selected]
    values = [default if value is None else value for value in values]
    try:
        result = np.array(values, np.float64)
    except ValueError:  # lists of different lengths
        result = np.empty(0)
    if result.shape != (len(selected), len(default)):
        paths = [f"nodes[{indices[i]}].{name}" for i in selected]
        result = np.array([vector_or_default(*each, default, warnings) for each in zip(values, paths, strict=True)])
    return result


def _world_matrices(
    X_parent_node: NDArray[np.float64], parents: list[int], levels: list[list[int]]
) -> NDArray[np.float64]:
    """Return X_world_node of each node, (N, 4, 4), not finite where a product overflows.

    ``parents``: position of each node's parent; -1 for roots. ``levels``: positions of the nodes by depth, roots first.
    """
    if len(levels) < 2:
        return X_parent_node
    X_world_node, parent_of = X_parent_node.copy(), np.array(parents)
    with np.errstate(all="ignore"):
        for level in levels[1:]:
            X_world_node[level] = affine_product(X_world_node[parent_of[level]], X_parent_node[level])
    return X_world_node
