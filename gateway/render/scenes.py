"""Reads posted scenes as draw lists, with caches: scenes with the same bytes are read once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from gateway.gltf import GltfCache, GltfCamera, HashedDocument, read_gltf
from gateway.render.config import RenderConfig
from gateway.render.draw_list import SceneTopology, TopologyKey, draw_list_of
from renderers.cache import SHARED, Cache, CacheBudget
from renderers.drawlist import LABEL_NONE, DrawList, PosedInstances

_MAX_TOPOLOGIES: Final = 16
"""Maximum number of cached topologies; a few clients need one each for colour, depth and label images."""


@dataclass(frozen=True, slots=True, eq=False)
class PreparedScene:
    """A posted scene ready for rendering. Shared by all requests with the same scene."""

    camera: GltfCamera | None
    """``GltfScene.camera``."""
    has_geometry: bool
    """True if the scene has primitives, even if all of them are too far away to be drawn."""
    generator: str
    """``asset.generator``."""
    element_count: int
    """Number of triangles, lines and points of all instances."""
    warnings: tuple[str, ...]
    """Sentences about properties that the reader ignored or repaired."""
    unlabelled_count: int
    """Number of instances without a label: Drake's client sends labels in materials, and they have none."""
    draw_list: DrawList
    nbytes: int
    """Approximate size in bytes."""


class SceneStore:
    """Reads posted scenes and keeps the latest ones. Thread-safe.

    There are three caches. ``scenes`` has the digest of the whole document as key: it serves static scenes, and depth
    images of a scene after its colour image: a quarter less time to read, draw and encode (geometric mean of Drake's
    recorded scenes). ``geometry`` has the digests of parts of a document as keys: it serves
    moving robots, whose meshes stay the same. ``topologies`` keeps what such robots' draw lists have in common.
    """

    def __init__(self, config: RenderConfig, caches: CacheBudget = SHARED) -> None:
        self._limits = config.gltf
        self.scenes: Final[Cache[str, PreparedScene]] = Cache("scenes", config.scene_cache_count, budget=caches)
        self.geometry: Final = GltfCache(caches)
        self._topologies: Cache[TopologyKey, SceneTopology] = Cache("topologies", _MAX_TOPOLOGIES, budget=caches)

    def get(self, document: HashedDocument, *, decode_images: bool = False) -> PreparedScene:
        """Return the scene of a document.

        Args:
            decode_images: True: read it anew, without textures whose images cannot be decoded.

        Raises:
            GltfError: The document cannot be read. It is not cached.
        """
        if decode_images:
            gltf = read_gltf(document.data, limits=self._limits, decode_images=True)
        else:
            cached = self.scenes.get(document.digest)
            if cached is not None:
                return cached
            gltf = read_gltf(document, limits=self._limits, cache=self.geometry)
        draw_list = draw_list_of(gltf, self._topologies)
        assert isinstance(draw_list.instances, PosedInstances)
        scene = PreparedScene(
            camera=gltf.camera,
            has_geometry=gltf.instance_count > 0,
            generator=gltf.generator,
            element_count=gltf.element_count,
            warnings=gltf.warnings,
            unlabelled_count=draw_list.instances.set.labels.count(LABEL_NONE),
            draw_list=draw_list,
            nbytes=len(document.data) + gltf.content.mesh_bytes,
        )
        self.scenes.put(document.digest, scene, scene.nbytes)
        return scene
