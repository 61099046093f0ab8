"""Documents that begin with the same text as an earlier one: everything but the nodes is known then.

Drake's client sends the whole scene with every picture, and its writer sorts the members of the document by name. While
a robot moves, the text up to the member ``nodes`` (accessors, buffers, materials, meshes: nearly all of it) stays the
same. Comparing it with what came before is five times faster than the fastest way to decode it.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import msgspec

from gateway.scene.geometry import Part, Surface
from gateway.scene.gltf import document as gltf
from gateway.scene.gltf.bytewise import equal_bytes
from gateway.scene.gltf.container import Container
from gateway.scene.gltf.limits import GltfLimits
from gateway.scene.gltf.scene import GltfCounts

MIN_LENGTH: Final = 4096
"""Bytes. Below, reading everything costs no more than comparing."""
_HEAD: Final = 256
"""Bytes by which stored texts are looked up."""
_TAIL: Final = 1 << 16
"""Bytes that are compared first: colour, depth and label requests of a scene differ in their materials only, which come
after the megabytes of buffers."""
_SAME_HEAD: Final = 8
"""Texts with the same beginning that are kept: each one that does not match may cost a comparison."""
_CANDIDATES: Final = 256
"""Texts seen once that are remembered (by a hash): a text is worth keeping when it comes again."""
_TRIES: Final = 64
"""Places of ``"nodes"`` that are tried; scenes and names can contain it, too."""

_MEMBERS: Final = msgspec.json.Decoder(dict[str, msgspec.Raw])
_NODES: Final = msgspec.json.Decoder(list[gltf.Node | None] | None)
_SCENES: Final = msgspec.json.Decoder(list[gltf.Scene | None] | None)
_INDEX: Final = msgspec.json.Decoder(int | None)
_PER_REQUEST: Final = frozenset({"nodes", "scene", "scenes"})


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """What the text before the nodes, and the members after them, make."""

    parts: Mapping[int, tuple[Part, ...]]
    """By mesh; only of meshes that were in use."""
    generator: str
    cameras: list[gltf.Camera | None]
    warnings: tuple[str, ...]
    counts: GltfCounts
    lights: tuple[gltf.Light | None, ...]
    elements: dict[int, int] = field(default_factory=dict)
    """Triangles, lines and points of each mesh's parts; filled while they are counted."""


@dataclass(frozen=True, slots=True, eq=False)
class _Entry:
    text: bytes
    fixed: dict[str, bytes]
    """Members after the nodes, other than nodes and scenes."""
    options: tuple[GltfLimits, bool]
    known: Known
    nbytes: int


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """Where a document's nodes begin."""

    length: int
    """Bytes of the text before."""
    slim: bytes
    """That text without its data URIs."""
    fixed: dict[str, bytes]


def split(container: Container, total: int) -> Split | None:
    """Where the member ``nodes`` begins; None when data URIs follow it, or in a ``.glb``.

    That both halves are JSON objects proves that the place is between two members of the outermost object.
    """
    if container.tail is None:
        return None
    slim = container.json
    begin = len(slim) - (total - container.tail)
    at = len(slim)
    for _ in range(_TRIES):
        at = slim.rfind(b'"nodes"', begin, at)
        if at < 0:
            return None
        before = slim[:at].rstrip()
        if not before.endswith(b","):
            continue
        try:
            members = _MEMBERS.decode(b"{" + slim[at:])
            _MEMBERS.decode(before[:-1] + b"}")
        except (msgspec.MsgspecError, ValueError, RecursionError):
            continue
        length = total - (len(slim) - at)
        return Split(length, before, _fixed(members)) if length >= MIN_LENGTH else None
    return None


def _fixed(members: dict[str, msgspec.Raw]) -> dict[str, bytes]:
    return {name: bytes(value) for name, value in members.items() if name not in _PER_REQUEST}


