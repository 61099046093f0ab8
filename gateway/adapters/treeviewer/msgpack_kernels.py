"""Count the values in a MessagePack message without the GIL and without creating Python objects.

``request_reader`` refuses a request with too many values before it decodes the request.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import I64, Address
from renderers.compiler.pointers import address_of, u8_at

TRUNCATED: Final = -1
UNUSED_BYTE: Final = -2
TRAILING_BYTES: Final = -3
UNUSED_FIRST_BYTE: Final = 0xC1
"""The only first byte that the specification leaves unused."""
TEXT_BYTES_PER_VALUE: Final = 64
"""A string counts as one value, and as one more for every 64 bytes."""
_LENGTH_BYTES, _PAYLOAD, _LENGTH, _CHILDREN, _TEXT = range(5)
"""Columns of the table ``_FORMATS``."""


def _describe_formats() -> NDArray[np.int64]:
    """Return the layout of a value for each first byte, (256, 5), from msgpack/spec.md.

    Columns: size in bytes of the length field that follows; payload bytes besides those that the length counts;
    length that the first byte contains; values per element of an array (1) or map (2), otherwise 0; 1 for a string.
    """
    formats = np.zeros((256, 5), np.int64)
    fix_map, fix_array, fix_string = slice(0x80, 0x90), slice(0x90, 0xA0), slice(0xA0, 0xC0)
    binary, extension, string = slice(0xC4, 0xC7), slice(0xC7, 0xCA), slice(0xD9, 0xDC)
    array, mapping = slice(0xDC, 0xDE), slice(0xDE, 0xE0)
    floats, unsigned, signed, fix_extension = slice(0xCA, 0xCC), slice(0xCC, 0xD0), slice(0xD0, 0xD4), slice(0xD4, 0xD9)
    formats[fix_map, _LENGTH] = formats[fix_array, _LENGTH] = range(16)
    formats[fix_string, _LENGTH] = range(32)
    formats[binary, _LENGTH_BYTES] = formats[extension, _LENGTH_BYTES] = formats[string, _LENGTH_BYTES] = 1, 2, 4
    formats[array, _LENGTH_BYTES] = formats[mapping, _LENGTH_BYTES] = 2, 4
    formats[extension, _PAYLOAD] = 1
    formats[floats, _PAYLOAD] = 4, 8
    formats[unsigned, _PAYLOAD] = formats[signed, _PAYLOAD] = 1, 2, 4, 8
    formats[fix_extension, _PAYLOAD] = 2, 3, 5, 9, 17
    formats[fix_array, _CHILDREN] = formats[array, _CHILDREN] = 1
    formats[fix_map, _CHILDREN] = formats[mapping, _CHILDREN] = 2
    formats[fix_string, _TEXT] = formats[string, _TEXT] = 1
    return formats


_FORMATS: Final = _describe_formats()


def count_values(message: NDArray[np.uint8], limit: int) -> int:
    """Return the number of values in a message, (N,) uint8, or any number above ``limit`` if there are more.

    Arrays, maps, and the keys and values in them count one each, and so does a binary or extension of any length. The
    result is TRUNCATED, UNUSED_BYTE or TRAILING_BYTES, all negative, if the message is not MessagePack.
    """
    count: int = _count_values(address_of(message, np.uint8), len(message), limit)
    return count


@kernel
def _count_values(message_at: Address, size: I64, limit: I64) -> I64:
    """Return the result of ``count_values``; ``size`` is the message's length in bytes."""
    data = u8_at(message_at)
    position = 0
    expected_values = 1  # still to be read
    count = 0
    while expected_values > 0:
        if position >= size:
            return TRUNCATED
        first_byte = data[position]
        position += 1
        expected_values -= 1
        count += 1
        if count > limit:
            return count
        if first_byte == UNUSED_FIRST_BYTE:
            return UNUSED_BYTE
        length = _FORMATS[first_byte, _LENGTH]
        length_bytes = _FORMATS[first_byte, _LENGTH_BYTES]
        if position + length_bytes > size:
            return TRUNCATED
        for k in range(length_bytes):
            length = (length << 8) | data[position + k]
        position += length_bytes
        children = _FORMATS[first_byte, _CHILDREN]
        if children:
            expected_values += length * children
        else:
            length += _FORMATS[first_byte, _PAYLOAD]
            if length > size - position:
                return TRUNCATED
            position += length
            if _FORMATS[first_byte, _TEXT]:
                count += length // TEXT_BYTES_PER_VALUE
        if expected_values > size - position:
            return TRUNCATED
    return count if position == size else TRAILING_BYTES
