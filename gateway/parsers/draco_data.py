"""Decompressed Draco meshes: what the child process of ``draco`` sends to the program."""

from __future__ import annotations

import msgspec


class DecodedAttribute(msgspec.Struct):
    """An attribute of a mesh."""

    unique_id: int
    dtype: str
    """Name of the NumPy data type."""
    components: int
    data: bytes
    """Values, (number of vertices, components)."""


class DecodedMesh(msgspec.Struct):
    """A decompressed mesh."""

    triangles: bytes
    """(M, 3) uint32, vertex indices."""
    attributes: list[DecodedAttribute]
