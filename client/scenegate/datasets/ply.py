"""PLY files of the models of datasets: binary, with vertices and triangles."""

import re
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from scenegate.datasets.manifest import RecordError
from scenegate.regular_files import errors_as, read_regular

_HEADER: Final = re.compile(
    rb"ply\nformat binary_little_endian 1\.0\n(?:comment [^\n]*\n)*element vertex (?P<vertices>\d{1,9})\n"
    rb"property float x\nproperty float y\nproperty float z\nelement face (?P<faces>\d{1,9})\n"
    rb"property list uchar int vertex_ind(?:ices|ex)\nend_header\n"
)
"""Header of the models of datasets."""
_VERTEX: Final = np.dtype([("position", "<f4", 3)])
_FACE: Final = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


def read_ply(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return vertices, (N, 3) metres, and triangles, (M, 3), of a dataset's model. Raises RecordError for others."""
    with errors_as(RecordError, path):
        data = read_regular(path)
    match = _HEADER.match(data)
    if match is None:
        raise RecordError(f"{path}: not a binary PLY file with vertices and triangles as datasets have them")
    vertex_count, face_count = int(match["vertices"]), int(match["faces"])
    vertex_bytes = vertex_count * _VERTEX.itemsize
    if vertex_count < 1 or len(data) != match.end() + vertex_bytes + face_count * _FACE.itemsize:
        raise RecordError(f"{path}: cut off, or without vertices")
    points = np.frombuffer(data, _VERTEX, vertex_count, match.end())["position"]
    faces = np.frombuffer(data, _FACE, face_count, match.end() + vertex_bytes)
    corners = faces["corners"].astype(np.int32)
    if (faces["count"] != 3).any() or (corners < 0).any() or (corners >= vertex_count).any():
        raise RecordError(f"{path}: a face is not a triangle of its vertices")
    return points.astype(np.float64), corners


def encode_ply(
    vertices: NDArray[np.floating],
    triangles: NDArray[np.integer],
    unit: str,
    normals: NDArray[np.floating] | None = None,
) -> bytes:
    """Return a PLY file of (N, 3) vertices and (M, 3) triangles, with a comment that names the unit."""
    columns = vertices if normals is None else np.hstack((vertices, normals))
    names = ("x", "y", "z", "nx", "ny", "nz")[: columns.shape[1]]
    properties = "".join(f"property float {name}\n" for name in names)
    header = (
        f"ply\nformat binary_little_endian 1.0\ncomment {unit}\nelement vertex {len(vertices)}\n{properties}"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(triangles), _FACE)
    faces["count"], faces["corners"] = 3, triangles
    return header.encode() + columns.astype("<f4").tobytes() + faces.tobytes()
