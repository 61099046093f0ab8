"""A compiled walk over MessagePack that runs without the interpreter's lock and makes nothing."""

from __future__ import annotations

from typing import Final

from numba import types

from renderers.compiler.cache_locator import cached_njit

_BYTES = types.Array(types.uint8, 1, "C", readonly=True)

TRUNCATED: Final = -1
MALFORMED: Final = -2
LONGER: Final = -3


@cached_njit(types.int64(_BYTES, types.int64, types.int64), nogil=True)
def _word(data, at, size):
    """A big-endian number of ``size`` bytes."""
    value = 0
    for k in range(size):
        value = (value << 8) | data[at + k]
    return value


@cached_njit(types.int64(_BYTES, types.int64), nogil=True)
def objects(data, most):
    """How many values one MessagePack value consists of; more than ``most``: there are more than that many.

    Negative: TRUNCATED, MALFORMED or LONGER. Strings, binaries and extensions count as one, whatever their length
    (which counts for strings once more for every 64 bytes). Source of the format: msgpack/spec.md.
    """
    size = len(data)
    at = 0
    pending = 1
    found = 0
    while pending > 0:
        if at >= size:
            return TRUNCATED
        kind = data[at]
        at += 1
        pending -= 1
        found += 1
        if found > most:
            return found
        head = 0  # bytes of a length
        skipped = 0  # bytes of a value
        per = 0  # values a counted element stands for
        text = False
        count = 0
        if kind <= 0x7F or kind >= 0xE0 or kind == 0xC0 or kind == 0xC2 or kind == 0xC3:
            continue
        if kind <= 0x8F:
            count, per = kind & 0x0F, 2
        elif kind <= 0x9F:
            count, per = kind & 0x0F, 1
        elif kind <= 0xBF:
            skipped, text = kind & 0x1F, True
        elif kind == 0xC1:
            return MALFORMED
        elif kind <= 0xC6:
            head = 1 << (kind - 0xC4)
        elif kind <= 0xC9:
            head, skipped = 1 << (kind - 0xC7), 1
        elif kind == 0xCA:
            skipped = 4
        elif kind == 0xCB:
            skipped = 8
        elif kind <= 0xD3:
            skipped = 1 << ((kind - 0xCC) & 3)
        elif kind <= 0xD8:
            skipped = 1 + (1 << (kind - 0xD4))
        elif kind <= 0xDB:
            head, text = 1 << (kind - 0xD9), True
        elif kind <= 0xDD:
            head, per = 2 << (kind - 0xDC), 1
        else:
            head, per = 2 << (kind - 0xDE), 2
        if head:
            if at + head > size:
                return TRUNCATED
            length = _word(data, at, head)
            at += head
            if per:
                count = length
            else:
                skipped += length
        if skipped > size - at:
            return TRUNCATED
        at += skipped
        pending += count * per
        if text:
            found += skipped >> 6
        if pending > size - at:
            return TRUNCATED
    return found if at == size else LONGER
