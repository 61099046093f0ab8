"""A scene read from a glTF document: the result of ``read_gltf``."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from gateway.gltf.cameras import GltfCamera
from gateway.gltf.document_cache import DocumentContent
from gateway.gltf.nodes import NodeParts, SceneNodes
from gateway.gltf.schema import DRAKE_GENERATORS
from gateway.scene.tree import Node, Path
from renderers.camera import OPENGL_FROM_OPTICAL
from renderers.drawlist import Light


@dataclass(frozen=True, eq=False)
class GltfScene:
    """A scene read from a document."""

    content: DocumentContent
    """Everything but the nodes. Documents that differ only in their nodes share this object."""
    nodes: SceneNodes
    parts: NodeParts
    """Primitives of each node."""
    cameras: tuple[GltfCamera, ...]
    """One for every node with a camera, parents first."""
    lights: tuple[Light, ...]
    """Lights of KHR_lights_punctual, in the document's world frame."""
    instance_count: int
    """Number of primitives of all nodes, one for each use; 0 for a scene without geometry."""
    element_count: int
    """Number of triangles, lines and points of all instances."""
    warnings: tuple[str, ...]
    """Sentences about properties that were ignored or repaired."""

    @cached_property
    def root(self) -> Node:
        """Committed tree in the document's own axes (not rotated to Z up). Its children are the scene's nodes."""
        return self.nodes.tree(self.parts)

    @cached_property
    def models(self) -> dict[Path, str]:
        """Name of the mesh of each node with a mesh, by the node's path in ``root``."""
        names = self.content.mesh_names
        pairs = zip(self.nodes.paths(), self.nodes.meshes, strict=True)
        return {path: names[mesh] for path, mesh in pairs if mesh is not None}

    @property
    def generator(self) -> str:
        """``asset.generator``."""
        return self.content.generator

    @property
    def from_drake(self) -> bool:
        """True for a document from Drake's render client."""
        return self.generator in DRAKE_GENERATORS

    @property
    def camera(self) -> GltfCamera | None:
        """The camera of a render request: camera 0 of the document, at the first node that refers to it.

        If the document has cameras but no such node, the camera has the identity pose of a glTF camera. The result is
        None for a document without cameras: Drake's client writes none if all of the scene's meshes are glTF files.
        """
        for camera in self.cameras:
            if camera.index == 0:
                return camera
        if not self.content.cameras:
            return None
        return GltfCamera(0, "", OPENGL_FROM_OPTICAL, None, 0.0, None)
