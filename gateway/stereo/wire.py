"""Serialised image sets, joined by hand: each picture is copied once, from its array to the message.

Protobuf's own way copies a picture into a message object and from there into the bytes, holding the interpreter's lock.
Here only the small fields are serialised by protobuf; the large ``data`` fields follow them, which is valid wire format
(fields may come in any order) and parses to the same message.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Final, cast

import numpy as np

Chunk = bytes | memoryview
_LARGE: Final = 4 << 20
"""Bytes from which a join releases the interpreter's lock; below, it takes under half a millisecond."""

_new_bytes = ctypes.pythonapi.PyBytes_FromStringAndSize
_new_bytes.restype = ctypes.py_object
_new_bytes.argtypes = (ctypes.c_void_p, ctypes.c_ssize_t)
_bytes_address = ctypes.pythonapi.PyBytes_AsString
_bytes_address.restype = ctypes.c_void_p
_bytes_address.argtypes = (ctypes.py_object,)


def varint(value: int) -> bytes:
    """A base 128 number, least significant group first."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def size(chunks: Sequence[Chunk]) -> int:
    """Bytes of all chunks."""
    return sum(c.nbytes if isinstance(c, memoryview) else len(c) for c in chunks)


def field(number: int, chunks: Sequence[Chunk]) -> list[Chunk]:
    """A length-delimited field (bytes or a message) that holds the chunks."""
    return [varint(number << 3 | 2) + varint(size(chunks)), *chunks]


def join(chunks: Sequence[Chunk]) -> bytes:
    """The chunks as one bytes object. Large ones are copied without the interpreter's lock: call it in a thread."""
    total = size(chunks)
    if total < _LARGE:
        return b"".join(chunks)
    # The C API allows to write to a bytes object that nobody else has seen yet; numpy copies without the lock.
    data = cast(bytes, _new_bytes(None, total))
    target = np.ctypeslib.as_array((ctypes.c_uint8 * total).from_address(_bytes_address(data)))
    offset = 0
    for chunk in chunks:
        source = np.frombuffer(chunk, np.uint8)
        target[offset : offset + len(source)] = source
        offset += len(source)
    return data
