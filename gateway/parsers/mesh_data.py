"""Content of a mesh file: what a parser's child process sends to the program."""

from __future__ import annotations

import msgspec


class MeshLimits(msgspec.Struct, frozen=True):
    """Limits of a mesh file's content. The names are those of ``GltfLimits``."""

    max_vertices: int
    max_elements: int
    max_instances: int
    max_drawn_elements: int
    max_node_depth: int


class Shape(msgspec.Struct):
    """Vertices with one material: triangles, or points."""

    positions: bytes
    """(N, 3) float32, finite for triangles."""
    triangles: bytes | None
    """(M, 3) uint32, each below N; None: it is a point cloud."""
    normals: bytes | None = None
    """(N, 3) float32 of unit length, or zero; None: the file has none."""
    uv: bytes | None = None
    """(N, 2) float32; (0, 0) is the image's top left corner."""
    colors: bytes | None = None
    """(N, 4) uint8, sRGB and opacity."""
    color: tuple[float, float, float, float] | None = None
    """Diffuse colour, sRGB and opacity, not clipped; None: the file has no material."""
    image: int | None = None
    """Index of the texture in ``MeshData.images``."""


class MeshData(msgspec.Struct):
    """Shapes and their instances."""

    shapes: list[Shape] = msgspec.field(default_factory=list)
    images: list[tuple[str, bytes]] = msgspec.field(default_factory=list)
    """Name of a texture in the mesh file, and its PNG, JPEG or WebP file: not decoded, and perhaps damaged."""
    instances: list[tuple[int, bytes]] = msgspec.field(default_factory=list)
    """Index of a shape, and its (4, 4) float64 transform, which includes the unit and up axis of a COLLADA file."""
    warnings: list[str] = msgspec.field(default_factory=list)
    """Sentences about content that was left out or repaired."""


class MeshFaultError(ValueError):
    """Raised by parsers: a file cannot be used."""
