"""Reads the size of a Draco mesh from the start of its data, before memory for it is allocated."""

from __future__ import annotations

from typing import Final

_MAGIC: Final = b"DRACO\x02\x02\x01"
"""Start of a mesh in version 2.2 of the format, the only one that glTF allows."""
_HAS_METADATA: Final = 0x8000
_SEQUENTIAL: Final = 0
_MAX_METADATA_DEPTH: Final = 32


class DracoError(ValueError):
    """The data is not a Draco mesh."""


def element_counts(data: bytes) -> tuple[int, int]:
    """Return the numbers of vertices and triangles that a Draco mesh claims to have.

    In edge-breaker streams, vertices that differ only in attributes other than the position are counted once.

    Raises:
        DracoError: The data is truncated, or not a mesh of version 2.2.
    """
    if not data.startswith(_MAGIC):
        raise DracoError("not a Draco mesh of version 2.2")
    reader = _Reader(data, len(_MAGIC))
    method = reader.byte()
    flags = reader.byte() | reader.byte() << 8
    if flags & _HAS_METADATA:
        for _ in range(reader.varint()):
            reader.varint()  # id of the attribute
            _skip_metadata(reader, 0)
        _skip_metadata(reader, 0)
    if method == _SEQUENTIAL:
        triangles = reader.varint()
        return reader.varint(), triangles
    reader.byte()  # type of traversal
    vertices = reader.varint()
    return vertices, reader.varint()


def _skip_metadata(reader: _Reader, depth: int) -> None:
    if depth > _MAX_METADATA_DEPTH:
        raise DracoError("its metadata is nested too deeply")
    for _ in range(reader.varint()):
        reader.skip(reader.byte())  # name
        reader.skip(reader.varint())  # value
    for _ in range(reader.varint()):
        reader.skip(reader.byte())
        _skip_metadata(reader, depth + 1)


class _Reader:
    """Reads numbers from bytes, one after the other."""

    def __init__(self, data: bytes, position: int) -> None:
        self._data = data
        self._position = position

    def byte(self) -> int:
        self.skip(1)
        return self._data[self._position - 1]

    def skip(self, count: int) -> None:
        self._position += count
        if self._position > len(self._data):
            raise DracoError("the data is truncated")

    def varint(self) -> int:
        """Read an unsigned LEB128 number of at most 5 bytes."""
        value = 0
        for shift in range(0, 35, 7):
            byte = self.byte()
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
        raise DracoError("a number has more than 5 bytes")
