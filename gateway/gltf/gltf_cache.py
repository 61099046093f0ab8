"""Cache of the reader: equal bytes become the same ``Mesh`` and ``Image`` objects in all documents.

Drake's client sends the whole scene with every image. Known bytes are not decoded again, and a renderer, which prepares
each ``Mesh`` and ``Image`` object once, has nothing to prepare.
"""

from __future__ import annotations

from typing import Final, NamedTuple, TypeAlias

from gateway.gltf.document_cache import DocumentCache
from renderers.cache import Cache
from renderers.drawlist import Image, Mesh

IMAGE_BYTES: Final = 256
"""Size of an ``Image`` besides its encoded data."""


MeshKey: TypeAlias = bytes
"""Mode, and ``Accessor.key`` of the indices and of each attribute: SHA-256 digests of the buffers, and their layout."""


class ImageKey(NamedTuple):
    """The content of an encoded image."""

    digest: bytes
    """SHA-256 of the buffer."""
    offset: int
    length: int
    max_pixels: int


ContentKey: TypeAlias = MeshKey | ImageKey


class GltfCache:
    """Whole documents by the text before their nodes, and meshes and images by their bytes. Thread-safe."""

    def __init__(self, max_bytes: int = 512 << 20, max_document_bytes: int | None = None) -> None:
        """
        Args:
            max_bytes: Size of everything that is kept. The default is enough for ten scenes of 25 MB.
            max_document_bytes: Part of it for document contents; None: half.
        """
        document_bytes = max_bytes // 2 if max_document_bytes is None else max_document_bytes
        self.documents: Final = DocumentCache(document_bytes)
        self.content: Final[Cache[ContentKey, Mesh | Image]] = Cache(max_bytes - document_bytes)
