"""Caches of the reader: meshes and images, and everything in a document but its nodes.

Drake's client sends the whole scene with every image, with the members of the JSON document sorted by name. While a
robot moves, the text before the member ``nodes`` (accessors, buffers, materials, meshes: nearly the whole document)
stays the same. A document whose text before the nodes is known is neither hashed nor parsed there again: comparing the
text takes a fortieth of the time of hashing it.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final, TypeAlias

import msgspec
from isal import isal_zlib

from gateway.files.gltf import schema
from gateway.files.gltf.container import Container
from gateway.files.gltf.gltf_errors import GltfLimits
from gateway.files.gltf.parser import count_values
from gateway.scene.tree.geometry import Part
from renderers.cache import SHARED, Cache, CacheBudget
from renderers.drawlist import Image, Mesh

MIN_BYTES: Final = 4096
"""Minimum size of the text before the nodes. A shorter text is parsed as fast as it is found again."""
_NODES: Final = b'"nodes"'
_DATA_URI: Final = b'"data:'
_LIST_OF_OBJECTS: Final = re.compile(rb"\s*:\s*\[\s*(\{|null)")
"""Start of the value of the document's member ``nodes``. The ``nodes`` of a scene are a list of numbers instead."""
_MAX_CANDIDATES: Final = 64
"""Maximum number of occurrences of ``"nodes"`` that are tried, last one first: scenes and extras may have some."""
_CHANGING_MEMBERS: Final = frozenset({"nodes", "scene", "scenes"})
"""Members of the document that are parsed again."""

_members_decoder: Final = msgspec.json.Decoder(dict[str, msgspec.Raw])
_document_decoder: Final = msgspec.json.Decoder(schema.Document)


@dataclass(frozen=True, slots=True, eq=False)
class DocumentContent:
    """Everything in a document but its nodes and scenes."""

    generator: str
    """``asset.generator``."""
    from_drake: bool
    """True for a document from Drake's render client."""
    resembles_drake: bool
    """True for a file of VTK's exporter that may be a saved document from Drake's render client."""
    cameras: list[schema.GltfCamera | None]
    lights: list[schema.GltfLight | None]
    parts: Mapping[int, tuple[Part, ...]]
    """Primitives by mesh index. Only the meshes in use are here, in the order of their first use."""
    posed_parts: Mapping[int, tuple[Part, ...]]
    """Primitives of the nodes with a skin, morph weights or instances of their own, by position in ``SceneNodes``. Not
    empty: the document is not cached."""
    mesh_names: Mapping[int, str]
    """Different names of the meshes in use, by mesh index."""
    element_counts: Mapping[int, int]
    """Number of triangles, lines and points by mesh index."""
    morphed_mesh_count: int
    """Number of meshes with ``weights`` that are not all zero."""
    warnings: tuple[str, ...]
    """Sentences about properties that were ignored or repaired."""
    mesh_bytes: int
    """Size of the meshes' arrays, each mesh counted once."""


MeshKey: TypeAlias = bytes
"""The content of a primitive: its mode, and ``Accessor.key`` of its indices and of each attribute."""
ImageKey: TypeAlias = tuple[bytes, int, int, int]
"""SHA-256 of the buffer that holds an encoded image, its offset and length in bytes, and ``max_image_pixels``."""
ContentKey: TypeAlias = MeshKey | ImageKey
_Key: TypeAlias = tuple[GltfLimits, int, int]
"""Limits; size and CRC-32 of the text before the nodes. Other text can have the same key."""


@dataclass(frozen=True, slots=True, eq=False)
class _Entry:
    """A cached document, without its nodes and scenes."""

    text: bytes
    """The text before ``nodes``."""
    text_sha256: hashlib._Hash
    """State of the SHA-256 after that text."""
    content: DocumentContent
    prefix_json_bytes: int
    """Size of the JSON text before ``nodes``, without long data URIs, for ``max_json_bytes``."""
    prefix_value_count: int
    """Number of values in that text, for ``max_json_values``."""
    suffix_members: dict[str, msgspec.Raw]
    """JSON text, by name, of the members after ``nodes`` that must be equal for a hit, such as ``samplers``."""


