"""Local and world matrices of nodes, computed for all nodes together: NumPy calls for each take ten times as long."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.gltf import schema
from gateway.gltf.parser import vector_or_default
from gateway.scene.transforms import IDENTITY, affine_product, from_poses

_AFFINE_TOLERANCE: Final = 1e-6
"""Maximum deviation of a matrix's last row from (0, 0, 0, 1)."""
_DEFAULT_MATRIX: Final = tuple(IDENTITY.ravel().tolist())
_DEFAULT_TRANSLATION: Final = (0.0, 0.0, 0.0)
_DEFAULT_ROTATION: Final = (0.0, 0.0, 0.0, 1.0)
"""Quaternion (x, y, z, w), as in glTF."""
_DEFAULT_SCALE: Final = (1.0, 1.0, 1.0)


def local_matrices(nodes: list[schema.Node], indices: list[int], warnings: list[str]) -> NDArray[np.float64]:
    """Return X_parent_node of each node. A property with the wrong number of numbers is ignored.

    Args:
        indices: Indices of the nodes in the document, for messages.

    Returns:
        (N, 4, 4) float64. The last row of each matrix is exactly (0, 0, 0, 1).
    """

    def values_of(selected: list[int], name: str, default: tuple[float, ...]) -> NDArray[np.float64]:
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

    X = np.empty((len(nodes), 4, 4))
    X[:] = IDENTITY
    with_matrix = [i for i, node in enumerate(nodes) if node.matrix is not None]
    with_trs = [
        i
        for i, node in enumerate(nodes)
        if node.matrix is None and (node.translation is not None or node.rotation is not None or node.scale is not None)
    ]
    if with_matrix:
        column_major = values_of(with_matrix, "matrix", _DEFAULT_MATRIX)
        matrices = column_major.reshape(-1, 4, 4).transpose(0, 2, 1)
        affine = (np.abs(matrices[:, 3] - IDENTITY[3]) <= _AFFINE_TOLERANCE).all(axis=1)
        for i in np.flatnonzero(~affine):
            name = f"nodes[{indices[with_matrix[i]]}].matrix"
            warnings.append(f"{name}: not affine, its last row {matrices[i, 3].tolist()} is ignored")
        X[with_matrix, :3] = matrices[:, :3]
    if with_trs:
        translations = values_of(with_trs, "translation", _DEFAULT_TRANSLATION)
        rotations = values_of(with_trs, "rotation", _DEFAULT_ROTATION)
        zeros = [indices[with_trs[i]] for i in np.flatnonzero(~rotations.any(axis=1))]
        warnings += [f"nodes[{index}].rotation: it has no length; the node is not rotated" for index in zeros]
        scales = values_of(with_trs, "scale", _DEFAULT_SCALE)
        poses = from_poses(np.concatenate((translations, rotations[:, (3, 0, 1, 2)]), axis=1))
        poses[:, :3, :3] *= scales[:, None, :]
        X[with_trs] = poses
    return X


def world_matrices(
    X_parent_node: NDArray[np.float64], parents: list[int], levels: list[list[int]]
) -> NDArray[np.float64]:
    """Return X_world_node of each node: the product of the matrices from its root to the node.

    Args:
        parents: Position of each node's parent; -1 for roots.
        levels: For each depth, roots first: the positions of its nodes.

    Returns:
        (N, 4, 4) float64; not finite where a product overflows.
    """
    if len(levels) < 2:
        return X_parent_node
    X_world_node = X_parent_node.copy()
    with np.errstate(all="ignore"):
        for level in levels[1:]:
            level_parents = [parents[position] for position in level]
            X_world_node[level] = affine_product(X_world_node[level_parents], X_parent_node[level])
    return X_world_node
