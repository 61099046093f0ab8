"""Repairs PLY files that trimesh does not read in full."""

from __future__ import annotations

import itertools
import struct
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_CODES: Final = {
    "char": "b",
    "uchar": "B",
    "short": "h",
    "ushort": "H",
    "int": "i",
    "uint": "I",
    "float": "f",
    "double": "d",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "float32": "f",
    "float64": "d",
}
"""Codes of the scalar types in the modules ``struct`` and NumPy."""
_SIZES: Final = {name: struct.calcsize(f"<{code}") for name, code in _CODES.items()}


def with_line_feeds(data: bytes) -> bytes:
    """Return the file with line feeds in its header. Rhinoceros writes carriage returns only, which trimesh refuses."""
    line_end = b"\r\n" if data.startswith(b"ply\r\n") else b"\r"
    header, end, body = data.partition(b"end_header" + line_end)
    return header.replace(line_end, b"\n") + b"end_header\n" + body if end else data


def with_triangles(data: bytes) -> bytes:
    """Return a binary file with triangles in place of faces of different numbers of corners, such as Blender writes.

    Other properties of faces, and the elements after them, are left out. Other files are returned as they are.

    Raises:
        ValueError: The file is too short.
    """
    header, end, _ = data.partition(b"end_header\n")
    lines = header.decode("latin-1").splitlines()
    order = ">" if "format binary_big_endian 1.0" in lines else "<"
    first = next((i for i, line in enumerate(lines) if line.split()[:2] == ["element", "face"]), None)
    if first is None or not end or "format ascii 1.0" in lines:
        return data
    before = [line.split() for line in lines[:first]]
    count, start = 0, len(header) + len(end)
    for words in before:
        if words[:1] == ["element"]:
            count = int(words[2])
        elif words[:1] == ["property"]:
            start += count * _SIZES[words[1]]
    counts, places, index = _face_corners(data, start, [line.split() for line in lines[first:]], order)
    content = np.frombuffer(data, np.uint8)
    triangles = []
    for number in np.unique(counts[counts > 2]):
        width = np.arange(number * index.itemsize)
        corners = content[places[counts == number][:, None] + width].view(index)
        fan = [corners[:, [0, each, each + 1]] for each in range(1, number - 1)]
        triangles.append(np.concatenate(fan))
    rows = np.empty(sum(map(len, triangles)), [("count", "u1"), ("corners", f"{order}u4", 3)])
    rows["count"], rows["corners"] = 3, np.concatenate(triangles)
    faces = f"element face {len(rows)}\nproperty list uchar uint vertex_indices\nend_header\n"
    text = "\n".join((*lines[:first], faces)).encode("latin-1")
    return text + data[len(header) + len(end) : start] + rows.tobytes()


def _face_corners(
    data: bytes, place: int, element: list[list[str]], order: str
) -> tuple[NDArray[np.int64], NDArray[np.int64], np.dtype[Any]]:
    """Return the number of corners of each face, the place of its first index in the file, and the indices' type.

    Args:
        place: Place of the first face in the file.
        element: Words of the element's line, and of those after it.
    """
    properties = [words[1:] for words in itertools.takewhile(lambda words: words[:1] == ["property"], element[1:])]
    sizes = [
        (struct.Struct(order + _CODES[words[1]]), _SIZES[words[2]]) if words[0] == "list" else (None, _SIZES[words[0]])
        for words in properties
    ]
    is_indices = [words[-1] in ("vertex_index", "vertex_indices") for words in properties]
    code = next(words[2] for words, is_index in zip(properties, is_indices, strict=True) if is_index)
    counts, places = [], []
    try:
        for _ in range(int(element[0][2])):
            for (length, size), is_index in zip(sizes, is_indices, strict=True):
                number = 1
                if length is not None:
                    (number,) = length.unpack_from(data, place)
                    place += length.size
                if is_index:
                    counts.append(number)
                    places.append(place)
                place += number * size
    except struct.error:
        place = len(data) + 1
    if place > len(data) or min(counts, default=0) < 0:
        raise ValueError("it is shorter than its header says")
    return np.array(counts), np.array(places), np.dtype(order + _CODES[code])


def triangles_of_strips(metadata: dict[str, Any]) -> NDArray[np.int64] | None:
    """Return the (M, 3) triangles of an element ``tristrips``, as in scans of Stanford; None if there is none.

    Args:
        metadata: Metadata of the point cloud that trimesh reads. In a strip, an index of -1 starts the next one.
    """
    element = metadata.get("_ply_raw", {}).get("tristrips", {}).get("data")
    if element is None:
        return None
    lists = element["vertex_indices"]
    if getattr(lists, "dtype", np.dtype(int)).names:  # binary files: length and values
        lists = lists["f1"]
    strips = np.concatenate([np.append(np.asarray(each, np.int64), -1) for each in lists])
    place = np.arange(len(strips))
    in_strip = place - np.maximum.accumulate(np.where(strips == -1, place + 1, 0))
    triangles = np.column_stack((strips[:-2], strips[1:-1], strips[2:]))
    is_odd = in_strip[:-2] % 2 == 1
    triangles[is_odd] = triangles[is_odd][:, ::-1]
    whole: NDArray[np.int64] = triangles[(triangles != -1).all(axis=1)]
    return whole