@dataclass(frozen=True)
class HashedDocument:
    """The bytes of a ``.gltf`` or ``.glb`` file, with what a cache knows of them."""

    data: bytes | bytearray
    """The file, which must not change."""
    nodes_offset: int
    """Offset in bytes of the member ``nodes``; 0 if the cache cannot be used for this document."""
    key: _Key
    known: _Entry | None
    """The entry with the same text before the nodes; None if there is none."""
    text_sha256: hashlib._Hash
    """State of the SHA-256 after that text."""

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all bytes, 64 hexadecimal digits, computed with the GIL released."""
        sha256 = self.text_sha256.copy()
        with memoryview(self.data) as view:
            sha256.update(view[self.nodes_offset :])
        return sha256.hexdigest()


class GltfCache:
    """Contents of documents by the text before their nodes, and meshes and images by their bytes.

    Equal bytes become the same ``Mesh`` and ``Image`` objects in all documents. A renderer, which prepares each object
    only once, has nothing to prepare again either. Thread-safe.
    """

    def __init__(self, budget: CacheBudget = SHARED) -> None:
        self.documents: Final[Cache[_Key, _Entry]] = Cache("documents", budget=budget)
        self.content: Final[Cache[ContentKey, Mesh | Image]] = Cache("content", budget=budget)

    def look_up(self, data: bytes | bytearray, limits: GltfLimits) -> HashedDocument:
        """Return a document with what is known of it. ``data`` must not change."""
        offset = _nodes_offset(data)
        with memoryview(data) as view, view[:offset] as text:
            key = limits, offset, isal_zlib.crc32(text)
            entry = self.documents.get(key) if offset else None
            if entry is not None and data.startswith(entry.text):
                return HashedDocument(data, offset, key, entry, entry.text_sha256)
            return HashedDocument(data, offset, key, None, hashlib.sha256(text))

    def add(self, document: HashedDocument, container: Container, content: DocumentContent) -> None:
        """Keep the content of a document, opened as ``container``, if its text can be split before its nodes."""
        entry = _new_entry(document, container, content)
        if entry is not None:
            # The file's size bounds that of its images, which are kept encoded.
            self.documents.put(document.key, entry, content.mesh_bytes + len(document.data) + len(entry.text))


def parse_nodes(document: HashedDocument, limits: GltfLimits) -> tuple[DocumentContent, schema.Document] | None:
    """Return the known content of a document, and a document with its nodes and scenes; None if all must be read."""
    if document.known is None:
        return None
    with memoryview(document.data) as view:
        node_document = _parse_suffix(bytes(view[document.nodes_offset :]), document.known, limits)
    return None if node_document is None else (document.known.content, node_document)


def _nodes_offset(text: bytes | bytearray) -> int:
    """Return the offset of the last ``"nodes"`` followed by a list of objects.

    The result is 0 if there is none, if a data URI follows, and for a ``.glb``. The match may lie inside another
    member, which ``_new_entry`` finds out.
    """
    if text.startswith(b"glTF"):
        return 0
    offset = len(text)
    for _ in range(_MAX_CANDIDATES):
        offset = text.rfind(_NODES, MIN_BYTES, offset)
        if offset < 0:
            return 0
        if _LIST_OF_OBJECTS.match(text, offset + len(_NODES)):
            return offset if text.find(_DATA_URI, offset) < 0 else 0
    return 0


def _new_entry(document: HashedDocument, container: Container, content: DocumentContent) -> _Entry | None:
    """Return the entry for a document; None if its text cannot be split before its nodes.

    With a brace added, the text before and the text after the split must be JSON objects. This proves that ``nodes`` is
    a member of the outermost object. Scenes before the nodes would become part of the cached content, so a text with
    such scenes is not split.
    """
    if document.nodes_offset == 0:
        return None
    text = container.json
    split = len(text) - (len(document.data) - document.nodes_offset)  # the data URIs that it lacks are before the nodes
    before = text[:split].rstrip()
    if not before.endswith(b","):
        return None
    try:
        prefix_members = _members_decoder.decode(before[:-1] + b"}")
        suffix_members = _members_decoder.decode(b"{" + text[split:])
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None
    if not _CHANGING_MEMBERS.isdisjoint(prefix_members):
        return None
    unchanging = {name: value.copy() for name, value in _unchanging(suffix_members).items()}
    document_text = bytes(document.data[: document.nodes_offset])
    return _Entry(document_text, document.text_sha256, content, split, count_values(text[:split]), unchanging)


def _unchanging(members: dict[str, msgspec.Raw]) -> dict[str, msgspec.Raw]:
    return {name: value for name, value in members.items() if name not in _CHANGING_MEMBERS}


def _parse_suffix(text: bytes, entry: _Entry, limits: GltfLimits) -> schema.Document | None:
    """Return a document with its nodes and scenes; None if the whole document must be read, or is beyond a limit.

    ``text``: JSON text from the name of the member ``nodes`` to the end.
    """
    json_bytes = entry.prefix_json_bytes + len(text)
    if json_bytes > limits.max_json_bytes:
        return None
    # A value takes at least one byte, so the values of a short text need not be counted.
    if json_bytes > limits.max_json_values and entry.prefix_value_count + count_values(text) > limits.max_json_values:
        return None
    try:
        if _unchanging(_members_decoder.decode(b"{" + text)) == entry.suffix_members:
            return _document_decoder.decode(b"{" + text)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        pass
    return None
