"""The binary frame of the view's WebSocket: a JSON header and arrays.

Little-endian: ``u32 magic "SGV1" | u32 header bytes | header: JSON in UTF-8, padded with spaces | body``. The header
refers to an array in the body as ``[offset, count]``. The offset is in bytes from the start of the body and a multiple
of 8, so the page can create typed arrays on the message without copying.
"""

from __future__ import annotations

import struct
from array import array as packed_array
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

MAGIC: Final = 0x31564753
"""The bytes "SGV1"."""
ALIGNMENT: Final = 8
"""Arrays start at multiples of this many bytes."""
_PREFIX: Final = struct.Struct("<II")
_json: Final = msgspec.json.Encoder()


def encode_fragment(value: dict[str, Any]) -> msgspec.Raw:
    """Encode a part of a header ahead of the header itself."""
    return msgspec.Raw(_json.encode(value))


class FrameBuilder:
    """Collects the arrays of a frame's body."""

    __slots__ = ("_chunks", "_size")

    def __init__(self) -> None:
        self._chunks: list[bytes] = []
        self._size = 0

    def add_array(self, values: NDArray[Any] | packed_array[Any]) -> list[int]:
        """Append an array to the body; return its ``[offset, count]`` for the header."""
        data = values.tobytes()
        padding = -len(data) % ALIGNMENT
        self._chunks.append(data)
        if padding:
            self._chunks.append(bytes(padding))
        offset = self._size
        self._size += len(data) + padding
        return [offset, int(values.size) if isinstance(values, np.ndarray) else len(values)]

    def finish(self, header: dict[str, Any]) -> bytes:
        """Return the complete frame."""
        text = _json.encode(header)
        text += b" " * (-(len(text) + _PREFIX.size) % ALIGNMENT)
        return b"".join((_PREFIX.pack(MAGIC, len(text)), text, *self._chunks))


def parse_frame(frame: bytes) -> tuple[dict[str, Any], memoryview]:
    """Split a frame into header and body, for tests and Python clients.

    Raises:
        ValueError: ``frame`` is not a valid frame.
    """
    if len(frame) < _PREFIX.size or _PREFIX.unpack_from(frame)[0] != MAGIC:
        raise ValueError("not a view frame: it does not start with SGV1")
    end = _PREFIX.size + _PREFIX.unpack_from(frame)[1]
    if end > len(frame):
        raise ValueError(f"view frame of {len(frame)} bytes ends within its header of {end - _PREFIX.size} bytes")
    return msgspec.json.decode(frame[_PREFIX.size : end]), memoryview(frame)[end:]
