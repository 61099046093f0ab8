"""Repairs PLY files that trimesh does not read in full."""

from __future__ import annotations

import dataclasses
import struct
from array import array
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.files.parsers.mesh_data import triangles_of_polygons, triangles_of_strip

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
    "int64": "q",
    "uint64": "Q",
    "float16": "e",
    "float32": "f",
    "float64": "d",
}
"""Codes of the scalar types in the modules ``struct`` and NumPy."""
_INDEX_NAMES: Final = ("vertex_indices", "vertex_index")


@dataclass(frozen=True, slots=True)
class _Element:
    """An element of a header."""

    name: str
    count: int
    line: int
    """Place of its line in the header."""
    properties: list[tuple[struct.Struct | None, np.dtype[Any], str]] = field(default_factory=list)
    """Type of a list's length (None: no list), type of the values, and name."""

    def index_list(self) -> tuple[int, np.dtype[Any]]:
        """Return which of the element's lists holds indices of vertices, and their type. The only list has any name.

        Raises:
            ValueError: There is none.
        """
        lists = [(name, values) for length, values, name in self.properties if length is not None]
        for number, (name, values) in enumerate(lists):
            if values.kind in "iu" and (name in _INDEX_NAMES or len(lists) == 1):
                return number, values
        raise ValueError(f"its element {self.name!r} has no list 'vertex_indices' of integers")


def with_plain_header(data: bytes) -> bytes:
    """Return the file with a header that trimesh reads.

    Rhinoceros writes carriage returns only; comments are not always UTF-8. For edges, trimesh needs a package that is
    not installed, but does not use them in meshes: their element gets another name.

    Raises:
        ValueError: It is no PLY file.
    """
    if b"ply" not in data[:20].lower():
        raise ValueError("it does not start with 'ply'")
    line_end = b"\r\n" if data.startswith(b"ply\r\n") else b"\r" if data.startswith(b"ply\r") else b"\n"
    header, end, body = data.partition(b"end_header" + line_end)
    header = header.decode("utf-8", "replace").encode().replace(line_end, b"\n")
    header = header.replace(b"\nelement edge ", b"\nelement unused_edge ")
    return header + b"end_header\n" + body if end else data


def with_triangles(data: bytes) -> bytes:
    """Return a binary file with triangles in place of polygons and strips.

    Blender writes faces of different numbers of corners, which trimesh takes for faces like the first one. Other
    properties of faces, and the elements after them, are left out. Other files are returned as they are.

    Raises:
        ValueError: The header is wrong, or the file is too short.
    """
    header, end, _ = data.partition(b"end_header\n")
    lines = header.decode("latin-1").split("\n")
    encoding = next((line.lower() for line in lines if line.startswith("format")), "")
    order = ">" if "big" in encoding else "<"
    elements = _elements(lines, order)
    drawn = next(
        (each for name in ("face", "tristrips") for each in elements if each.name == name and each.count), None
    )
    if drawn is None or not end or "ascii" in encoding:
        return data
    start = place = len(header) + len(end)
    for element in elements[: elements.index(drawn)]:
        place = _lists(data, place, element)[2]
    index_list, index = drawn.index_list()
    if drawn.name == "face" and _are_small_and_equal(data, place, drawn, index_list):
        return data
    all_lengths, places, _ = _lists(data, place, drawn)
    lengths = all_lengths[:, index_list]
    indices = _indices(data, lengths, places[:, index_list], index)
    if drawn.name == "face":
        triangles = triangles_of_polygons(indices, np.cumsum(lengths) - lengths, lengths)
    else:
        triangles = triangles_of_strip(np.insert(indices, np.cumsum(lengths), -1))
    if not len(triangles):
        raise ValueError(f"its {drawn.count} elements {drawn.name!r} have no triangles")
    code, type_name = ("i4", "int") if index.kind == "i" else ("u4", "uint")
    rows = np.empty(len(triangles), [("count", "u1"), ("corners", order + code, 3)])
    rows["count"], rows["corners"] = 3, triangles
    faces = f"element face {len(rows)}\nproperty list uchar {type_name} vertex_indices\nend_header\n"
    text = "\n".join((*lines[: drawn.line], faces)).encode("latin-1")
    return text + data[start:place] + rows.tobytes()


