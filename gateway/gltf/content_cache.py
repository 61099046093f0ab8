"""Equal bytes become equal objects: buffers and the meshes made of them, within and across documents."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Final, TypeAlias

import msgspec
import numpy as np

from gateway.gltf.compare import address_of_bytes, equal_bytes
from gateway.gltf.document_cache import DocumentCache
from renderers.contents import quick_key, whole_key
from renderers.drawlist import Image, Mesh

MeshKey: TypeAlias = bytes | tuple[object, ...]
"""What a mesh is made of: ``Buffer.uid`` and the layout of every accessor."""

ContentKey: TypeAlias = int
"""``quick_key`` or, of contents that are different and have the same one, ``whole_key``."""

_uids = count(1)
_SMALL: Final = 1 << 10
"""Bytes up to which contents are compared while others wait for the lock: letting them have it takes longer."""


class Buffer(msgspec.Struct, frozen=True, gc=False, eq=False):
    """Immutable bytes with an identity: the cache gives equal bytes the same object."""

    data: bytes | memoryview
    """A memoryview is of a ``bytes`` object, nine tenths of it or more."""
    address: int
    """Where they begin; for the buffer's lifetime."""
    uid: int = msgspec.field(default_factory=_uids.__next__)
    images: dict[tuple[int, int, int], Image] = msgspec.field(default_factory=dict)
    """Images that were made of (offset, length) of it, with their bound of pixels behind these."""


@dataclass(frozen=True, slots=True)
class CacheStats:
    """For metrics."""

    nbytes: int
    document_bytes: int
    buffers: int
    meshes: int
    document_hits: int
    """Documents of which only the nodes had to be read."""
    buffer_hits: int
    buffer_misses: int
    mesh_hits: int
    mesh_misses: int


class _Kept(msgspec.Struct, frozen=True, gc=False, eq=False):
    key: MeshKey
    mesh: Mesh
    nbytes: int
    buffers: Sequence[Buffer]


