"""Cache of documents that differ in their nodes only: everything else is read once.

Drake's client sends the whole scene with every image, and its writer sorts the members of the document by name. While
a robot moves, the text up to the member ``nodes`` (accessors, buffers, materials, meshes: nearly all of it) stays the
same. Its result is found by the SHA-256 of that text; only the nodes and the scenes behind it are parsed again.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final, TypeAlias

import msgspec

from gateway.gltf import schema
from gateway.gltf.container import Container
from gateway.gltf.limits import GltfLimits
from gateway.gltf.parser import count_values
from gateway.scene.geometry import Part
from renderers.cache import Cache

MIN_BYTES: Final = 4096
"""Shorter texts before the nodes are not kept: parsing them costs no more than hashing."""
_NODES: Final = b'"nodes"'
_DATA_URI: Final = b'"data:'
_OBJECTS: Final = re.compile(rb"\s*:\s*\[\s*(\{|null)")
"""Start of the nodes of a document; members of that name inside scenes are lists of numbers."""
_MAX_CANDIDATES: Final = 64
"""Maximum number of occurrences of ``"nodes"`` that are tried, from the end: scenes and extras may have it, too."""
_PER_REQUEST: Final = frozenset({"nodes", "scene", "scenes"})

_members: Final = msgspec.json.Decoder(dict[str, msgspec.Raw])
_nodes: Final = msgspec.json.Decoder(list[schema.Node | None] | None)
_scenes: Final = msgspec.json.Decoder(list[schema.Scene | None] | None)
_index: Final = msgspec.json.Decoder(int | None)


class HashedDocument:
    """The bytes of a ``.gltf`` or ``.glb`` file and their digests, computed with the GIL released."""

    def __init__(self, data: bytes | bytearray) -> None:
        """
        Args:
            data: The file; must not change.
        """
        self.data: Final = data
        self.nodes_offset: Final = _nodes_offset(data)
        """Offset of the member ``nodes``; 0 if the text cannot be split there (``_nodes_offset``)."""
        with memoryview(data) as view:
            self._prefix_hash = hashlib.sha256(view[: self.nodes_offset])
        self.prefix_digest: Final = self._prefix_hash.digest()
        """SHA-256 of the ``nodes_offset`` bytes before the nodes."""

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all bytes, 64 hexadecimal digits. The bytes before the nodes are not hashed again."""
        whole = self._prefix_hash.copy()
        with memoryview(self.data) as view:
            whole.update(view[self.nodes_offset :])
        return whole.hexdigest()


@dataclass(frozen=True, slots=True, eq=False)
class DocumentContent:
    """Everything in a document but its nodes and scenes."""

    generator: str
    """``asset.generator``."""
    cameras: list[schema.Camera | None]
    lights: list[schema.Light | None]
    parts: Mapping[int, tuple[Part, ...]]
    """Primitives by mesh index, for the meshes in use."""
    used_meshes: tuple[int, ...]
    """``SceneNodes.used_meshes`` of the nodes that this was read for."""
    element_counts: Mapping[int, int]
    """Number of triangles, lines and points by mesh index."""
    morphed_meshes: int
    """Number of meshes with weights of their own."""
    warnings: tuple[str, ...]

    mesh_bytes: int
    """Size of the meshes' arrays, each mesh counted once."""


_Key: TypeAlias = tuple[bytes, GltfLimits, bool]
_Fixed: TypeAlias = dict[str, bytes]
"""JSON text of the members after the nodes, other than nodes and scenes, by name."""


class DocumentCache:
    """Contents of documents by the digest of the text before their nodes. Thread-safe; bounded in bytes."""

    def __init__(self, max_bytes: int) -> None:
        self.cache: Final[Cache[_Key, tuple[_Fixed, DocumentContent]]] = Cache(max_bytes)

    def find(
        self, document: HashedDocument, limits: GltfLimits, textures: bool
    ) -> tuple[DocumentContent, schema.Document] | None:
        """Return the content of a document, and its nodes and scenes; None when it must be read as a whole.

        Args:
            textures: True if textures are read, as for ``read_gltf``.
        """
        if document.nodes_offset == 0:
            return None
        found = self.cache.get((document.prefix_digest, limits, textures))
        if found is None:
            return None
        fixed, content = found
        with memoryview(document.data) as view:
            rest = _parse_rest(bytes(view[document.nodes_offset :]), fixed, limits)
        return None if rest is None else (content, rest)

    def add(
        self,
        document: HashedDocument,
        container: Container,
        limits: GltfLimits,
        textures: bool,
        content: DocumentContent,
    ) -> None:
        """Keep the content of a document, if its text can be split before its nodes.

        Args:
            container: The document, opened.
        """
        fixed = _fixed_members(document, container)
        if fixed is not None:
            nbytes = content.mesh_bytes + len(document.data)  # nearly all of it may be encoded images
            self.cache.put((document.prefix_digest, limits, textures), (fixed, content), nbytes)

    def clear(self) -> None:
        """Drop everything."""
        self.cache.clear()


def _nodes_offset(text: bytes | bytearray) -> int:
    """Return the offset of the last ``"nodes"`` followed by a list of objects.

    The result is 0 where there is none, where data URIs follow, and for a ``.glb``. A match is a candidate: it may be
    inside another member, which ``_fixed_members`` finds out.
    """
    if text.startswith(b"glTF"):
        return 0
    at = len(text)
    for _ in range(_MAX_CANDIDATES):
        at = text.rfind(_NODES, MIN_BYTES, at)
        if at < 0:
            return 0
        if _OBJECTS.match(text, at + len(_NODES)):
            return at if text.find(_DATA_URI, at) < 0 else 0
    return 0


def _fixed_members(document: HashedDocument, container: Container) -> _Fixed | None:
    """Return the members after the nodes that must not change; None where the text cannot be split before the nodes.

    That both halves are JSON objects proves that ``nodes`` is a member of the outermost object. A text is not split
    when scenes come before its nodes.
    """
    if document.nodes_offset == 0:
        return None
    text = container.json
    at = len(text) - (len(document.data) - document.nodes_offset)  # no data URIs were taken out after the nodes
    before = text[:at].rstrip()
    if not before.endswith(b","):
        return None
    try:
        stable = _members.decode(before[:-1] + b"}")
        rest = _members.decode(b"{" + text[at:])
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None
    return _without_nodes(rest) if _PER_REQUEST.isdisjoint(stable) else None


def _without_nodes(members: dict[str, msgspec.Raw]) -> _Fixed:
    return {name: bytes(value) for name, value in members.items() if name not in _PER_REQUEST}


def _parse_rest(text: bytes, fixed: _Fixed, limits: GltfLimits) -> schema.Document | None:
    """Return nodes and scenes of the text from ``nodes`` on; None when the document must be read as a whole."""
    if len(text) > limits.max_json_bytes or count_values(text, limits) > limits.max_json_values:
        return None
    try:
        members = _members.decode(b"{" + text)
        if _without_nodes(members) != fixed:
            return None
        return schema.Document(
            nodes=_nodes.decode(members["nodes"]) if "nodes" in members else None,
            scenes=_scenes.decode(members["scenes"]) if "scenes" in members else None,
            scene=_index.decode(members["scene"]) if "scene" in members else None,
        )
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None