def _elements(lines: list[str], order: str) -> list[_Element]:
    """Return the elements of a header; raises ValueError."""
    elements: list[_Element] = []
    for number, line in enumerate(lines):
        try:
            match line.split():
                case ["element", name, count]:
                    if not 0 <= int(count) < 1 << 63:
                        raise ValueError(count)
                    elements.append(_Element(name, int(count), number))
                case ["property", "list", length, values, name]:
                    if _CODES[length] in "efd":
                        raise ValueError(length)
                    counter = struct.Struct(order + _CODES[length])
                    elements[-1].properties.append((counter, np.dtype(order + _CODES[values]), name))
                case ["property", values, name]:
                    elements[-1].properties.append((None, np.dtype(order + _CODES[values]), name))
                case ["element" | "property", *_]:
                    raise ValueError(line)
        except (ValueError, KeyError, IndexError):
            raise ValueError(f"line {number + 1} of its header is wrong: {line[:60]!r}") from None
    return elements


def _lists(data: bytes, place: int, element: _Element) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Return the lengths of an element's lists, the places of their values, both (count, lists), and the element's end.

    Args:
        place: Place of the element's data in the file.

    Raises:
        ValueError: The file is too short, or a length is negative.
    """
    lists = sum(length is not None for length, _, _ in element.properties)
    lengths, places = array("q"), array("q")
    too_short = ValueError("it is shorter than its header says")
    if not lists:
        place += element.count * sum(values.itemsize for _, values, _ in element.properties)
    try:
        for _ in range(element.count if lists else 0):  # each list takes a byte or more, so the data ends this
            for length, values, _ in element.properties:
                number = 1
                if length is not None:
                    (number,) = length.unpack_from(data, place)
                    place += length.size
                    if number < 0:
                        raise ValueError(f"a list of its element {element.name!r} has a length of {number}")
                    if place + number * values.itemsize > len(data):
                        raise too_short
                    lengths.append(number)
                    places.append(place)
                place += number * values.itemsize
    except struct.error:
        raise too_short from None
    if place > len(data):
        raise too_short
    shape = (-1, max(lists, 1))
    return np.array(lengths, np.int64).reshape(shape), np.array(places, np.int64).reshape(shape), place


def _are_small_and_equal(data: bytes, place: int, faces: _Element, index_list: int) -> bool:
    """Return True if trimesh reads all faces: up to four corners, and each list as long as that of the first face."""
    lengths, places, end = _lists(data, place, dataclasses.replace(faces, count=1))
    if lengths[0, index_list] > 4 or place + faces.count * (end - place) > len(data):
        return False
    counters = [length for length, _, _ in faces.properties if length is not None]
    row = np.dtype({
        "names": list(map(str, range(len(counters)))),
        "formats": [counter.format for counter in counters],
        "offsets": [at - place - counter.size for at, counter in zip(places[0].tolist(), counters, strict=True)],
        "itemsize": end - place,
    })  # fmt: skip
    rows = np.frombuffer(data, row, faces.count, place)
    return all((rows[name] == rows[name][0]).all() for name in row.names or ())


def _indices(
    data: bytes, lengths: NDArray[np.int64], places: NDArray[np.int64], index: np.dtype[Any]
) -> NDArray[np.int64]:
    """Return the values of lists of these lengths, one after the other, whose first values are at these places."""
    first = np.repeat(places - (np.cumsum(lengths) - lengths) * index.itemsize, lengths)
    value_places = first + np.arange(len(first)) * index.itemsize
    raw = np.frombuffer(data, np.uint8)[value_places[:, None] + np.arange(index.itemsize)]
    return np.asarray(raw.view(index)[:, 0], np.int64)


def triangles_of_strips(metadata: dict[str, Any]) -> NDArray[np.int64] | None:
    """Return the (M, 3) triangles of an element ``tristrips`` of an ASCII file; None if there is none.

    Args:
        metadata: Metadata of the point cloud that trimesh reads.

    Raises:
        ValueError: The element has no list of vertices.
    """
    element = metadata.get("_ply_raw", {}).get("tristrips", {}).get("data")
    if not isinstance(element, dict):
        return None
    lists = next((element[name] for name in _INDEX_NAMES if name in element), None)
    if lists is None:
        raise ValueError("its element 'tristrips' has no list 'vertex_indices'")
    return triangles_of_strip(np.concatenate([np.append(np.asarray(each, np.int64), -1) for each in lists]))
