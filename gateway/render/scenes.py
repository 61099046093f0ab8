"""Posted scenes, read and flattened; scenes with the same bytes are read once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from gateway.gltf import GltfCache, GltfCamera, HashedDocument, read_gltf
from gateway.render.config import RenderConfig
from gateway.render.draw_list import SceneTopology, TopologyKey, draw_list_of
from renderers.cache import Cache
from renderers.drawlist import DrawList

_MAX_TOPOLOGIES: Final = 16
"""Scenes whose objects move: the colour, depth and label images of a few clients."""


@dataclass(frozen=True, slots=True, eq=False)
class PreparedScene:
    """A posted scene ready for rendering, shared by all requests for it. Its thousands of nodes are dropped."""

    camera: GltfCamera | None
    """``GltfScene.camera``."""
    has_geometry: bool
    """True where there are primitives, however far away."""
    generator: str
    """``asset.generator``."""
    element_count: int
    """Number of triangles, lines and points of all instances."""
    warnings: tuple[str, ...]
    drawn: DrawList
    nbytes: int
    """Approximate size."""


class SceneStore:
    """Reads posted scenes and keeps the latest ones. Thread-safe.

    Three caches, from the whole to its parts: ``scenes`` by the digest of all bytes (a static scene, or depth after
    colour), ``geometry`` by the digests of a document's parts (a moving robot brings the same meshes with other poses),
    ``topologies`` by the identity of such a part.
    """

    def __init__(self, config: RenderConfig) -> None:
        self._limits = config.gltf
        self.scenes: Final[Cache[str, PreparedScene]] = Cache(config.scene_cache_bytes, config.scene_cache_count)
        self.geometry: Final = GltfCache(config.mesh_cache_bytes)
        self._topologies: Cache[TopologyKey, SceneTopology] = Cache(config.mesh_cache_bytes, _MAX_TOPOLOGIES)

    def get(self, document: HashedDocument) -> PreparedScene:
        """Return the scene of a document.

        Raises:
            GltfError: It cannot be read; nothing is kept then.
        """
        found = self.scenes.get(document.digest)
        if found is not None:
            return found
        gltf = read_gltf(document, limits=self._limits, cache=self.geometry)
        scene = PreparedScene(
            camera=gltf.camera,
            has_geometry=gltf.instance_count > 0,
            generator=gltf.generator,
            element_count=gltf.element_count,
            warnings=gltf.warnings,
            drawn=draw_list_of(gltf, self._topologies),
            nbytes=len(document.data) + gltf.content.mesh_bytes,
        )
        self.scenes.put(document.digest, scene, scene.nbytes)
        return scene
