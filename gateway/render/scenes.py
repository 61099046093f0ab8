"""Scenes by the hash of their bytes: what was read before is not read again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.gltf import CacheStats, HashedDocument, MeshCache, read_gltf
from gateway.render.config import RenderConfig
from gateway.render.draw_list import Companies, Company
from renderers.cache import Cache
from renderers.drawlist import DrawList


@dataclass(frozen=True, slots=True, eq=False)
class Eye:
    """What matters of a scene's camera: pictures are asked for with lenses of their own."""

    name: str
    X_world_camera: NDArray[np.float64]
    """As of ``GltfCamera``."""
    znear: float
    """As of ``GltfCamera``."""


@dataclass(frozen=True, slots=True, eq=False)
class PreparedScene:
    """A scene, read and flattened; shared by all pictures of it. Not its nodes, which are thousands of objects."""

    camera: Eye | None
    """As of ``GltfScene``."""
    has_geometry: bool
    """Whether there is anything to draw, however far away."""
    generator: str
    element_count: int
    warnings: tuple[str, ...]
    drawn: DrawList
    company: Company
    """By which the next scene is known, if only things have moved in it."""
    nbytes: int
    """What keeping it costs, about."""


class SceneStore:
    """Reads scenes and keeps the last ones. Thread-safe.

    Two stores in one: geometry by the content of its buffers (a robot that moves brings the same meshes with other
    poses), and whole scenes (a second camera, or the same view as depth and label).
    """

    def __init__(self, config: RenderConfig) -> None:
        self._config = config
        self._meshes = MeshCache(config.mesh_cache_bytes)
        self._scenes: Cache[str, PreparedScene] = Cache(config.scene_cache_bytes, config.scene_cache_count)
        self._companies = Companies()

    @property
    def hits(self) -> int:
        """Number of scenes found in the cache."""
        return self._scenes.hits

    @property
    def misses(self) -> int:
        """Number of scenes read."""
        return self._scenes.misses

    @property
    def nbytes(self) -> int:
        """Bytes of the scenes kept, about."""
        return self._scenes.nbytes

    @property
    def geometry(self) -> CacheStats:
        """Figures of the cache of buffers and meshes."""
        return self._meshes.stats

    def get(self, document: HashedDocument) -> PreparedScene:
        """Return the scene of a document, read if it is not known.

        Raises:
            GltfError: it cannot be read; nothing is kept then.
        """
        found = self._scenes.get(document.digest)
        if found is not None:
            return found
        gltf = read_gltf(document, limits=self._config.gltf, cache=self._meshes)
        listed, company = self._companies.drawn(gltf)
        eye = gltf.camera
        scene = PreparedScene(
            None if eye is None else Eye(eye.name, eye.X_world_camera, eye.znear),
            gltf.instance_count > 0,
            gltf.generator,
            gltf.element_count,
            gltf.warnings,
            listed,
            company,
            len(document.data) + company.mesh_bytes,
        )
        self._scenes.put(document.digest, scene, scene.nbytes)
        return scene
