"""A scene read from a glTF document, the result of ``read_gltf``: its tree, its cameras, and names of its meshes."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal, TypeAlias

import numpy as np

from gateway.files.gltf import schema
from gateway.files.gltf.document_cache import DocumentContent
from gateway.files.gltf.gltf_errors import as_warning, checked_item
from gateway.files.gltf.material_reader import DEFAULT_MATERIAL
from gateway.files.gltf.nodes import NodeParts, SceneNodes
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Node, Path, PathElement
from gateway.scene.tree.transforms import IDENTITY, Matrix
from renderers.camera import OPENGL_FROM_OPTICAL
from renderers.drawlist import Light

_SCALE_TOLERANCE: Final = 1e-12
"""Maximum deviation of an axis' length from 1 that is rounding and not scale."""
_RESEMBLES_DRAKE: Final = (
    "it is drawn Y up, as glTF says, but VTK's exporter wrote it as for Drake's render client: a saved request of "
    "Drake needs --up z --look phong (a robot's mesh --robot-gltf-up z)"
)

Up: TypeAlias = Literal["auto", "y", "z"]
"""Up axis of a file; ``auto``: Z if Drake's render client merged it, else Y."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacedCamera:
    """A camera, with the pose of the node that refers to it."""

    index: int
    """Index in the document's ``cameras``."""
    name: str
    """Name of the camera; the name of its node if the camera has none."""
    X_world_camera: Matrix
    """(4, 4) float64: pose of the optical frame (+Z forward, +X right, +Y down) in the document's world frame."""
    yfov: float | None
    """Vertical field of view, radians; None for an orthographic camera."""
    znear: float
    """Distance of the near plane, metres; 0 if it is absent."""
    zfar: float | None
    """Distance of the far plane, metres; None for an infinite projection."""
    xmag: float | None = None
    """Half of the width of an orthographic camera's view, metres; None for a perspective camera."""


@dataclass(frozen=True, eq=False)
class GltfScene:
    """A scene read from a document."""

    content: DocumentContent
    """Everything but the nodes. Documents that differ only in their nodes share this object."""
    nodes: SceneNodes
    parts: NodeParts
    """Primitives of each node."""
    cameras: tuple[PlacedCamera, ...]
    """One for every node with a camera, parents first."""
    node_lights: Mapping[int, Light]
    """Lights of KHR_lights_punctual in the frame of their node, by its position in ``nodes``."""
    instance_count: int
    """Number of primitives of all nodes, one for each use; 0 for a scene without geometry."""
    element_count: int
    """Number of triangles, lines and points of all instances."""
    warnings: tuple[str, ...]
    """Sentences about properties that were ignored or repaired."""

    @cached_property
    def root(self) -> Node:
        """The nodes as an immutable tree, in the document's own axes (not rotated to Z up)."""
        parts = self.parts.copy()
        for position, light in self.node_lights.items():
            parts[position] = (*(parts[position] or ()), Part(light, DEFAULT_MATERIAL))
        return _tree_of(self.nodes, parts)

    @cached_property
    def lights(self) -> tuple[Light, ...]:
        """The lights in the document's world frame."""
        placed = (light.placed(self.nodes.X_world_node[position]) for position, light in self.node_lights.items())
        return tuple(light for light in placed if light is not None)

    @cached_property
    def models(self) -> dict[Path, str]:
        """Name of the mesh of each node with a mesh, by the node's path in ``root``."""
        names = self.content.mesh_names
        pairs = zip(_paths_of(self.nodes), self.nodes.meshes, strict=True)
        return {path: names[mesh] for path, mesh in pairs if mesh is not None}

    @property
    def generator(self) -> str:
        """``asset.generator``."""
        return self.content.generator

    @property
    def from_drake(self) -> bool:
        """True for a document from Drake's render client."""
        return self.content.from_drake

    def is_z_up(self, up: Up, warnings: list[str]) -> bool:
        """Return True if the file is Z up. ``auto`` adds a warning to a file that may be a saved request of Drake."""
        if up == "auto" and self.content.resembles_drake:
            warnings.append(_RESEMBLES_DRAKE)
        return up == "z" or (up == "auto" and self.from_drake)

    @property
    def camera(self) -> PlacedCamera | None:
        """The camera of a render request: camera 0 of the document, at the first node that refers to it.

        Without such a node, it is at the origin and looks along -Z. The result is None for a document without cameras:
        Drake's client writes none if all of the scene's meshes are glTF files.
        """
        for camera in self.cameras:
            if camera.index == 0:
                return camera
        if not self.content.cameras:
            return None
        source = self.content.cameras[0]
        return _camera(
            source if isinstance(source, schema.GltfCamera) else schema.GltfCamera(), 0, "", OPENGL_FROM_OPTICAL
        )


