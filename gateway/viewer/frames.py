"""The binary frame that carries everything to the browser; no I/O.

Little-endian: ``u32 magic "SGV1" | u32 header bytes | header: JSON in UTF-8, padded with spaces | body``. The header
names arrays of the body as ``[offset, count]``, the offset in bytes from the start of the body, always a multiple of 8,
so that the page can lay typed arrays over the message without copying.
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
_PREFIX: Final = struct.Struct("<II")
_json: Final = msgspec.json.Encoder()


def fragment(value: dict[str, Any]) -> msgspec.Raw:
    """A part of a header, encoded before the whole."""
    return msgspec.Raw(_json.encode(value))


class FrameBuilder:
    """Collects arrays and bytes of a frame's body."""

    __slots__ = ("_pieces", "_size")

    def __init__(self) -> None:
        self._pieces: list[bytes] = []
        self._size = 0

    def array(self, values: NDArray[Any]) -> list[int]:
        """Adds an array; returns ``[offset, count of numbers]`` for the header."""
        return [self._add(np.ascontiguousarray(values).tobytes()), int(values.size)]

    def numbers(self, values: packed_array[Any]) -> list[int]:
        """The same for an array of the standard library."""
        return [self._add(values.tobytes()), len(values)]

    def blob(self, data: bytes) -> list[int]:
        """Adds bytes; returns ``[offset, length]``."""
        return [self._add(data), len(data)]

    def _add(self, data: bytes) -> int:
        offset = self._size
        padding = -len(data) % ALIGNMENT
        self._pieces.append(data)
        if padding:
            self._pieces.append(bytes(padding))
        self._size += len(data) + padding
        return offset

    def finish(self, header: dict[str, Any]) -> bytes:
        """The whole frame."""
        text = _json.encode(header)
        text += b" " * (-(len(text) + _PREFIX.size) % ALIGNMENT)
        return b"".join((_PREFIX.pack(MAGIC, len(text)), text, *self._pieces))


def parse(frame: bytes) -> tuple[dict[str, Any], memoryview]:
    """Header and body of a frame, for tests and clients in Python.

    Raises:
        ValueError: not a frame.
    """
    if len(frame) < _PREFIX.size or _PREFIX.unpack_from(frame)[0] != MAGIC:
        raise ValueError("not a view frame: it does not start with SGV1")
    end = _PREFIX.size + _PREFIX.unpack_from(frame)[1]
    if end > len(frame):
        raise ValueError(f"view frame of {len(frame)} bytes ends within its header of {end - _PREFIX.size} bytes")
    return msgspec.json.decode(frame[_PREFIX.size : end]), memoryview(frame)[end:]
