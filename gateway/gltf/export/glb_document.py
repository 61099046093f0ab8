"""A glTF document under construction: its arrays, its buffer, and the ``.glb`` file around them."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

MAX_BYTES: Final = 1 << 30
"""Maximum size of a file; the header allows 4 GB, but most readers less."""
VERTEX_TARGET: Final = 34962
INDEX_TARGET: Final = 34963
"""Targets of buffer views: ARRAY_BUFFER and ELEMENT_ARRAY_BUFFER."""
_FLOAT: Final = 5126
_UINT16: Final = 5123
_UINT32: Final = 5125
_COMPONENTS: Final = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


class ExportError(ValueError):
    """A tree that cannot be written. The message names the limit."""


class GltfDocument:
    """Arrays of entries, and one buffer. Equal entries can be added once."""

    def __init__(self, generator: str, max_bytes: int) -> None:
        """
        Args:
            max_bytes: Maximum size of the buffer.
        """
        self._generator = generator
        self._max_bytes = max_bytes
        self._chunks: list[bytes] = []
        self._nbytes = 0
        self._lists: dict[str, list[Any]] = {}
        self._indices: dict[tuple[str, object], int | None] = {}
        self._sources: list[object] = []
        """Objects whose ids are keys."""
        self.extensions: set[str] = set()
        """Names of the extensions in use."""

    def add(self, kind: str, value: dict[str, Any]) -> int:
        """Append ``value`` to the document's array ``kind``, such as ``meshes``, and return its index."""
        entries = self._lists.setdefault(kind, [])
        entries.append(value)
        return len(entries) - 1

    def once(self, kind: str, source: object, make: Callable[[], int | None]) -> int | None:
        """Return what ``make`` returned for this object, by identity; ``make`` is called the first time only."""
        if (kind, id(source)) not in self._indices:
            self._sources.append(source)
        return self.once_equal(kind, id(source), make)

    def once_equal(self, kind: str, key: object, make: Callable[[], int | None]) -> int | None:
        """Return what ``make`` returned for this key; ``make`` is called the first time only. Keys are compared by
        equality."""
        if (kind, key) not in self._indices:
            self._indices[kind, key] = make()
        return self._indices[kind, key]

    def accessor(self, array: NDArray[Any], target: int, *, bounds: bool = False) -> int:
        """Add an accessor with a buffer view, and return its index.

        Args:
            array: (N, 1 .. 4) float32, uint16 or uint32.
            target: ``VERTEX_TARGET`` or ``INDEX_TARGET``.
            bounds: True to write ``min`` and ``max``, as positions require.
        """
        view = self.view(np.ascontiguousarray(array).tobytes(), target)
        component = {"f": _FLOAT, "u": _UINT16 if array.dtype.itemsize == 2 else _UINT32}[array.dtype.kind]
        entry: dict[str, Any] = {
            "bufferView": view,
            "componentType": component,
            "count": len(array),
            "type": _COMPONENTS[array.shape[1]],
        }
        if bounds:
            entry["min"] = array.min(axis=0).astype(float).tolist()
            entry["max"] = array.max(axis=0).astype(float).tolist()
        return self.add("accessors", entry)

    def view(self, data: bytes, target: int | None = None) -> int:
        """Append bytes to the buffer, and return the index of their buffer view.

        Raises:
            ExportError: The buffer would be larger than its limit.
        """
        offset = self._nbytes
        padding = -len(data) % 4
        self._nbytes += len(data) + padding
        if self._nbytes > self._max_bytes:
            raise ExportError(f"the scene as .glb is larger than {self._max_bytes} bytes")
        self._chunks.append(data)
        if padding:
            self._chunks.append(b"\0" * padding)
        entry = {"buffer": 0, "byteOffset": offset, "byteLength": len(data)}
        if target is not None:
            entry["target"] = target
        return self.add("bufferViews", entry)

    def glb(self, top: int) -> bytes:
        """Return the file (GLB 2.0): a header, the JSON chunk padded with spaces, the binary chunk padded with zeros.

        Args:
            top: Index of the scene's root node.
        """
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": self._generator},
            "scene": 0,
            "scenes": [{"nodes": [top]}],
            **self._lists,
        }
        if self.extensions:
            document["extensionsUsed"] = sorted(self.extensions)
        if self._chunks:
            document["buffers"] = [{"byteLength": self._nbytes}]
        text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        parts = [struct.pack("<II", len(text), 0x4E4F534A), text]
        if self._chunks:
            parts += [struct.pack("<II", self._nbytes, 0x004E4942), *self._chunks]
        total = 12 + sum(map(len, parts))
        return b"".join((struct.pack("<4sII", b"glTF", 2, total), *parts))
