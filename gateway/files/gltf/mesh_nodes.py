"""Adds nodes for instances and skinned meshes, and finds the poses of deformed meshes."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.files.gltf import schema
from gateway.files.gltf.accessors import Accessors
from gateway.files.gltf.deformation import MeshPose
from gateway.files.gltf.gltf_errors import GltfError, GltfLimitError, GltfLimits, as_warning, checked_item
from gateway.files.gltf.nodes import INSTANCING, SceneNodes
from gateway.files.gltf.parser import extension
from gateway.files.gltf.vertex_attributes import rgba_colors
from gateway.scene.tree.transforms import IDENTITY, affine_product, from_poses
from renderers.stop import check_stop

_INSTANCE_ATTRIBUTES: Final[dict[str, tuple[float, ...]]] = {
    "TRANSLATION": (0.0, 0.0, 0.0),
    "ROTATION": (0.0, 0.0, 0.0, 1.0),
    "SCALE": (1.0, 1.0, 1.0),
}
"""Default values by attribute. Rotations are quaternions (x, y, z, w)."""
_MIRROR: Final = np.diag((-1.0, 1.0, 1.0, 1.0))


class _AddedNodes(NamedTuple):
    """Nodes to add, which get the mesh of another node."""

    original: int
    """Position of the node whose mesh moves to them."""
    parent: int
    """Position of their parent, -1 for roots."""
    X_parent_node: NDArray[np.float64]
    """(N, 4, 4), their poses in the frame of the parent."""


def expand_mesh_nodes(
    document: schema.Document, nodes: SceneNodes, accessors: Accessors, limits: GltfLimits, warnings: list[str]
) -> tuple[SceneNodes, dict[int, MeshPose]]:
    """Return the nodes with instances and skinned meshes as further nodes, and poses by position of deformed meshes.

    An instance becomes a child of its node. A mesh with a skin becomes a root: the transform of its own node does not
    apply to it (glTF 2.0, 3.7.3.3). A node whose skin or instances cannot be read is drawn without them, with a
    warning. Nodes without a pose have the morph weights of their mesh. Raises GltfLimitError.
    """
    skins = _Skins(document, nodes, accessors)
    weights_of_mesh: dict[int, tuple[float, ...]] = {}
    poses: dict[int, MeshPose] = {}
    added: list[_AddedNodes] = []
    count = len(nodes.indices)
    for position in nodes.posed:
        source, mesh_index = nodes.sources[position], nodes.meshes[position]
        assert mesh_index is not None
        check_stop()
        name = f"nodes[{nodes.indices[position]}]"
        with as_warning(warnings, f"{name} is drawn at rest and once"):
            if source.weights is not None:
                weights = tuple(source.weights)
            else:
                if mesh_index not in weights_of_mesh:
                    mesh = checked_item(document.meshes, mesh_index, "meshes", f"{name}.mesh")
                    weights_of_mesh[mesh_index] = tuple(mesh.weights or ())
                weights = weights_of_mesh[mesh_index]
            new_nodes, joint_matrices = None, None
            colors: list[tuple[float, ...]] = []
            if source.skin is not None:
                with np.errstate(all="ignore"):
                    is_mirrored = bool(np.linalg.det(nodes.X_world_node[position, :3, :3]) < 0.0)
                X_world_mesh, joint_matrices = skins.get(source.skin, f"{name}.skin", is_mirrored)
                new_nodes = _AddedNodes(position, -1, X_world_mesh[None])
                if INSTANCING in (source.extensions or {}):
                    warnings.append(f"{name}.extensions.{INSTANCING}: ignored, as the mesh has a skin")
            elif instancing := extension(source.extensions, INSTANCING, schema.Instancing, name, warnings):
                X_node_instances = _instance_poses(instancing, accessors, limits, f"{name}.extensions.{INSTANCING}")
                new_nodes = _AddedNodes(position, position, X_node_instances)
                colors = _instance_colors(instancing, accessors, len(X_node_instances), name, warnings)
            pose = MeshPose(weights, joint_matrices)
            if new_nodes is None:
                poses[position] = pose
                continue
            new_count = count + len(new_nodes.X_parent_node)
            if new_count > limits.max_nodes:
                raise GltfLimitError(f"{name}: the scene has more nodes than max_nodes = {limits.max_nodes}")
            added.append(new_nodes)
            poses |= dict.fromkeys(range(count, new_count), pose)
            colored = {color: MeshPose(weights, None, color) for color in set(colors)}
            poses |= {count + number: colored[color] for number, color in enumerate(colors)}
            count = new_count
    return _with_nodes(nodes, added), poses


def _with_nodes(nodes: SceneNodes, added: list[_AddedNodes]) -> SceneNodes:
    """Return the nodes, followed by new ones that have the meshes of some of them."""
    if not added:
        return nodes
    indices, sources, parents, meshes = [*nodes.indices], [*nodes.sources], [*nodes.parents], [*nodes.meshes]
    X_world_node = [nodes.X_world_node]
    for original, parent, X_parent_node in added:
        count, mesh = len(X_parent_node), meshes[original]
        indices += [indices[original]] * count
        sources += [schema.GltfNode(name=sources[original].name, mesh=mesh)] * count
        parents += [parent] * count
        meshes[original] = None
        meshes += [mesh] * count
        X_world_parent = IDENTITY if parent < 0 else nodes.X_world_node[parent]
        with np.errstate(all="ignore"):
            X_world_node.append(affine_product(np.broadcast_to(X_world_parent, X_parent_node.shape), X_parent_node))
    X_parent_nodes = np.concatenate([nodes.X_parent_node, *(new_nodes.X_parent_node for new_nodes in added)])
    X_world_nodes = np.concatenate(X_world_node)
    return SceneNodes(indices, sources, parents, meshes, X_parent_nodes, X_world_nodes, nodes.posed, nodes.warnings)


class _Skins:
    """The skins of one document, each read at its first use."""

    def __init__(self, document: schema.Document, nodes: SceneNodes, accessors: Accessors) -> None:
        self._sources = document.skins
        self._nodes = nodes
        self._accessors = accessors
        self._position_of_node = {index: position for position, index in enumerate(nodes.indices)}
        self._skins: dict[tuple[int, bool], tuple[NDArray[np.float64], NDArray[np.float32]]] = {}
        """Skins by index, and True for those of mirrored nodes."""

    def get(self, index: int, path: str, is_mirrored: bool) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Return X_world_mesh of the meshes with a skin, (4, 4), and the matrices of its joints, (J, 3, 4).

        The pose is a translation to the first joint. The joint matrices are relative to it, so their float32 values
        stay exact far from the origin. A mirrored node turns over the triangles, although its joints place them (glTF
        2.0, 3.7.4): then the pose mirrors, too, and the matrices undo it.
        """
        if (index, is_mirrored) not in self._skins:
            X_world_mesh, matrices = self._read(checked_item(self._sources, index, "skins", path), f"skins[{index}]")
            if is_mirrored:
                X_world_mesh = X_world_mesh @ _MIRROR
                matrices = np.concatenate((-matrices[:, :1], matrices[:, 1:]), axis=1)
            self._skins[index, is_mirrored] = X_world_mesh, matrices
        return self._skins[index, is_mirrored]

    def _read(self, skin: schema.Skin, name: str) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        joints = skin.joints or []
        if not joints:
            raise GltfError(f"{name}.joints: there are none")
        if len(set(joints)) < len(joints):
            raise GltfError(f"{name}.joints: a node is there twice")
        for k, node in enumerate(joints):
            if node not in self._position_of_node:
                raise GltfError(f"{name}.joints[{k}]: nodes[{node}] is not part of the scene")
        matrices = self._nodes.X_world_node[[self._position_of_node[node] for node in joints]]
        if skin.inverse_bind_matrices is not None:
            path = f"{name}.inverseBindMatrices"
            accessor = self._accessors.get(skin.inverse_bind_matrices, path)
            if accessor.components != 16 or accessor.dtype != np.float32 or accessor.count < len(joints):
                raise GltfError(f"{path}: {accessor.name} does not have {len(joints)} float matrices (MAT4)")
            column_major = accessor.values(0, len(joints)).astype(np.float64).reshape(-1, 4, 4)
            with np.errstate(all="ignore"):
                matrices = affine_product(matrices, column_major.transpose(0, 2, 1))
        X_world_mesh = IDENTITY.copy()
        X_world_mesh[:3, 3] = np.nan_to_num(matrices[0, :3, 3], nan=0.0, posinf=0.0, neginf=0.0)
        joint_matrices = matrices[:, :3].copy()
        with np.errstate(all="ignore"):
            joint_matrices[:, :, 3] -= X_world_mesh[:3, 3]
            return X_world_mesh, joint_matrices.astype(np.float32)


