"""Cache of the reader: equal bytes become the same ``Mesh`` and ``Image`` objects in all documents.

Drake's client sends the whole scene with every image. Bytes that were decoded before are not decoded again. A renderer,
which prepares each ``Mesh`` and ``Image`` object only once, has nothing to prepare again either.
"""

from __future__ import annotations

from typing import Final, TypeAlias

from gateway.gltf.document_cache import DocumentCache
from renderers.cache import SHARED, Cache, CacheBudget
from renderers.drawlist import Image, Mesh

IMAGE_BYTES: Final = 256
"""Approximate size of an ``Image`` besides its encoded data."""


MeshKey: TypeAlias = bytes
"""The content of a primitive: its mode, and ``Accessor.key`` of its indices and of each attribute."""
ImageKey: TypeAlias = tuple[bytes, int, int, int]
"""SHA-256 of the buffer that holds an encoded image, its offset and length in bytes, and ``max_image_pixels``."""
ContentKey: TypeAlias = MeshKey | ImageKey


class GltfCache:
    """Document contents by the text before their nodes, and meshes and images by their bytes. Thread-safe."""

    def __init__(self, budget: CacheBudget = SHARED) -> None:
        self.documents: Final = DocumentCache(budget)
        self.content: Final[Cache[ContentKey, Mesh | Image]] = Cache("content", budget=budget)
