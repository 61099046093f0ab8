"""Binary little-endian PLY in the vendor's layout, with colours that other loaders read, too."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_TYPES = {np.dtype("<f4"): "float32", np.dtype("u1"): "uint8"}


def vertex_dtype(*, textured: bool) -> np.dtype[np.void]:
    """Return the packed vertex type: x, y, z and scan_size, followed by the colours.

    Args:
        textured: add the colours twice: as diffuse_red, diffuse_green, diffuse_blue, which the vendor's programs read,
            and as red, green, blue, which trimesh, Open3D and most others read.
    """
    fields: list[tuple[str, str]] = [(name, "<f4") for name in ("x", "y", "z", "scan_size")]
    if textured:
        fields += [(prefix + name, "u1") for prefix in ("diffuse_", "") for name in ("red", "green", "blue")]
    return np.dtype(fields)


FACE = np.dtype([("count", "u1"), ("indices", "<u4", (3,))])
"""Packed triangle: 3, then three vertex indices."""


def ply_parts(vertices: NDArray[np.void], faces: NDArray[np.void]) -> tuple[bytes, memoryview, memoryview]:
    """Return header, vertices and faces, whose concatenation is the file.

    Args:
        vertices: (N,) ``vertex_dtype``.
        faces: (M,) ``FACE``.
    """
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        "comment Created with Scenegate",
        "comment Origin 0 0 0",
        "comment Camera [1 0 0; 0 1 0; 0 0 1] [0 0 0]",
        f"element vertex {len(vertices)}",
    ]
    names = vertices.dtype.names or ()
    lines += [f"property {_TYPES[vertices.dtype[name]]} {name}" for name in names]
    lines += [f"element face {len(faces)}", "property list uint8 uint32 vertex_indices", "end_header", ""]
    header = "\n".join(lines).encode("ascii")
    return header, _bytes_of(vertices), _bytes_of(faces)


def _bytes_of(records: NDArray[np.void]) -> memoryview:
    return records.view(np.uint8).reshape(-1).data if len(records) else memoryview(b"")
