"""Protobuf wire format of image sets, with one copy of each image.

Protobuf would copy an image into a message object and from there into the serialised bytes, with the GIL held. Here
protobuf serialises the small fields only, and the large ``data`` fields are appended. The format permits any order of
fields, so the bytes parse to the same message.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Final, cast

import numpy as np

Chunk = bytes | memoryview
"""Bytes. A view has one dimension and the format ``B``, so that ``len`` is its number of bytes."""
MIN_BYTES_WITHOUT_GIL: Final = 4 << 20
"""Number of bytes from which chunks are joined without the GIL. Fewer bytes take under half a millisecond. A full mesh
(55 MB) takes 65 ms, which would block the event loop."""

_LENGTH_DELIMITED: Final = 2
"""Wire type."""

# The C API permits writing to a new bytes object before anything else refers to it; see ``join``.
_new_bytes = ctypes.pythonapi.PyBytes_FromStringAndSize
_new_bytes.restype = ctypes.py_object
_new_bytes.argtypes = (ctypes.c_void_p, ctypes.c_ssize_t)
_bytes_address = ctypes.pythonapi.PyBytes_AsString
_bytes_address.restype = ctypes.c_void_p
_bytes_address.argtypes = (ctypes.py_object,)


def varint(*values: int) -> bytes:
    """Return unsigned numbers in protobuf's base-128 encoding."""
    encoded = bytearray()
    for value in values:
        while value > 0x7F:
            encoded.append(value & 0x7F | 0x80)
            value >>= 7
        encoded.append(value)
    return bytes(encoded)


def byte_count(chunks: Sequence[Chunk]) -> int:
    """Return the number of bytes of all chunks."""
    return sum(map(len, chunks))


def field(number: int, chunks: Sequence[Chunk]) -> list[Chunk]:
    """Return a length-delimited field (bytes or a message) with the chunks as its content."""
    return [varint(number << 3 | _LENGTH_DELIMITED, sum(map(len, chunks))), *chunks]


def join(chunks: Sequence[Chunk]) -> bytes:
    """Return the chunks as one bytes object, copied without the GIL, for worker threads."""
    total = byte_count(chunks)
    data = cast(bytes, _new_bytes(None, total))
    target = np.ctypeslib.as_array((ctypes.c_uint8 * total).from_address(_bytes_address(data)))
    offset = 0
    for chunk in chunks:
        source = np.frombuffer(chunk, np.uint8)
        target[offset : offset + len(source)] = source
        offset += len(source)
    return data
