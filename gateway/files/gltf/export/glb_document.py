"""Builder of a glTF document: its JSON arrays, its buffer, and the ``.glb`` file that holds them."""

import json
import struct
from collections.abc import Callable, Hashable
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from gateway.files.gltf.accessors import COMPONENT_COUNTS, COMPONENT_TYPES
from gateway.files.gltf.lights import EXTENSION as LIGHTS
from gateway.scene.tree.timeline import FileTooLargeError
from gateway.scene.tree.transforms import Matrix

MAX_BYTES: Final = 1 << 30
"""Default maximum size of a file's buffer. The header allows 4 GB, but most readers allow less."""
VERTEX_TARGET: Final = 34962
INDEX_TARGET: Final = 34963
"""Targets of buffer views: ARRAY_BUFFER and ELEMENT_ARRAY_BUFFER."""
_COMPONENT_TYPES: Final = {dtype: code for code, dtype in COMPONENT_TYPES.items()}
"""``componentType`` by data type."""
_ACCESSOR_TYPES: Final = {count: name for name, count in COMPONENT_COUNTS.items()}
"""``type`` by number of components."""
T = TypeVar("T")


class GltfDocument:
    """The JSON arrays of a document, and its one buffer."""

    def __init__(self, generator: str, max_bytes: int) -> None:
        """``max_bytes``: maximum size of the buffer."""
        self._generator = generator
        self._max_bytes = max_bytes
        self._buffer_pieces: list[bytes] = []
        self._nbytes = 0
        self._arrays: dict[str, list[Any]] = {}
        self._added: dict[tuple[str, Hashable], Any] = {}
        """Results of ``get_or_add``, by kind and key."""
        self.warnings: list[str] = []
        """Sentences about what the file does not have, for ``asset.extras``."""
        self.extensions: set[str] = set()
        """Names of the extensions in use."""
        self.lights: list[dict[str, Any]] = []
        """Lights of KHR_lights_punctual."""

    def add(self, array_name: str, item: dict[str, Any]) -> int:
        """Append ``item`` to an array of the document, such as ``meshes``, and return its index."""
        array = self._arrays.setdefault(array_name, [])
        array.append(item)
        return len(array) - 1

    def get_or_add(self, kind: str, key: Hashable, add: Callable[[], T]) -> T:
        """Return what ``add`` returns for a kind and a key, such as an index; it is called once."""
        if (kind, key) not in self._added:
            self._added[kind, key] = add()
        added: T = self._added[kind, key]
        return added

    def add_accessor(self, array: NDArray[Any], target: int | None, *, bounds: bool = False) -> int:
        """Add an accessor of an array, (N, 1 .. 4), with a buffer view for ``VERTEX_TARGET`` or ``INDEX_TARGET``.

        Return its index. ``bounds``: write ``min`` and ``max``, as positions and times require.
        """
        item: dict[str, Any] = {
            "bufferView": self.add_buffer_view(np.ascontiguousarray(array).tobytes(), target),
            "componentType": _COMPONENT_TYPES[array.dtype],
            "count": len(array),
            "type": _ACCESSOR_TYPES[array.shape[1]],
        }
        if bounds:
            item["min"] = array.min(axis=0).astype(float).tolist()
            item["max"] = array.max(axis=0).astype(float).tolist()
        return self.add("accessors", item)

    def add_buffer_view(self, data: bytes, target: int | None = None) -> int:
        """Append bytes to the buffer, and return the index of their view. Raises FileTooLargeError beyond its limit."""
        offset = self._nbytes
        padding = -len(data) % 4
        self._nbytes += len(data) + padding
        if self._nbytes > self._max_bytes:
            raise FileTooLargeError(f"the scene as .glb is larger than {self._max_bytes} bytes")
        self._buffer_pieces.append(data)
        if padding:
            self._buffer_pieces.append(b"\0" * padding)
        item = {"buffer": 0, "byteOffset": offset, "byteLength": len(data)}
        if target is not None:
            item["target"] = target
        return self.add("bufferViews", item)

    def glb(self, root_node: int) -> bytes:
        """Return the file (GLB 2.0) with a root node: header, JSON padded with spaces, data padded with zeros."""
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": self._generator},
            "scene": 0,
            "scenes": [{"nodes": [root_node]}],
            **self._arrays,
        }
        if self.warnings:
            document["asset"]["extras"] = {"warnings": self.warnings}
        if self.extensions:
            document["extensionsUsed"] = sorted(self.extensions)
        if self.lights:
            document["extensions"] = {LIGHTS: {"lights": self.lights}}
        if self._buffer_pieces:
            document["buffers"] = [{"byteLength": self._nbytes}]
        text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        pieces = [struct.pack("<I4s", len(text), b"JSON"), text]
        if self._buffer_pieces:
            pieces += [struct.pack("<I4s", self._nbytes, b"BIN\0"), *self._buffer_pieces]
        total = 12 + sum(map(len, pieces))
        return b"".join((struct.pack("<4sII", b"glTF", 2, total), *pieces))


def column_major(matrix: Matrix) -> list[float]:
    """Return a transform as glTF writes it."""
    return [float(value) for value in matrix.T.ravel()]


def is_writable(matrix: Matrix) -> bool:
    """Return True if a matrix is finite and so small that products with it fit float32."""
    return bool((np.abs(matrix) < 1e15).all())