class MeshCache:
    """Buffers of the last documents, and the meshes made of them; least recently used goes first. Thread-safe.

    A buffer is found by a checksum of some of its bytes and then *compared*, so that no collision, made or accidental,
    can exchange contents.
    """

    def __init__(self, max_bytes: int = 512 << 20, max_document_bytes: int | None = None) -> None:
        """The default holds some ten scenes of 25 MB each.

        Args:
            max_bytes: of everything that is kept.
            max_document_bytes: share of the arrays that known documents keep alive; None: half. The rest is for buffers
                and meshes.
        """
        document_bytes = max_bytes // 2 if max_document_bytes is None else max_document_bytes
        self.max_bytes = max_bytes - document_bytes
        """Of buffers and meshes."""
        self.documents: Final = DocumentCache(document_bytes)
        self._lock = threading.Lock()
        self._entries: OrderedDict[ContentKey, Buffer] = OrderedDict()
        self._made_of: dict[int, dict[int, _Kept]] | None = None
        """By ``Buffer.uid`` of all that are kept; their meshes by identity. None: none had to go yet, so that nobody
        has one that is not kept, and whose meshes go with it has not been of interest."""
        self._meshes: dict[MeshKey, _Kept] = {}
        self._nbytes = 0
        self._buffer_hits = self._buffer_misses = self._mesh_hits = self._mesh_misses = 0

    def buffer(self, data: bytes | memoryview, held: dict[ContentKey, Buffer] | None = None) -> Buffer:
        """The buffer with these bytes; a memoryview is copied when they are new, but for most of a ``bytes`` object.

        Args:
            held: buffers that the caller keeps anyway, found first and added to: equal bytes of one document are one
                buffer even when the cache is too small for them.
        """
        return self._buffer(quick_key(data), data, {} if held is None else held)

    def _buffer(self, key: ContentKey, data: bytes | memoryview, held: dict[ContentKey, Buffer]) -> Buffer:
        at, known = key, held.get(key)
        if known is not None and not equal_bytes(known.data, data):
            at = whole_key(data)
            known = held.get(at)
            if known is not None and not equal_bytes(known.data, data):
                known = None
        if known is None:
            known = held[at] = self._kept_or_new(key, data)
        return known

    def buffers(self, contents: Sequence[tuple[bytes, ContentKey]], held: dict[ContentKey, Buffer]) -> list[Buffer]:
        """``buffer`` of each, whose ``quick_key`` is given."""
        entries = self._entries
        found: list[Buffer | None] = []
        new: list[Buffer] = []
        nbytes, others = 0, False
        with self._lock:
            for data, key in contents:
                known = held.get(key)
                if known is not None and len(data) <= _SMALL and known.data == data:
                    found.append(known)
                elif known is not None or key in entries:
                    found.append(None)
                    others = True
                else:
                    held[key] = entries[key] = buffer = Buffer(data, address_of_bytes(data))
                    nbytes += len(data)
                    new.append(buffer)
                    found.append(buffer)
            self._added(new, nbytes)
        if others:
            found = [
                self._buffer(key, data, held) if buffer is None else buffer
                for (data, key), buffer in zip(contents, found, strict=True)
            ]
        return found  # type: ignore[return-value]  # none is None

    def _added(self, buffers: Sequence[Buffer], nbytes: int) -> None:
        """These are entries now."""
        self._buffer_misses += len(buffers)
        self._nbytes += nbytes
        if self._made_of is not None:
            self._made_of.update((buffer.uid, {}) for buffer in buffers)
        if self._nbytes > self.max_bytes:
            self._shrink()

    def _kept_or_new(self, key: ContentKey, data: bytes | memoryview) -> Buffer:
        buffer: Buffer | None = None
        while True:
            with self._lock:
                entry = self._entries.get(key)
                if entry is None and buffer is not None:
                    self._entries[key] = buffer
                    self._added((buffer,), len(buffer.data))
                    return buffer
            if entry is not None:
                same = equal_bytes(entry.data, data)
                if not same and key >= 0:
                    key = whole_key(data)
                    continue
                with self._lock:
                    self._buffer_hits += same
                    if self._entries.get(key) is entry:
                        if same:
                            self._entries.move_to_end(key)
                        else:
                            self._drop(key)
                if same:
                    return entry
            if buffer is None:
                buffer = _buffer_of(data)  # not while others wait

    def meshes(self, keys: Iterable[MeshKey]) -> dict[MeshKey, Mesh]:
        """Those meshes of ``keys`` that were kept."""
        found: dict[MeshKey, Mesh] = {}
        with self._lock:
            for key in keys:
                kept = self._meshes.get(key)
                if kept is None:
                    self._mesh_misses += 1
                else:
                    self._mesh_hits += 1
                    found[key] = kept.mesh
        return found

    def add_meshes(self, made: Iterable[tuple[MeshKey, Mesh, Sequence[Buffer], int]]) -> dict[MeshKey, Mesh]:
        """Keeps meshes as long as all buffers they were made of are kept; returns what is kept for their keys, or they.

        Args:
            made: key, mesh, the buffers, and the bytes of its arrays that are not views of these.
        """
        result: dict[MeshKey, Mesh] = {}
        meshes = self._meshes
        with self._lock:
            for key, mesh, buffers, own in made:
                known = meshes.get(key)
                if known is not None:
                    result[key] = known.mesh
                    continue
                result[key] = mesh
                made_of = self._made_of
                if buffers and (made_of is None or all(buffer.uid in made_of for buffer in buffers)):
                    meshes[key] = new = _Kept(key, mesh, own, buffers)
                    if made_of is not None:
                        _note(made_of, new)
                    self._nbytes += own
                    if self._nbytes > self.max_bytes:
                        self._shrink()
        return result

    def clear(self) -> None:
        """Forgets everything."""
        with self._lock:
            self._entries.clear()
            self._made_of = {}
            self._meshes.clear()
            self._nbytes = 0
        self.documents.clear()

    @property
    def stats(self) -> CacheStats:
        with self._lock:
            return CacheStats(
                nbytes=self._nbytes,
                document_bytes=self.documents.nbytes,
                buffers=len(self._entries),
                meshes=len(self._meshes),
                document_hits=self.documents.hits,
                buffer_hits=self._buffer_hits,
                buffer_misses=self._buffer_misses,
                mesh_hits=self._mesh_hits,
                mesh_misses=self._mesh_misses,
            )

    def _shrink(self) -> None:
        while self._nbytes > self.max_bytes and self._entries:
            self._drop(next(iter(self._entries)))

    def _drop(self, key: ContentKey) -> None:
        if self._made_of is None:
            self._made_of = {buffer.uid: {} for buffer in self._entries.values()}
            for kept in self._meshes.values():
                _note(self._made_of, kept)
        made_of = self._made_of
        dropped = self._entries.pop(key)
        self._nbytes -= len(dropped.data)
        for identity, kept in made_of.pop(dropped.uid).items():
            del self._meshes[kept.key]
            self._nbytes -= kept.nbytes
            for buffer in kept.buffers:
                if (others := made_of.get(buffer.uid)) is not None:
                    others.pop(identity, None)


def _note(made_of: dict[int, dict[int, _Kept]], kept: _Kept) -> None:
    """That a mesh goes with its buffers."""
    identity = id(kept)
    for buffer in kept.buffers:
        made_of[buffer.uid][identity] = kept


def _buffer_of(view: bytes | memoryview) -> Buffer:
    """The bytes of a file are kept themselves, if nine tenths of them are meant, since only these are counted, and
    numbers lie in them as machines want it; others are copied."""
    if isinstance(view, bytes):
        return Buffer(view, address_of_bytes(view))
    owner = view.obj
    if isinstance(owner, bytes) and view.contiguous and 10 * view.nbytes >= 9 * len(owner):
        address: int = np.frombuffer(view, np.uint8).__array_interface__["data"][0]
        if address % 4 == 0:
            return Buffer(view, address)
    data = bytes(view)
    return Buffer(data, address_of_bytes(data))


def mesh_bytes(mesh: Mesh, buffers: Iterable[Buffer]) -> int:
    """Bytes of the mesh's arrays that are not views of ``buffers``."""
    # NumPy's arrays of a memoryview say that their base is what that is of.
    views = {id(b.data.obj if isinstance(b.data, memoryview) else b.data) for b in buffers}
    total = 0
    for array in (mesh.positions, mesh.elements, mesh.normals, mesh.uv0, mesh.uv1, mesh.colors, mesh.tangents):
        if array is not None:
            owner: object = array.base
            while isinstance(owner, np.ndarray):
                owner = owner.base
            if owner is None or id(owner) not in views:
                total += array.nbytes
    return total
