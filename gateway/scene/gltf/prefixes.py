"""Documents that begin with the same text as an earlier one: everything but the nodes is known then.

Drake's client sends the whole scene with every picture, and its writer sorts the members of the document by name. While
a robot moves, the text up to the member ``nodes`` (accessors, buffers, materials, meshes: nearly all of it) stays the
same. Comparing it with what came before is five times faster than the fastest way to decode it.
"""

from __future__ import annotations

import hashlib
import re
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import count
from typing import TYPE_CHECKING, Any, Final

import msgspec
from isal import isal_zlib

from gateway.scene.geometry import Part, Surface
from gateway.scene.gltf import document as gltf
from gateway.scene.gltf.bytewise import common_length, equal_bytes
from gateway.scene.gltf.container import Container
from gateway.scene.gltf.limits import GltfLimits
from gateway.scene.gltf.scene import GltfCounts
from renderers.quick import quick
from renderers.stop import check_stop

if TYPE_CHECKING:
    from gateway.scene.gltf.arrivals import Text

MIN_LENGTH: Final = 4096
"""Bytes. Below, reading everything costs no more than comparing."""
HEAD: Final = 256
"""Bytes by which stored texts are looked up."""
_TAIL: Final = 1 << 16
"""Bytes that are compared first: colour, depth and label requests of a scene differ in their materials only, which come
after the megabytes of buffers."""
_SAME_HEAD: Final = 8
"""Texts with the same beginning that are kept: each one that does not match may cost a comparison."""
_CANDIDATES: Final = 256
"""Texts seen once that are remembered (by a hash): a text is worth keeping when it comes again."""
_NODES_AS_USUAL: Final = b'"nodes":[{'
_OBJECTS: Final = re.compile(rb"\s*:\s*\[\s*(\{|null)")
_TRIES: Final = 64
"""Places of ``"nodes"`` that are tried; scenes and names can contain it, too."""

_HASH_STEP: Final = 1 << 20
"""Bytes between the kept states of a text's hash: as many are hashed again at most."""

_uids = count(1)

_MEMBERS: Final = msgspec.json.Decoder(dict[str, msgspec.Raw])
_NODES: Final = msgspec.json.Decoder(list[gltf.Node | None] | None)
_SCENES: Final = msgspec.json.Decoder(list[gltf.Scene | None] | None)
_INDEX: Final = msgspec.json.Decoder(int | None)
_PER_REQUEST: Final = frozenset({"nodes", "scene", "scenes"})


@quick
@dataclass(frozen=True, slots=True, eq=False)
class Warned:
    """What a document was warned of, by what it is about."""

    extensions: tuple[str, ...] = ()
    lights: tuple[str, ...] = ()
    """Of the document, not of nodes."""
    meshes: tuple[str, ...] = ()
    """And of their materials."""
    order: tuple[int, ...] = ()
    """The meshes in the order of their first use: another one may give other warnings."""
    morphed: int = 0
    """Meshes with weights of their own."""


@quick
@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """What the text before the nodes, and the members after them, make."""

    parts: Mapping[int, tuple[Part, ...]]
    """By mesh; only of meshes that were in use."""
    generator: str
    cameras: list[gltf.Camera | None]
    warned: Warned
    counts: GltfCounts
    lights: tuple[gltf.Light | None, ...]
    elements: dict[int, int]
    """Triangles, lines and points of each mesh's parts."""


@dataclass(frozen=True, slots=True, eq=False)
class KeptText:
    """The text before the nodes of a document that came more than once."""

    text: bytes
    fixed: dict[str, bytes]
    """Members after the nodes, other than nodes and scenes."""
    options: tuple[GltfLimits, bool]
    known: Known
    nbytes: int
    hashes: tuple[Any, ...]
    """SHA-256 of its first 0, ``_HASH_STEP``, ... bytes, and of all; never fed, only copied."""
    shared: dict[int, int]
    """By ``uid`` of others with the same head that were kept before: how many bytes they have in common."""
    uid: int = field(default_factory=lambda: next(_uids))

    def hash_until(self, length: int) -> Any:
        """SHA-256 of the first ``length`` bytes, to be fed with what follows."""
        if length == len(self.text):
            return self.hashes[-1].copy()
        step = length // _HASH_STEP
        hashed = self.hashes[step].copy()
        hashed.update(memoryview(self.text)[step * _HASH_STEP : length])
        return hashed

    def common(self, other: KeptText) -> int:
        """How many bytes it has in common with another one with the same head, at least."""
        return self.shared.get(other.uid) or other.shared.get(self.uid, 0)


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """Where a document's nodes begin."""

    length: int
    """Bytes of the text before."""
    fixed: dict[str, bytes]


