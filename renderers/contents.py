"""What equal bytes are looked up by. Whoever finds some compares them: neither key proves anything."""

from __future__ import annotations

from typing import Final

from isal import isal_zlib

_PIECE: Final = 1 << 10
_PIECES: Final = 8
_SHORT: Final = 2 * _PIECES * _PIECE
"""Bytes up to which a checksum of everything costs as little."""


def quick_key(data: bytes | memoryview) -> int:
    """Length and a checksum of eight pieces, the first and the last bytes among them: a checksum of 25 MB of pictures
    costs more than all else that a reader does with them. Not negative.

    Args:
        data: a memoryview of bytes, contiguous.
    """
    length = len(data)
    if length <= _SHORT:
        return length << 32 | isal_zlib.crc32(data)
    view, checksum = memoryview(data), 0
    step = (length - _PIECE) // (_PIECES - 1)
    for begin in (*range(0, (_PIECES - 1) * step, step), length - _PIECE):
        checksum = isal_zlib.crc32(view[begin : begin + _PIECE], checksum)
    return length << 32 | checksum


def whole_key(data: bytes | memoryview) -> int:
    """Length and a checksum of everything, for contents whose ``quick_key`` others have. Negative."""
    return ~(len(data) << 32 | isal_zlib.crc32(data))
