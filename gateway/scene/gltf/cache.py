"""Equal bytes become equal objects: buffers and the meshes made of them, within and across documents."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass, field
from itertools import count
from typing import Final, TypeAlias

import numpy as np
from isal import isal_zlib

from gateway.scene.gltf.bytewise import equal_bytes
from gateway.scene.gltf.prefixes import Prefixes
from renderers.drawlist import Image, Mesh

MeshKey: TypeAlias = tuple[object, ...]
"""What a mesh is made of: ``Buffer.uid`` and the layout of every accessor."""

_uids = count(1)


class Buffer:
    """Immutable bytes with an identity: the cache gives equal bytes the same object."""

    __slots__ = ("data", "images", "uid")

    def __init__(self, data: bytes) -> None:
        self.data: Final = data
        self.uid: Final = next(_uids)
        self.images: Final[dict[tuple[int, int], Image]] = {}
        """Images that were made of (offset, length) of it."""


@dataclass(frozen=True, slots=True)
class CacheStats:
    """For metrics."""

    nbytes: int
    text_bytes: int
    buffers: int
    meshes: int
    document_hits: int
    """Documents of which only the nodes had to be read."""
    buffer_hits: int
    buffer_misses: int
    mesh_hits: int
    mesh_misses: int


@dataclass(slots=True, eq=False)
class _Entry:
    buffer: Buffer
    meshes: set[MeshKey] = field(default_factory=set)


@dataclass(frozen=True, slots=True, eq=False)
class _Kept:
    mesh: Mesh
    nbytes: int
    buffers: tuple[int, ...]


class MeshCache:
    """Buffers of the last documents, and the meshes made of them; least recently used goes first. Thread-safe.

    A buffer is found by a checksum and then *compared*, so that no collision, made or accidental, can exchange
    contents. The checksum and the comparison together cost a quarter of a cryptographic hash.
    """

    def __init__(self, max_bytes: int = 512 << 20, max_text_bytes: int | None = None) -> None:
        """The default holds some ten scenes of 25 MB each.

        Args:
            max_bytes: of everything that is kept.
            max_text_bytes: the share of texts that are kept to recognise repeated documents, with the arrays that they
                keep alive; None: half. The rest is for buffers and meshes.
        """
        text_bytes = max_bytes // 2 if max_text_bytes is None else max_text_bytes
        self.max_bytes = max_bytes - text_bytes
        """Of buffers and meshes."""
        self.prefixes: Final = Prefixes(text_bytes)
        self._lock = threading.Lock()
        self._entries: OrderedDict[tuple[int, int], _Entry] = OrderedDict()
        self._by_uid: dict[int, _Entry] = {}
        self._meshes: dict[MeshKey, _Kept] = {}
        self._nbytes = 0
        self._buffer_hits = self._buffer_misses = self._mesh_hits = self._mesh_misses = 0

    def buffer(self, data: bytes | memoryview, held: dict[tuple[int, int], Buffer] | None = None) -> Buffer:
        """The buffer with these bytes; a memoryview is copied when they are new.

        Args:
            held: buffers that the caller keeps anyway, found first and added to: equal bytes of one document are one
                buffer even when the cache is too small for them.
        """
        key = (len(data), isal_zlib.crc32(data))
        if held is not None:
            known = held.get(key)
            if known is not None and equal_bytes(known.data, data):
                return known
            buffer = held[key] = self._buffer(key, data)
            return buffer
        return self._buffer(key, data)

    def _buffer(self, key: tuple[int, int], data: bytes | memoryview) -> Buffer:
        with self._lock:
            entry = self._entries.get(key)
        if entry is not None and equal_bytes(entry.buffer.data, data):
            with self._lock:
                self._buffer_hits += 1
                if key in self._entries:
                    self._entries.move_to_end(key)
            return entry.buffer
        buffer = Buffer(data if isinstance(data, bytes) else bytes(data))
        with self._lock:
            self._buffer_misses += 1
            other = self._entries.get(key)
            if other is not None and other is not entry and other.buffer.data == buffer.data:
                return other.buffer  # another thread was faster
            if other is not None:
                self._drop(key)
            self._entries[key] = self._by_uid[buffer.uid] = _Entry(buffer)
            self._nbytes += len(data)
            self._shrink()
        return buffer

    def mesh(self, key: MeshKey) -> Mesh | None:
        """The mesh that was kept for ``key``."""
        with self._lock:
            kept = self._meshes.get(key)
            self._mesh_hits += kept is not None
            self._mesh_misses += kept is None
        return kept.mesh if kept is not None else None

    def add_mesh(self, key: MeshKey, mesh: Mesh, buffers: list[Buffer]) -> Mesh:
        """Keeps ``mesh`` as long as all ``buffers`` it was made of are kept; returns what is kept for ``key``."""
        own = mesh_bytes(mesh, buffers)
        with self._lock:
            known = self._meshes.get(key)
            if known is not None:
                return known.mesh
            entries = [entry for b in buffers if (entry := self._by_uid.get(b.uid)) is not None]
            if entries and len(entries) == len(buffers):
                for entry in entries:
                    entry.meshes.add(key)
                self._meshes[key] = _Kept(mesh, own, tuple(b.uid for b in buffers))
                self._nbytes += own
                self._shrink()
        return mesh

    def clear(self) -> None:
        """Forgets everything."""
        with self._lock:
            self._entries.clear()
            self._by_uid.clear()
            self._meshes.clear()
            self._nbytes = 0
        self.prefixes.clear()

    @property
    def stats(self) -> CacheStats:
        with self._lock:
            return CacheStats(
                nbytes=self._nbytes,
                text_bytes=self.prefixes.nbytes,
                buffers=len(self._entries),
                meshes=len(self._meshes),
                document_hits=self.prefixes.hits,
                buffer_hits=self._buffer_hits,
                buffer_misses=self._buffer_misses,
                mesh_hits=self._mesh_hits,
                mesh_misses=self._mesh_misses,
            )

    def _shrink(self) -> None:
        while self._nbytes > self.max_bytes and self._entries:
            self._drop(next(iter(self._entries)))

    def _drop(self, key: tuple[int, int]) -> None:
        entry = self._entries.pop(key)
        del self._by_uid[entry.buffer.uid]
        self._nbytes -= len(entry.buffer.data)
        for mesh_key in entry.meshes:
            kept = self._meshes.pop(mesh_key)
            self._nbytes -= kept.nbytes
            for uid in kept.buffers:
                if (other := self._by_uid.get(uid)) is not None:
                    other.meshes.discard(mesh_key)


def mesh_bytes(mesh: Mesh, buffers: list[Buffer]) -> int:
    """Bytes of the mesh's arrays that are not views of ``buffers``."""
    views = {id(buffer.data) for buffer in buffers}
    total = 0
    for array in (mesh.positions, mesh.elements, mesh.normals, mesh.uv0, mesh.uv1, mesh.colors, mesh.tangents):
        if array is not None:
            owner: object = array.base
            while isinstance(owner, np.ndarray):
                owner = owner.base
            if owner is None or id(owner) not in views:
                total += array.nbytes
    return total
