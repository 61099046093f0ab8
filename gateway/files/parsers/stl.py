"""Reads STL files, text and binary, with the colours that some programs keep in the two spare bytes of a triangle."""

import re
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.files.parsers.mesh_data import MeshFaultError

_TRIANGLE: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("color", "<u2")])
_HEADER_BYTES: Final = 80
_DATA_BYTE: Final = 84
_VERTEX: Final = re.compile(rb"(?i)\bvertex\s+((?:(?:[-+.\d]|nan|inf)\S*\s+){2}\S+)")
_TEXT: Final = re.compile(rb"(?im)^[^\w\n]*(?:solid|facet\s)")
"""Start of text, which may have a byte order mark, or comments before it."""
_TEXT_BYTES: Final = 1024
"""Bytes in which text begins."""
_WITHOUT_OWN_COLOR: Final = (0, 0x8000, 0xFFFF)
"""Spare bytes of triangles that have the object's colour, in files of Magics."""


def read_stl(
    data: bytes, max_triangles: int, warnings: list[str]
) -> tuple[NDArray[np.float32] | NDArray[np.float64], NDArray[np.uint8] | None]:
    """Return the corners of all triangles, (3 M, 3) in the file's unit, and their sRGB colours, (3 M, 4), or None.

    Raises MeshFaultError if there are none, or too many.
    """
    stated = int.from_bytes(data[_HEADER_BYTES:_DATA_BYTE], "little")
    is_text = len(data) != _DATA_BYTE + _TRIANGLE.itemsize * stated and _TEXT.search(data, 0, _TEXT_BYTES) is not None
    vertices: list[bytes] = _VERTEX.findall(data) if is_text else []
    count, rest = divmod(max(len(data) - _DATA_BYTE, 0), _TRIANGLE.itemsize)
    if vertices:
        count = len(vertices) // 3
    elif stated or rest:  # it may be 0 in a file that was written in one go
        if stated > count:
            warnings.append(f"it ends after {count} of {stated} triangles")
        count = min(count, stated)
    if not count:
        raise MeshFaultError("it has no triangles")
    if count > max_triangles:
        raise MeshFaultError(f"it has {count} triangles, the limit is {max_triangles}")
    if vertices:
        try:
            numbers = np.array(b" ".join(vertices[: 3 * count]).split(), np.float64)
        except ValueError:
            raise MeshFaultError("it has a number that cannot be read") from None
        return numbers.reshape(-1, 3), None
    triangles = np.frombuffer(data, _TRIANGLE, count, _DATA_BYTE)
    colors = _colors(data[:_HEADER_BYTES], triangles["color"])
    return triangles["corners"].reshape(-1, 3), None if colors is None else colors.repeat(3, axis=0)


def _colors(header: bytes, spare: NDArray[np.uint16]) -> NDArray[np.uint8] | None:
    """Return the sRGB colours of triangles, (M, 4), with 5 bits a channel; None if the file has none.

    Magics has the object's colour in the header, and red in the low bits. VisCAM has blue there, and sets the highest
    bit of those that have a colour.
    """
    _, magics, rest = header.partition(b"COLOR=")
    has_own = ~np.isin(spare, _WITHOUT_OWN_COLOR) if magics else spare >= 0x8000
    if not magics and not has_own.any():
        return None
    shifts = np.array((0, 5, 10) if magics else (10, 5, 0), np.uint16)
    own = np.rint((spare[:, None] >> shifts & 31) * (255.0 / 31.0))
    others = np.frombuffer(rest[:3].ljust(3, b"\xff"), np.uint8) if magics else np.full(3, 255)
    colors = np.full((len(spare), 4), 255, np.uint8)
    colors[:, :3] = np.where(has_own[:, None], own, others)
    return colors
