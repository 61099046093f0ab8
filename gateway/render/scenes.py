"""Scenes by the hash of their bytes: what was read before is not read again."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.render.config import RenderConfig
from gateway.render.drawn import Companies, Company
from gateway.scene.gltf import Arrival, CacheStats, MeshCache, Text, read_gltf
from renderers.drawlist import DrawList
from renderers.quick import quick


@quick
@dataclass(frozen=True, slots=True, eq=False)
class Eye:
    """What matters of a scene's camera: pictures are asked for with lenses of their own."""

    name: str
    X_world_camera: NDArray[np.float64]
    """As of ``GltfCamera``."""
    znear: float
    """As of ``GltfCamera``."""


@quick
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
        self._lock = threading.Lock()
        self._kept: OrderedDict[str, PreparedScene] = OrderedDict()
        self._companies = Companies()
        self._nbytes = 0
        self.hits = 0
        """Scenes that were found."""
        self.misses = 0
        """Scenes that were read."""

    @property
    def nbytes(self) -> int:
        """Of the scenes that are kept, about."""
        return self._nbytes

    @property
    def geometry(self) -> CacheStats:
        """Of the geometry by the content of its buffers."""
        return self._meshes.stats

    def arrival(self) -> Arrival:
        """What the next scene is fed to while it arrives."""
        return Arrival(self._meshes.prefixes)

    def get(self, sha256: str, data: Text) -> PreparedScene:
        """The scene with these bytes.

        Raises:
            GltfError: it cannot be read; nothing is kept then.
        """
        with self._lock:
            found = self._kept.get(sha256)
            if found is not None:
                self._kept.move_to_end(sha256)
                self.hits += 1
                return found
        gltf = read_gltf(data, limits=self._config.gltf, cache=self._meshes)
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
            len(data) + company.mesh_bytes,
        )
        with self._lock:
            self.misses += 1
            self._keep(sha256, scene)
        return scene

    def _keep(self, sha256: str, scene: PreparedScene) -> None:
        config = self._config
        if scene.nbytes > config.scene_cache_bytes or sha256 in self._kept:
            return
        self._kept[sha256] = scene
        self._nbytes += scene.nbytes
        while self._nbytes > config.scene_cache_bytes or len(self._kept) > config.scene_cache_count:
            _, oldest = self._kept.popitem(last=False)
            self._nbytes -= oldest.nbytes
