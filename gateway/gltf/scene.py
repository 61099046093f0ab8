"""What the reader returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gateway.scene.tree import Node, Path
from renderers.drawlist import Light

if TYPE_CHECKING:
    from gateway.gltf.nodes import NodeTree, Visits

DRAKE_GENERATORS = frozenset({"VTK", "Drake glTF merger"})
"""``asset.generator`` of what Drake's render client sends: primitives and OBJ only, or with glTF meshes."""


@dataclass(frozen=True, slots=True, eq=False)
class GltfCamera:
    """A camera as a node of the scene carries it."""

    index: int
    """In the document's ``cameras``."""
    name: str
    """Of the camera, else of its node."""
    X_world_camera: NDArray[np.float64]
    """(4, 4) float64: pose of the optical frame (+Z forward, +X right, +Y down) in the document's world."""
    yfov: float | None
    """Radians; None: orthographic."""
    znear: float
    zfar: float | None
    """None: an infinite projection."""
    aspect: float | None
    """Width / height; None: the viewport's."""
    visits: Visits | None = None
    """The nodes of the scene; not the tree, which holds the camera: what refers to itself is freed late."""
    position: int = -1
    """Among these."""

    @property
    def path(self) -> Path:
        """Of its node in ``GltfScene.root``."""
        return () if self.visits is None else self.visits.path(self.position)


@dataclass(frozen=True, slots=True)
class GltfCounts:
    """Lengths of the document's arrays, for logs and metrics."""

    nodes: int = 0
    meshes: int = 0
    materials: int = 0
    textures: int = 0
    images: int = 0
    cameras: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class GltfScene:
    """A document, read."""

    nodes: NodeTree
    """What the scene's nodes draw, and where."""
    generator: str
    """``asset.generator``; see ``DRAKE_GENERATORS``."""
    cameras: tuple[GltfCamera, ...]
    """One for every node with a camera, in scene order (parents first)."""
    camera_count: int
    """Entries of the document's ``cameras``, in use or not."""
    instance_count: int
    """Parts of all nodes together; 0: there is nothing to draw."""
    element_count: int
    """Triangles, lines and points of all instances together."""
    warnings: tuple[str, ...]
    """What was ignored or repaired, a sentence each."""
    counts: GltfCounts = GltfCounts()
    lights: tuple[Light, ...] = ()
    """KHR_lights_punctual, in the document's world."""

    @property
    def root(self) -> Node:
        """Committed tree in the document's own axes: no rotation to Z up is applied. Its children are the scene's
        nodes. Made when first asked for."""
        return self.nodes.root

    @property
    def from_drake(self) -> bool:
        """Whether Drake's render client made the document."""
        return self.generator in DRAKE_GENERATORS

    @property
    def camera_node_missing(self) -> bool:
        """The document has cameras, but no node of the scene carries the first one."""
        return self.camera_count > 0 and all(camera.index != 0 for camera in self.cameras)

    @property
    def camera(self) -> GltfCamera | None:
        """The camera that a render request means: the first node that carries camera 0.

        A document with cameras but no such node means the identity pose; one without cameras gives None (Drake's
        client leaves the camera out when the scene holds glTF meshes only).
        """
        for camera in self.cameras:
            if camera.index == 0:
                return camera
        if self.camera_count == 0:
            return None
        return GltfCamera(0, "", np.diag((1.0, -1.0, -1.0, 1.0)), None, 0.0, None, None)