def stable_part(container: Container, total: int) -> bytes | None:
    """The text before the nodes without its data URIs, found by a look at what follows: nodes are objects, other
    members of that name are numbers. Nothing is proved.

    Args:
        total: bytes of the document.
    """
    if container.tail is None or total < MIN_LENGTH:
        return None
    slim = container.json
    begin = len(slim) - (total - container.tail)
    at = slim.rfind(_NODES_AS_USUAL, begin)
    if at >= 0:
        return slim[:at]
    at = len(slim)
    for _ in range(_TRIES):
        at = slim.rfind(b'"nodes"', begin, at)
        if at < 0:
            return None
        if _OBJECTS.match(slim, at + len(b'"nodes"')):
            return slim[:at]
    return None


def split(container: Container, total: int) -> Split | None:
    """Where the member ``nodes`` begins; None when data URIs follow it, when scenes come before it, or in a ``.glb``.

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
        check_stop()
        before = slim[:at].rstrip()
        if not before.endswith(b","):
            continue
        try:
            members = _MEMBERS.decode(b"{" + slim[at:])
            stable = _MEMBERS.decode(before[:-1] + b"}")
        except (msgspec.MsgspecError, ValueError, RecursionError):
            continue
        if not _PER_REQUEST.isdisjoint(stable):
            return None
        length = total - (len(slim) - at)
        return Split(length, _fixed(members)) if length >= MIN_LENGTH else None
    return None


def _fixed(members: dict[str, msgspec.Raw]) -> dict[str, bytes]:
    return {name: bytes(value) for name, value in members.items() if name not in _PER_REQUEST}


class Prefixes:
    """Texts before the nodes with what they make. Thread-safe; bounded in bytes, least recently used goes first."""

    def __init__(self, max_bytes: int) -> None:
        self.max_bytes = max_bytes
        self.hits = 0
        self._lock = threading.Lock()
        self._entries: OrderedDict[bytes, list[KeptText]] = OrderedDict()
        self._candidates: OrderedDict[int, None] = OrderedDict()
        self._nbytes = 0

    @property
    def nbytes(self) -> int:
        """Texts, and the arrays that they keep alive."""
        return self._nbytes

    def beginning_with(self, head: bytes) -> list[KeptText]:
        """The texts whose first ``HEAD`` bytes are these, the last used first."""
        with self._lock:
            return list(self._entries.get(head, ()))

    def find(self, text: Text, limits: GltfLimits, textures: bool) -> tuple[Known, gltf.Document] | None:
        """What is known of a document, and the members of it that are not: nodes and scenes."""
        if text.known is not None:  # it was compared while it arrived
            found = self._with(text.known, bytes(text.rest), limits, textures)
            if found is not None:
                return found
        if not self._entries:
            return None
        view = memoryview(text.whole())
        for entry in self.beginning_with(bytes(view[:HEAD])):
            kept, length = entry.text, len(entry.text)
            if kept[-_TAIL:] != bytes(view[max(0, length - _TAIL) : length]) or not equal_bytes(kept, view[:length]):
                continue
            found = self._with(entry, bytes(view[length:]), limits, textures)
            if found is not None:
                return found
        return None

    def _with(
        self, entry: KeptText, rest: bytes, limits: GltfLimits, textures: bool
    ) -> tuple[Known, gltf.Document] | None:
        """Of a document that begins with a kept text."""
        if entry.options != (limits, textures):
            return None
        document = _rest(rest, entry.fixed, limits)
        if document is None:
            return None
        head = entry.text[:HEAD]
        with self._lock:
            self.hits += 1
            same = self._entries.get(head, [])
            if entry in same:
                self._entries.move_to_end(head)
                same.remove(entry)
                same.insert(0, entry)
        document.cameras = entry.known.cameras
        return entry.known, document

    def is_repeated(self, stable: bytes, buffers: tuple[int, ...]) -> bool:
        """Whether a text with this part and these buffers was asked for before; every second time, so that of many
        threads only one adds it."""
        key = hash((len(stable), isal_zlib.crc32(stable), buffers))
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
        text = bytes(view[: where.length])
        head = text[:HEAD]
        shared = {other.uid: common_length(text, other.text) for other in self.beginning_with(head)}
        entry = KeptText(text, where.fixed, (limits, textures), known, nbytes, _hashes(text), shared)
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


def _hashes(text: bytes) -> tuple[Any, ...]:
    hashed = hashlib.sha256()
    states = []
    for begin in range(0, len(text), _HASH_STEP):
        states.append(hashed.copy())
        hashed.update(memoryview(text)[begin : begin + _HASH_STEP])
    return (*states, hashed)


def _rest(text: bytes, fixed: dict[str, bytes], limits: GltfLimits) -> gltf.Document | None:
    """Nodes and scenes of the text from ``nodes`` on; None when it has to be read as a whole."""
    if len(text) > limits.max_json_bytes:
        return None
    if gltf.count_values(text, limits) > limits.max_json_values:
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
