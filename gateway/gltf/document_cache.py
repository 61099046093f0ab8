"""Cache of document contents, so that a document that differs from an earlier one in its nodes only is read quickly.

Drake's client sends the whole scene with every image, with the members of the JSON document sorted by name. While a
robot moves, the text before the member ``nodes`` (accessors, buffers, materials, meshes: nearly all of it) stays the
same. The cache finds its content by the SHA-256 of that text; only the text from ``nodes`` on is parsed again.
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
_LIST_OF_OBJECTS: Final = re.compile(rb"\s*:\s*\[\s*(\{|null)")
"""Value of the document's member ``nodes``; members of that name inside scenes are lists of numbers."""
_MAX_CANDIDATES: Final = 64
"""Maximum number of occurrences of ``"nodes"`` that are tried, from the end: scenes and extras may have it, too."""
_CHANGING_MEMBERS: Final = frozenset({"nodes", "scene", "scenes"})
"""Members of the document that are parsed again."""

_members_decoder: Final = msgspec.json.Decoder(dict[str, msgspec.Raw])
_nodes_decoder: Final = msgspec.json.Decoder(list[schema.Node | None] | None)
_scenes_decoder: Final = msgspec.json.Decoder(list[schema.Scene | None] | None)
_scene_decoder: Final = msgspec.json.Decoder(int | None)


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
    """Primitives by mesh index, for the meshes in use in the order of their first use."""
    element_counts: Mapping[int, int]
    """Number of triangles, lines and points by mesh index."""
    morphed_meshes: int
    """Number of meshes with weights of their own."""
    warnings: tuple[str, ...]

    mesh_bytes: int
    """Size of the meshes' arrays, each mesh counted once."""


_Key: TypeAlias = tuple[bytes, GltfLimits, bool]
"""``HashedDocument.prefix_digest``, limits, and True if textures are read."""
_UnchangedMembers: TypeAlias = dict[str, bytes]
"""JSON text by name of the members after ``nodes`` that must be equal for a hit, such as ``samplers``."""


class DocumentCache:
    """Contents of documents by the digest of the text before their nodes. Thread-safe; bounded in bytes."""

    def __init__(self, max_bytes: int) -> None:
        self.cache: Final[Cache[_Key, tuple[_UnchangedMembers, DocumentContent]]] = Cache(max_bytes)

    def find(
        self, document: HashedDocument, limits: GltfLimits, textures: bool
    ) -> tuple[DocumentContent, schema.Document] | None:
        """Return the content of a document, and its nodes and scenes; None when it must be read as a whole.

        Args:
            textures: True if textures are read, as for ``read_gltf``.
        """
        if document.nodes_offset == 0:
            return None
        cached = self.cache.get((document.prefix_digest, limits, textures))
        if cached is None:
            return None
        unchanged, content = cached
        with memoryview(document.data) as view:
            nodes_and_scenes = _parse_from_nodes(bytes(view[document.nodes_offset :]), unchanged, limits)
        return None if nodes_and_scenes is None else (content, nodes_and_scenes)

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
        unchanged = _unchanged_members(document, container)
        if unchanged is not None:
            nbytes = content.mesh_bytes + len(document.data)  # an upper limit for images, which are kept encoded
            self.cache.put((document.prefix_digest, limits, textures), (unchanged, content), nbytes)


def _nodes_offset(text: bytes | bytearray) -> int:
    """Return the offset of the last ``"nodes"`` followed by a list of objects.

    The result is 0 where there is none, where data URIs follow, and for a ``.glb``. A match is a candidate: it may be
    inside another member, which ``_unchanged_members`` finds out.
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


def _unchanged_members(document: HashedDocument, container: Container) -> _UnchangedMembers | None:
    """Return the members after the nodes that must not change; None if the text cannot be split before the nodes.

    Both halves must be JSON objects, which proves that ``nodes`` is a member of the outermost object. Scenes before the
    nodes would be kept with the content, so such a text is not split.
    """
    if document.nodes_offset == 0:
        return None
    text = container.json
    split = len(text) - (len(document.data) - document.nodes_offset)  # there are no placeholders after the nodes
    before = text[:split].rstrip()
    if not before.endswith(b","):
        return None
    try:
        members_before = _members_decoder.decode(before[:-1] + b"}")
        members_after = _members_decoder.decode(b"{" + text[split:])
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None
    return _without_nodes_and_scenes(members_after) if _CHANGING_MEMBERS.isdisjoint(members_before) else None


def _without_nodes_and_scenes(members: dict[str, msgspec.Raw]) -> _UnchangedMembers:
    return {name: bytes(value) for name, value in members.items() if name not in _CHANGING_MEMBERS}


def _parse_from_nodes(text: bytes, unchanged: _UnchangedMembers, limits: GltfLimits) -> schema.Document | None:
    """Return a document of nodes and scenes only; None if the document must be read as a whole.

    Args:
        text: JSON text from the name of the member ``nodes`` to the end.
        unchanged: Required values of the other members.
    """
    if len(text) > limits.max_json_bytes or count_values(text, limits) > limits.max_json_values:
        return None
    try:
        members = _members_decoder.decode(b"{" + text)
        if _without_nodes_and_scenes(members) != unchanged:
            return None
        return schema.Document(
            nodes=_nodes_decoder.decode(members["nodes"]),
            scenes=_scenes_decoder.decode(members["scenes"]) if "scenes" in members else None,
            scene=_scene_decoder.decode(members["scene"]) if "scene" in members else None,
        )
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None
