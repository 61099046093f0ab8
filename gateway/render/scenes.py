"""Scenes by the hash of their bytes: what was read before is not read again."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass

from gateway.render.config import RenderConfig
from gateway.render.drawn import drawn
from gateway.scene.gltf import Arrival, CacheStats, GltfScene, MeshCache, Text, read_gltf
from renderers.drawlist import DrawList, Mesh


@dataclass(frozen=True, slots=True, eq=False)
class PreparedScene:
    """A scene, read and flattened; shared by all pictures of it."""

    gltf: GltfScene
    drawn: DrawList
    meshes: tuple[Mesh, ...]
    """Of each instance."""
    mesh_bytes: int
    """Of these meshes."""
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
        self._last: PreparedScene | None = None
        """The one that was kept last, while it is."""
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
        listed = drawn(gltf)
        meshes = tuple([instance.mesh for instance in listed.instances])
        last = self._last
        if last is not None and last.meshes == meshes:  # by identity: nearly always, while a robot moves
            mesh_bytes = last.mesh_bytes
        else:
            mesh_bytes = sum(mesh.nbytes for mesh in {id(mesh): mesh for mesh in meshes}.values())
        scene = PreparedScene(gltf, listed, meshes, mesh_bytes, len(data) + mesh_bytes)
        with self._lock:
            self.misses += 1
            self._keep(sha256, scene)
        return scene

    def _keep(self, sha256: str, scene: PreparedScene) -> None:
        config = self._config
        if scene.nbytes > config.scene_cache_bytes or sha256 in self._kept:
            return
        self._kept[sha256] = self._last = scene
        self._nbytes += scene.nbytes
        while self._nbytes > config.scene_cache_bytes or len(self._kept) > config.scene_cache_count:
            _, oldest = self._kept.popitem(last=False)
            self._nbytes -= oldest.nbytes
            if oldest is self._last:
                self._last = None
