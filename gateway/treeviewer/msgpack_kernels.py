"""Count the values in a MessagePack message without the GIL and without making objects."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.jit import kernel
from renderers.compiler.pending import wait_until_compiled
from renderers.compiler.pointers import address_of, u8_at

TRUNCATED: Final = -1
MALFORMED: Final = -2
TRAILING_BYTES: Final = -3
NEVER_USED: Final = 0xC1
"""The only first byte without a meaning."""
_LENGTH_BYTES, _PAYLOAD, _COUNT, _CHILDREN, _TEXT = range(5)
TEXT_BYTES_PER_VALUE: Final = 64
"""A string counts as one more value for each of these bytes."""


def _formats() -> NDArray[np.int64]:
    """Return the table of first bytes, from msgpack/spec.md.

    Columns: bytes of the length that follows, fixed bytes of payload, length in the first byte, values per counted
    element, 1 for a string.
    """
    formats = np.zeros((256, 5), np.int64)
    formats[0x80:0x90, _COUNT] = formats[0x90:0xA0, _COUNT] = range(16)
    formats[0xA0:0xC0, _COUNT] = range(32)
    formats[0xC4:0xC7, _LENGTH_BYTES] = formats[0xC7:0xCA, _LENGTH_BYTES] = formats[0xD9:0xDC, _LENGTH_BYTES] = 1, 2, 4
    formats[0xDC:0xDE, _LENGTH_BYTES] = formats[0xDE:0xE0, _LENGTH_BYTES] = 2, 4
    formats[0xC7:0xCA, _PAYLOAD] = 1
    formats[0xCA:0xCC, _PAYLOAD] = 4, 8
    formats[0xCC:0xD0, _PAYLOAD] = formats[0xD0:0xD4, _PAYLOAD] = 1, 2, 4, 8
    formats[0xD4:0xD9, _PAYLOAD] = 2, 3, 5, 9, 17
    formats[0x90:0xA0, _CHILDREN] = formats[0xDC:0xDE, _CHILDREN] = 1
    formats[0x80:0x90, _CHILDREN] = formats[0xDE:0xE0, _CHILDREN] = 2
    formats[0xA0:0xC0, _TEXT] = formats[0xD9:0xDC, _TEXT] = 1
    return formats


_FORMATS: Final = _formats()


def count_values(message: NDArray[np.uint8], limit: int) -> int:
    """Return the number of values in a message, or a number above ``limit`` as soon as there are more.

    Arrays, maps and their members count; binaries and extensions count as one value of any length. Negative:
    TRUNCATED, MALFORMED or TRAILING_BYTES.

    Args:
        message: (N,) uint8.
    """
    wait_until_compiled("formats")
    count: int = _count_values(address_of(message, np.uint8), len(message), limit)
    return count


@kernel("int64(int64, int64, int64)")
def _count_values(message_at, size, limit):
    """Return the result of ``count_values``."""
    data = u8_at(message_at)
    position = 0
    pending = 1
    found = 0
    while pending > 0:
        if position >= size:
            return TRUNCATED
        first = data[position]
        position += 1
        pending -= 1
        found += 1
        if found > limit:
            return found
        if first == NEVER_USED:
            return MALFORMED
        length = _FORMATS[first, _COUNT]
        length_bytes = _FORMATS[first, _LENGTH_BYTES]
        if position + length_bytes > size:
            return TRUNCATED
        for k in range(length_bytes):
            length = (length << 8) | data[position + k]
        position += length_bytes
        children = _FORMATS[first, _CHILDREN]
        if children:
            pending += length * children
        else:
            length += _FORMATS[first, _PAYLOAD]
            if length > size - position:
                return TRUNCATED
            position += length
            if _FORMATS[first, _TEXT]:
                found += length // TEXT_BYTES_PER_VALUE
        if pending > size - position:
            return TRUNCATED
    return found if position == size else TRAILING_BYTES
