"""Whether a PNG has all of its rows: Pillow draws those that are missing black, and says nothing."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import Final

_CHANNELS: Final = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""Samples of a pixel, by colour type (W3C PNG third edition, section 11.2.1)."""
_ADAM7: Final = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
"""First column and row, and steps, of the passes of an interlaced picture (section 8.1)."""
_HEADER_END: Final = 29
"""Of IHDR's values, which follow the signature (sections 5.2 and 11.2.1)."""
_STEP: Final = 1 << 18
"""Bytes that are inflated at a time: they are counted, not kept."""
_MAX_CHUNKS: Final = 1 << 18
"""That are looked at: a file may have millions of empty ones. Encoders write some kilobytes into each."""


def rows_are_missing(data: memoryview) -> bool:
    """Whether less is in the IDAT chunks than the header announces.

    Args:
        data: a PNG whose header was read; it may be damaged otherwise.
    """
    if len(data) < _HEADER_END:
        return True
    wanted = _row_bytes(data)
    for piece in _inflated(data):
        wanted -= piece
        if wanted <= 0:
            return False
    return wanted > 0


def _row_bytes(data: memoryview) -> int:
    """Of all rows with their filters' numbers (sections 7.2 and 9.2)."""
    width, height, depth, colour_type, _, _, interlaced = struct.unpack_from(">IIBBBBB", data, 16)
    bits = depth * _CHANNELS.get(colour_type, 0)
    total = 0
    for left, top, across, down in _ADAM7 if interlaced else ((0, 0, 1, 1),):
        columns, rows = -(-(width - left) // across), -(-(height - top) // down)
        if columns > 0 and rows > 0:
            total += rows * (1 + (columns * bits + 7) // 8)
    return total


def _inflated(data: memoryview) -> Iterator[int]:
    """Numbers of bytes that come out of the IDAT chunks, until these end or are damaged."""
    inflater = zlib.decompressobj()
    at = 8
    try:
        for _ in range(_MAX_CHUNKS):
            if at + 8 > len(data) or inflater.eof:
                break
            length, kind = struct.unpack_from(">I4s", data, at)
            if kind == b"IDAT":
                rest: bytes | memoryview = data[at + 8 : at + 8 + length]
                while rest and not inflater.eof:
                    yield len(inflater.decompress(rest, _STEP))
                    rest = inflater.unconsumed_tail
            at += 12 + length
        yield len(inflater.flush())  # the end of a repetition may wait for room
    except zlib.error:
        return