def read_cameras(
    document_cameras: list[schema.GltfCamera | None], nodes: SceneNodes, warnings: list[str]
) -> tuple[PlacedCamera, ...]:
    """Return the camera of each node that has one, parents first. A reference to no camera gives a warning."""
    cameras = []
    for index, node, X_world_node in zip(nodes.indices, nodes.sources, nodes.X_world_node, strict=True):
        if node.camera is None:
            continue
        source = document_cameras[node.camera] if 0 <= node.camera < len(document_cameras) else None
        if isinstance(source, schema.GltfCamera):
            cameras.append(_camera(source, node.camera, node.name, _optical_pose(X_world_node)))
            continue
        with as_warning(warnings, "the node has no camera"):
            checked_item(document_cameras, node.camera, "cameras", f"nodes[{index}].camera")
    return tuple(cameras)


def _camera(source: schema.GltfCamera, index: int, node_name: str | None, X_world_camera: Matrix) -> PlacedCamera:
    """Return a camera of the document with a pose. A perspective wins over an orthographic projection beside it."""
    is_perspective = source.perspective is not None
    projection = source.perspective or source.orthographic or schema.Projection()
    return PlacedCamera(
        index=index,
        name=source.name or node_name or "",
        X_world_camera=X_world_camera,
        yfov=projection.yfov if is_perspective else None,
        xmag=None if is_perspective else projection.xmag,
        znear=projection.znear or 0.0,
        zfar=projection.zfar,
    )


def _optical_pose(X_world_node: Matrix) -> Matrix:
    """Return the pose of the optical frame of a camera whose node has the pose ``X_world_node``.

    A glTF camera looks along -Z with +Y up. The scale of its node does not affect it (glTF 2.0, 3.10.2).
    """
    pose = X_world_node.copy()
    with np.errstate(all="ignore"):
        axis_lengths = np.linalg.norm(pose[:3, :3], axis=0)
        has_scale = (np.abs(axis_lengths - 1.0) > _SCALE_TOLERANCE).any()
        if has_scale and ((axis_lengths > 0.0) & (axis_lengths < np.inf)).all():
            pose[:3, :3] /= axis_lengths
    pose[:3, 1:3] = 0.0 - pose[:3, 1:3]  # negation would make negative zeros
    return pose


def mesh_names(nodes: SceneNodes, meshes: list[schema.GltfMesh | None] | None) -> dict[int, str]:
    """Return a name for each mesh in use, by mesh index. Meshes without a name are called after their first node."""
    names: dict[int, str] = {}
    used: dict[str, int] = {}
    for position, mesh in enumerate(nodes.meshes):
        if mesh is not None and mesh not in names:
            source = meshes[mesh] if meshes is not None and 0 <= mesh < len(meshes) else None
            name = (source.name if isinstance(source, schema.GltfMesh) else "") or nodes.sources[position].name
            names[mesh] = _unique(name or f"mesh{mesh}", used)
    return names


def _paths_of(nodes: SceneNodes) -> list[Path]:
    """Return the path of each node in the tree."""
    paths: list[Path] = []
    for name, parent in zip(_names(nodes), nodes.parents, strict=True):
        paths.append((*(paths[parent] if parent >= 0 else ()), name))
    return paths


def _tree_of(nodes: SceneNodes, parts: NodeParts) -> Node:
    """Return a committed tree: a root without parts, whose children are the roots of the scene."""
    names = _names(nodes)
    not_identity = (nodes.X_parent_node != IDENTITY).any(axis=(1, 2)).tolist()
    matrices = [X if differs else IDENTITY for X, differs in zip(nodes.X_parent_node, not_identity, strict=True)]
    # children[p] has the children of the node at position p, last child first; children[-1] has the roots.
    children: list[dict[PathElement, Node]] = [{} for _ in range(len(names) + 1)]
    for position in range(len(names) - 1, -1, -1):
        ordered = dict(reversed(children[position].items()))
        children[nodes.parents[position]][names[position]] = Node(parts[position], matrices[position], ordered)
    return Node(None, IDENTITY, dict(reversed(children[-1].items())))


def _names(nodes: SceneNodes) -> list[str]:
    """Return the name of each node, unique among its siblings."""
    names = [source.name or f"node{index}" for index, source in zip(nodes.indices, nodes.sources, strict=True)]
    if len(set(zip(nodes.parents, names, strict=True))) == len(names):
        return names
    numbers: dict[int, dict[str, int]] = {}
    return [_unique(name, numbers.setdefault(parent, {})) for name, parent in zip(names, nodes.parents, strict=True)]


def _unique(name: str, last_numbers: dict[str, int]) -> str:
    """Return ``name``, or the first of ``name#2``, ``name#3`` ... that no sibling has.

    ``last_numbers``: the last number tried, by name; extended here. With 100,000 equal names, trying all numbers for
    each name would take minutes.
    """
    candidate, number = name, last_numbers.get(name, 1)
    while candidate in last_numbers:
        number += 1
        candidate = f"{name}#{number}"
    last_numbers[name] = number
    last_numbers.setdefault(candidate, 1)
    return candidate
