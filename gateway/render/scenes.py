"""Posted scenes as draw lists; scenes with the same bytes are read once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from gateway.gltf import GltfCache, GltfCamera, HashedDocument, read_gltf
from gateway.render.config import RenderConfig
from gateway.render.draw_list import SceneTopology, TopologyKey, draw_list_of
from renderers.cache import Cache
from renderers.drawlist import LABEL_NONE, DrawList

_MAX_TOPOLOGIES: Final = 16
"""Maximum number of cached topologies; a few clients need one each for colour, depth and label images."""


@dataclass(frozen=True, slots=True, eq=False)
class PreparedScene:
    """A posted scene ready for rendering, without its nodes. Shared by all requests with the same scene."""

    camera: GltfCamera | None
    """``GltfScene.camera``."""
    has_geometry: bool
    """True where there are primitives, however far away."""
    generator: str
    """``asset.generator``."""
    element_count: int
    """Number of triangles, lines and points of all instances."""
    warnings: tuple[str, ...]
    unlabelled_count: int
    """Number of primitives without a label: they have no material, in which Drake's client encodes it."""
    draw_list: DrawList
    nbytes: int
    """Approximate size."""


class SceneStore:
    """Reads posted scenes and keeps the latest ones. Thread-safe.

    It has three caches, from the whole to its parts. ``scenes`` has the digest of all bytes as key: it serves a static
    scene, or depth after colour. ``geometry`` has the digests of a document's parts: it serves a moving robot, whose
    meshes stay the same. ``topologies`` keeps the draw lists' constant parts by the identity of that geometry.
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
        cached = self.scenes.get(document.digest)
        if cached is not None:
            return cached
        gltf = read_gltf(document, limits=self._limits, cache=self.geometry)
        draw_list = draw_list_of(gltf, self._topologies)
        scene = PreparedScene(
            camera=gltf.camera,
            has_geometry=gltf.instance_count > 0,
            generator=gltf.generator,
            element_count=gltf.element_count,
            warnings=gltf.warnings,
            unlabelled_count=sum(instance.label == LABEL_NONE for instance in draw_list.instances),
            draw_list=draw_list,
            nbytes=len(document.data) + gltf.content.mesh_bytes,
        )
        self.scenes.put(document.digest, scene, scene.nbytes)
        return scene