class Prefixes:
    """Texts before the nodes with what they make. Thread-safe; bounded in bytes, least recently used goes first."""

    def __init__(self, max_bytes: int) -> None:
        self.max_bytes = max_bytes
        self.hits = 0
        self._lock = threading.Lock()
        self._entries: OrderedDict[bytes, list[_Entry]] = OrderedDict()
        self._candidates: OrderedDict[int, None] = OrderedDict()
        self._nbytes = 0

    @property
    def nbytes(self) -> int:
        """Texts, and the arrays that they keep alive."""
        return self._nbytes

    def find(self, view: memoryview, limits: GltfLimits, textures: bool) -> tuple[Known, gltf.Document] | None:
        """What is known of a document, and the members of it that are not: nodes and scenes."""
        head = bytes(view[:_HEAD])
        with self._lock:
            entries = tuple(self._entries.get(head, ()))
        for entry in entries:
            text, length = entry.text, len(entry.text)
            if entry.options != (limits, textures) or length >= len(view):
                continue
            if text[-_TAIL:] != bytes(view[max(0, length - _TAIL) : length]) or not equal_bytes(text, view[:length]):
                continue
            rest = _rest(bytes(view[length:]), entry.fixed, limits)
            if rest is None:
                continue
            with self._lock:
                self.hits += 1
                same = self._entries.get(head, [])
                if entry in same:
                    self._entries.move_to_end(head)
                    same.remove(entry)
                    same.insert(0, entry)
            rest.cameras = entry.known.cameras
            return entry.known, rest
        return None

    def is_repeated(self, where: Split, buffers: tuple[int, ...]) -> bool:
        """Whether a text with this part and these buffers was asked for before; every second time, so that of many
        threads only one adds it."""
        key = hash((where.slim, buffers))
        with self._lock:
            if key in self._candidates:
                del self._candidates[key]
                return True
            self._candidates[key] = None
            if len(self._candidates) > _CANDIDATES:
                self._candidates.popitem(last=False)
        return False

    def add(self, view: memoryview, where: Split, limits: GltfLimits, textures: bool, known: Known) -> None:
        """Keeps the text before the nodes; it is copied."""
        meshes = {id(p.shape): p.shape.mesh for ps in known.parts.values() for p in ps if isinstance(p.shape, Surface)}
        nbytes = 2 * where.length + sum(mesh.nbytes for mesh in {id(m): m for m in meshes.values()}.values())
        if nbytes > self.max_bytes:
            return
        entry = _Entry(bytes(view[: where.length]), where.fixed, (limits, textures), known, nbytes)
        head = bytes(view[:_HEAD])
        with self._lock:
            entries = self._entries.setdefault(head, [])
            self._entries.move_to_end(head)
            entries.insert(0, entry)
            self._nbytes += nbytes
            while len(entries) > _SAME_HEAD or (self._nbytes > self.max_bytes and len(self._entries) == 1):
                self._nbytes -= entries.pop().nbytes
            while self._nbytes > self.max_bytes:
                _, dropped = self._entries.popitem(last=False)
                self._nbytes -= sum(e.nbytes for e in dropped)

    def clear(self) -> None:
        """Forgets everything."""
        with self._lock:
            self._entries.clear()
            self._candidates.clear()
            self._nbytes = 0


def _rest(text: bytes, fixed: dict[str, bytes], limits: GltfLimits) -> gltf.Document | None:
    """Nodes and scenes of the text from ``nodes`` on; None when it has to be read as a whole."""
    if len(text) > limits.max_json_bytes:
        return None
    if text.count(b",") + text.count(b"{") + text.count(b"[") > limits.max_json_values:
        return None
    try:
        members = _MEMBERS.decode(b"{" + text)
        if _fixed(members) != fixed:
            return None
        return gltf.Document(
            nodes=_NODES.decode(members["nodes"]) if "nodes" in members else None,
            scenes=_SCENES.decode(members["scenes"]) if "scenes" in members else None,
            scene=_INDEX.decode(members["scene"]) if "scene" in members else None,
        )
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None
