"""Documents that differ from an earlier one in their materials, or what comes after: their buffers are known then.

Drake's client asks for colours, depths and labels of one scene, and its writer sorts the members of a document by name:
accessors, buffers and images come before the materials. Documents in another order are read as a whole. What stands
before the materials, the stem, is compared with the texts that came before, which takes a third of the time of decoding
it; everything made of it is taken over.

``prefixes`` keeps more (all but the nodes) of documents that came twice; a stem is kept from the first time on.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import msgspec

from gateway.scene.gltf import document as gltf
from gateway.scene.gltf.bytewise import equal_bytes
from gateway.scene.gltf.container import Container
from gateway.scene.gltf.limits import GltfLimits
from gateway.scene.gltf.prefixes import HEAD, MIN_LENGTH
from renderers.stop import check_stop

if TYPE_CHECKING:
    from gateway.scene.gltf.accessors import Accessors
    from gateway.scene.gltf.buffers import Buffers
    from gateway.scene.gltf.meshes import Meshes

_MEMBERS: Final = msgspec.json.Decoder(dict[str, msgspec.Raw])
_FIRST: Final = b'"materials"'
_SAME_HEAD: Final = 4
"""Stems with the same beginning that are kept: each one that does not match may cost a comparison."""
_GEOMETRY: Final = ("accessors", "bufferViews", "buffers")
"""Members that must come before the materials, since what is taken over was made of them."""
_TRIES: Final = 16
"""Places of ``"materials"`` that are tried; names can contain it, too."""
_PARSED: Final = 8
"""Bytes that parsed JSON takes for one of the text, about."""


@dataclass(slots=True, eq=False)
class Stem:
    """A document that was read, as far as others can share it."""

    text: bytes | memoryview
    """The whole document."""
    container: Container
    document: gltf.Document
    buffers: Buffers
    accessors: Accessors
    meshes: Meshes
    limits: GltfLimits
    nbytes: int
    """What keeping it costs, about."""
    length: int = -1
    """Bytes before the materials; 0: there is no such place, -1: it was not looked for yet."""
    json: bytes = b""
    """The same part of ``container.json``."""
    members: frozenset[str] = frozenset()
    """Of the document, in that part."""

    def prove(self) -> None:
        """Finds where the materials begin. That both halves are JSON objects proves that the place is between two
        members of the outermost object. Nothing is found where a name is in both, since the later one counted.

        Not done before another document comes that begins alike."""
        slim, tail = self.container.json, self.container.tail
        length = 0
        begin = at = len(slim) - (len(self.text) - (tail or 0))
        for _ in range(_TRIES if tail is not None else 0):
            at = slim.find(_FIRST, at)
            if at < 0:
                break
            check_stop()
            before = slim[:at].rstrip()
            if before.endswith(b","):
                try:
                    members = frozenset(_MEMBERS.decode(before[:-1] + b"}"))
                    others = _MEMBERS.decode(b"{" + slim[at:])
                except (msgspec.MsgspecError, ValueError, RecursionError):
                    pass
                else:
                    if members.isdisjoint(others) and not any(name in others for name in _GEOMETRY):
                        self.json, self.members, length = slim[:at], members, (tail or 0) + at - begin
                    break
            at += len(_FIRST)
        self.length = length if length >= MIN_LENGTH else 0


@dataclass(frozen=True, slots=True, eq=False)
class Grown:
    """A document that begins with a stem."""

    stem: Stem
    container: Container
    document: gltf.Document


class Stems:
    """The stems of the last documents. Thread-safe; bounded in bytes, least recently used goes first."""

    def __init__(self, max_bytes: int) -> None:
        self.max_bytes = max_bytes
        self._lock = threading.Lock()
        self._entries: OrderedDict[bytes, list[Stem]] = OrderedDict()
        self._nbytes = 0

    @property
    def nbytes(self) -> int:
        """Texts, and the arrays that they keep alive, about."""
        return self._nbytes

    def find(self, text: bytes | memoryview, limits: GltfLimits) -> Grown | None:
        """The document of ``text``, if it begins with a stem; its members from the materials on are read."""
        if not self._entries:
            return None
        view = memoryview(text)
        head = bytes(view[:HEAD])
        with self._lock:
            stems = list(self._entries.get(head, ()))
        for stem in stems:
            if stem.length < 0:
                stem.prove()
            length = stem.length
            if length == 0 or length >= len(view) or (stem.limits is not limits and stem.limits != limits):
                continue
            if not equal_bytes(memoryview(stem.text)[:length], view[:length]):
                continue
            grown = _grown(stem, bytes(view[length:]), limits)
            if grown is not None:
                with self._lock:
                    if head in self._entries:
                        self._entries.move_to_end(head)
                return grown
        return None

    def add(
        self,
        text: bytes | memoryview,
        container: Container,
        document: gltf.Document,
        read: tuple[Buffers, Accessors, Meshes],
        limits: GltfLimits,
    ) -> None:
        """Keeps ``text``, which must not change."""
        buffers, accessors, meshes = read
        if container.tail is None or len(text) < MIN_LENGTH or accessors.warned or document.materials is None:
            return
        nbytes = len(text) + _PARSED * len(container.json) + buffers.nbytes + meshes.nbytes
        # Of sums that come near the limits, a document that takes them over could count something twice.
        if nbytes > self.max_bytes or 2 * buffers.nbytes > limits.max_buffer_bytes:
            return
        head = bytes(memoryview(text)[:HEAD])
        with self._lock:
            stems = self._entries.setdefault(head, [])
            self._entries.move_to_end(head)
            stems.insert(0, Stem(text, container, document, buffers, accessors, meshes, limits, nbytes))
            self._nbytes += nbytes
            while len(stems) > _SAME_HEAD or (self._nbytes > self.max_bytes and len(self._entries) == 1):
                self._nbytes -= stems.pop().nbytes
            while self._nbytes > self.max_bytes:
                _, dropped = self._entries.popitem(last=False)
                self._nbytes -= sum(stem.nbytes for stem in dropped)

    def clear(self) -> None:
        """Forgets everything."""
        with self._lock:
            self._entries.clear()
            self._nbytes = 0


def _grown(stem: Stem, rest: bytes, limits: GltfLimits) -> Grown | None:
    """None when the document has to be read as a whole."""
    if len(stem.json) + len(rest) > min(limits.max_json_bytes, limits.max_json_values):
        return None
    try:
        document: Any = _REST.decode(b"{" + rest)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None
    for name, field in _FIELDS.items():
        absent = getattr(document, field) is msgspec.UNSET
        if name in stem.members or name in _GEOMETRY:
            if not absent:
                return None
            setattr(document, field, getattr(stem.document, field))
        elif absent:
            setattr(document, field, None)
    return Grown(
        stem, Container(stem.json + rest, stem.container.data, stem.container.uris, stem.length, None), document
    )


_FIELDS: Final = {field.encode_name: field.name for field in msgspec.structs.fields(gltf.Document)}
_REST: Final = msgspec.json.Decoder(
    msgspec.defstruct(
        "Rest",
        [
            (field.name, field.type | msgspec.UnsetType, msgspec.UNSET)
            for field in msgspec.structs.fields(gltf.Document)
        ],
        bases=(gltf.Document,),
        rename="camel",
        gc=False,
    )
)
"""Tells absent members from null."""