def _instance_colors(
    source: schema.Instancing, accessors: Accessors, count: int, name: str, warnings: list[str]
) -> list[tuple[float, ...]]:
    """Return the linear RGBA colour of each instance, as three.js writes them; empty if there are none."""
    index = (source.attributes or {}).get("_COLOR_0")
    if index is None:
        return []
    path = f"{name}.extensions.{INSTANCING}.attributes._COLOR_0"
    with as_warning(warnings, "the instances have no colours"):
        accessor = accessors.get(index, path)
        if accessor.components not in (3, 4) or accessor.count != count:
            found = f"{accessor.count} values of {accessor.components} components"
            raise GltfError(f"{path}: {accessor.name} has {found}, not {count} of 3 or 4")
        return list(map(tuple, rgba_colors(np.nan_to_num(accessor.floats())).astype(np.float64).tolist()))
    return []


def _instance_poses(
    source: schema.Instancing, accessors: Accessors, limits: GltfLimits, path: str
) -> NDArray[np.float64]:
    """Return the poses of a node's instances in the frame of the node, (number of instances, 4, 4)."""
    attributes = source.attributes or {}
    columns: dict[str, NDArray[np.float64]] = {}
    for attribute, default in _INSTANCE_ATTRIBUTES.items():
        if (index := attributes.get(attribute)) is not None:
            accessor = accessors.get(index, f"{path}.attributes.{attribute}")
            if accessor.components != len(default):
                raise GltfError(f"{path}.attributes.{attribute}: {accessor.name} has {accessor.components} components")
            if accessor.count > limits.max_nodes:  # before memory is allocated
                raise GltfLimitError(f"{path}: {accessor.count} instances are more than max_nodes = {limits.max_nodes}")
            columns[attribute] = accessor.floats().astype(np.float64)
    if len({len(values) for values in columns.values()}) != 1:
        raise GltfError(f"{path}.attributes: no TRANSLATION, ROTATION or SCALE, or of different lengths")
    count = len(next(iter(columns.values())))
    translations, quaternions, scales = (
        columns.get(attribute, np.tile(default, (count, 1))) for attribute, default in _INSTANCE_ATTRIBUTES.items()
    )
    if not all(np.isfinite(values).all() for values in columns.values()):
        raise GltfError(f"{path}.attributes: not finite")
    matrices = from_poses(np.concatenate((translations, quaternions[:, (3, 0, 1, 2)]), axis=1))
    matrices[:, :3, :3] *= scales[:, None, :]
    return matrices
