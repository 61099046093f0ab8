"""Repairs PLY files that trimesh does not read in full."""

import contextlib
import dataclasses
import re
import struct
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.files.parsers.polygons import triangles_of_polygons, triangles_of_strip

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
_TYPE_NAMES: Final = {np.dtype(code).str[1:]: name for name, code in _CODES.items()}
"""Names of types by NumPy's, without the byte order."""
_INDEX_NAMES: Final = ("vertex_indices", "vertex_index")
_COLOR_NAMES: Final = (
    ("red", "green", "blue", ("alpha",)),
    ("diffuse_red", "diffuse_green", "diffuse_blue", ("diffuse_alpha", "alpha")),
    ("r", "g", "b", ("a", "alpha")),
    ("diffuse_r", "diffuse_g", "diffuse_b", ("diffuse_a", "alpha")),
)
"""Properties of colours in lower case: red, green, blue, and names of the opacity."""
_ANY_COLOR: Final = re.compile(rb"^property \w+ (?i:diffuse_red|diffuse_r|red|r)[ \t]*$", re.MULTILINE)
_TEXTURE_COORDINATE: Final = re.compile(
    rb"^(property (?:list \w+ )?\w+ )(s|t|u|v|texture_u|texture_v|texcoord)[ \t]*$", re.MULTILINE
)
_TEXTURE_FILE: Final = re.compile(rb"texturefile[ \t]*([^\n]*)", re.IGNORECASE)
_ONLY_FACE_LIST: Final = re.compile(
    rb"(\nelement face [^\n]*\n(?:(?!element|property list)[^\n]*\n)*property list \w+ \w+ )\w+"
    rb"(?=\n(?:(?!element|property list)[^\n]*\n)*(?:element|\Z))"
)
_EDGES: Final = re.compile(rb"^element unused_edge ([1-9]\d*)[ \t]*$", re.MULTILINE)
_FACES: Final = re.compile(rb"^element (?:face|tristrips) [1-9]", re.MULTILINE)
_SPLAT: Final = re.compile(rb"^property \w+ f_dc_0[ \t]*$", re.MULTILINE)


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
        """Return the list of indices of vertices, any name if it is the only one, and its type. Raises ValueError."""
        list_count = sum(length is not None for length, _, _ in self.properties)
        for number, (length, values, name) in enumerate(self.properties):
            if length is not None and values.kind in "iu" and (name in _INDEX_NAMES or list_count == 1):
                return number, values
        raise ValueError(f"its element {self.name!r} has no list 'vertex_indices' of integers")


def with_plain_header(data: bytes) -> bytes:
    """Return the file with a header that trimesh reads. Raises ValueError if it is no PLY file.

    Rhinoceros writes carriage returns only; comments are not always UTF-8. For edges, trimesh needs a package that is
    not installed, but does not use them in meshes: their element gets another name. Properties are in lower case, and
    the only list of faces is called ``vertex_indices``.
    """
    if b"ply" not in data[:20].lower():
        raise ValueError("it does not start with 'ply'")
    line_end = b"\r\n" if data.startswith(b"ply\r\n") else b"\r" if data.startswith(b"ply\r") else b"\n"
    header, end, body = data.partition(b"end_header" + line_end)
    header = header.decode("utf-8", "replace").encode().replace(line_end, b"\n")
    lines = (
        b" ".join(line.split()).lower() if line.lstrip().startswith((b"element", b"property")) else line
        for line in header.split(b"\n")
    )
    header = b"\n".join(lines).replace(b"\nelement edge ", b"\nelement unused_edge ")
    if b"\nproperty uint packed_position" in header:
        raise ValueError("it is a compressed Gaussian splat (packed_position); of a plain one, the centres are drawn")
    header = _ONLY_FACE_LIST.sub(rb"\1vertex_indices", header)
    return header + b"end_header\n" + body if end else data


def with_used_coordinates(data: bytes, read_texture: Callable[[str], bytes], warnings: list[str]) -> bytes:
    """Return the file without texture coordinates that would replace its colours, although it has no texture.

    trimesh reads either colours or texture coordinates; Blender writes both. A warning is added if the file holds
    Gaussians, or edges without faces.
    """
    header, end, body = data.partition(b"end_header\n")
    if (edges := _EDGES.search(header)) and not _FACES.search(header):
        warnings.append(f"its {edges[1].decode()} edges are not drawn, only their ends")
    if _SPLAT.search(header):
        warnings.append(
            "it is a Gaussian splat (f_dc_0 …): its centres are drawn as points, without its Gaussians and colours"
        )
    texture_count = len({name.strip() for name in _TEXTURE_FILE.findall(header)})
    if texture_count > 1:
        warnings.append(f"it has {texture_count} textures, the last is drawn on all faces")
    if not _ANY_COLOR.search(header):
        return data
    texture = _TEXTURE_FILE.search(header)
    if texture is not None:
        with contextlib.suppress(OSError):
            read_texture(texture[1].strip().decode())
            return data
    return _TEXTURE_COORDINATE.sub(rb"\1unused_\2", header) + end + body


def with_triangles(data: bytes) -> bytes:
    """Return a binary file with triangles in place of polygons and strips. Raises ValueError if it is damaged.

    trimesh takes each list for one as long as the first. Blender writes faces of different numbers of corners. If lists
    of an element differ in length, the file is returned with vertices and triangles only, without other lists than
    ``texcoord``.
    """
    header, end, _ = data.partition(b"end_header\n")
    lines = header.decode("latin-1").split("\n")
    encoding = next((line.lower() for line in lines if line.startswith("format")), "")
    order = ">" if "big" in encoding else "<"
    elements = _elements(lines, order)
    if not elements or not end or "ascii" in encoding:
        return data
    drawn = next(
        (each for name in ("face", "tristrips") for each in elements if each.name == name and each.count), None
    )
    if drawn is not None:
        drawn.index_list()  # raises
    is_plain = drawn is None or drawn.name == "face"
    places, unequal = [len(header) + len(end)], {}
    for element in elements:
        end_place = _end_of_equal_rows(data, places[-1], element, 4 if element is drawn else None)
        if end_place is None:
            is_plain = False
            unequal[element.name] = _values(data, places[-1], element)
            end_place = unequal[element.name][2]
        places.append(end_place)
    if is_plain:
        return data
    text, body = "\n".join(lines[: elements[0].line]), b""
    positions = np.zeros((0, 3))
    for element, place in zip(elements, places, strict=False):
        if element is drawn or element.name == "vertex":
            lengths, starts, _ = unequal.get(element.name) or _values(data, place, element)
            columns = _scalars(data, place, element, lengths, starts)
            if element is drawn:
                columns = _triangles(data, element, lengths, starts, positions, columns, order)
            elif {"x", "y", "z"} <= dict(columns).keys():
                positions = np.column_stack([dict(columns)[axis] for axis in "xyz"])
            element_text, rows = _table("face" if element is drawn else "vertex", columns)
            text, body = f"{text}\n{element_text}", body + rows
    return f"{text}\nend_header\n".encode("latin-1") + body


def _triangles(
    data: bytes,
    element: _Element,
    all_lengths: NDArray[np.int64],
    places: NDArray[np.int64],
    positions: NDArray[np.floating[Any]],
    scalars: list[tuple[str, NDArray[Any]]],
    order: str,
) -> list[tuple[str, NDArray[Any]]]:
    """Return names and values of the triangles' properties: ``vertex_indices``, (M, 3), perhaps ``texcoord`` with the
    coordinates of their corners, (M, 6), and the scalars of faces, (M,).

    Lengths and places are those of ``_values``, ``positions`` of the vertices. Raises ValueError if there are none.
    """
    index_list, index = element.index_list()
    lengths = all_lengths[:, index_list]
    indices = _array(data, lengths, places[:, index_list], index).astype(np.int64)
    lists: list[tuple[str, NDArray[Any]]] = []
    if element.name == "face":
        starts, corners = np.cumsum(lengths) - lengths, np.arange(len(indices))
        of_corners = positions[np.clip(indices, 0, len(positions) - 1)] if len(positions) else np.zeros((0, 3))
        corners = triangles_of_polygons(corners, starts, lengths, of_corners)
        triangles = indices[corners]
        face = np.repeat(np.arange(len(lengths)), np.maximum(lengths - 2, 0))
        scalars = [(name, values[face]) for name, values in scalars]
        for number, (_, values, name) in enumerate(element.properties):
            if name == "texcoord" and (all_lengths[:, number] == 2 * lengths).all():
                uv = _array(data, all_lengths[:, number], places[:, number], values).reshape(-1, 2)
                lists = [(name, uv[corners].reshape(-1, 6))]
    else:
        triangles, scalars = triangles_of_strip(np.insert(indices, np.cumsum(lengths), -1)), []
    if not len(triangles):
        raise ValueError(f"its {element.count} elements {element.name!r} have no triangles")
    return [("vertex_indices", triangles.astype(f"{order}{index.kind}4")), *lists, *scalars]


def _scalars(
    data: bytes, place: int, element: _Element, lengths: NDArray[np.int64], places: NDArray[np.int64]
) -> list[tuple[str, NDArray[Any]]]:
    """Return names and values, (count,), of the properties of an element at a place that are not lists.

    Lengths and places are those of ``_values``, empty if it has no lists.
    """
    if not len(lengths):
        row = np.dtype([(f"f{number}", values) for number, (_, values, _) in enumerate(element.properties)])
        rows = np.frombuffer(data, row, element.count, place)
        return [(name, rows[f"f{number}"]) for number, (_, _, name) in enumerate(element.properties)]
    return [
        (name, _array(data, lengths[:, number], places[:, number], values))
        for number, (length, values, name) in enumerate(element.properties)
        if length is None
    ]


def _table(element: str, columns: list[tuple[str, NDArray[Any]]]) -> tuple[str, bytes]:
    """Return the header and the binary rows of an element. A column (M, N) is a list."""
    header, fields = [f"element {element} {len(columns[0][1])}"], []
    for name, values in columns:
        kind = _TYPE_NAMES[values.dtype.str[1:]]
        header.append(f"property {f'list uchar {kind}' if values.ndim == 2 else kind} {name}")
        fields += [np.full(len(values), values.shape[1], np.uint8), values] if values.ndim == 2 else [values]
    rows = np.empty(len(columns[0][1]), [("", values.dtype, values.shape[1:]) for values in fields])
    for number, values in enumerate(fields):
        rows[f"f{number}"] = values
    return "\n".join(header), rows.tobytes()


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


def _values(data: bytes, place: int, element: _Element) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Return the numbers of values of an element with lists, their places, both (count, properties), and its end.

    Raises ValueError if the file is too short, or a length is negative.
    """
    has_lists = any(length is not None for length, _, _ in element.properties)
    lengths, places = array("q"), array("q")
    too_short = ValueError("it is shorter than its header says")
    if not has_lists:
        place += element.count * sum(values.itemsize for _, values, _ in element.properties)
    try:
        for _ in range(element.count if has_lists else 0):  # each list takes a byte or more, so the data ends this
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
    shape = (-1, max(len(element.properties), 1))
    return np.array(lengths, np.int64).reshape(shape), np.array(places, np.int64).reshape(shape), place


def _end_of_equal_rows(data: bytes, place: int, element: _Element, max_length: int | None) -> int | None:
    """Return the end of an element whose lists are as long as in its first row; None for others.

    ``max_length``: of its list of vertices.
    """
    if all(length is None for length, _, _ in element.properties):
        return _values(data, place, element)[2]
    lengths, places, end = _values(data, place, dataclasses.replace(element, count=min(element.count, 1)))
    if not len(lengths):
        return place
    lists = [
        (length.format, at - place - length.size)
        for (length, _, _), at in zip(element.properties, places[0].tolist(), strict=True)
        if length is not None
    ]
    rows_end = place + element.count * (end - place)
    if rows_end > len(data):
        return None
    row = np.dtype({
        "names": list(map(str, range(len(lists)))),
        "formats": [counter for counter, _ in lists],
        "offsets": [offset for _, offset in lists],
        "itemsize": end - place,
    })  # fmt: skip
    rows = np.frombuffer(data, row, element.count, place)
    for name in row.names or ():
        if (rows[name] != rows[name][0]).any():
            return None
    if max_length is not None and lengths[0, element.index_list()[0]] > max_length:
        return None
    return rows_end


def _array(data: bytes, lengths: NDArray[np.int64], places: NDArray[np.int64], values: np.dtype[Any]) -> NDArray[Any]:
    """Return the values of lists of these lengths, one after the other, whose first values are at these places."""
    first = np.repeat(places - (np.cumsum(lengths) - lengths) * values.itemsize, lengths)
    value_places = first + np.arange(len(first)) * values.itemsize
    raw = np.frombuffer(data, np.uint8)[value_places[:, None] + np.arange(values.itemsize)]
    array: NDArray[Any] = raw.view(values)[:, 0]
    return array


def colors_of(raw: dict[str, Any], element: str) -> NDArray[np.uint8] | None:
    """Return the sRGB colours of an element as trimesh reads it, (count, 4); None if it has none."""
    data = raw.get(element, {}).get("data")
    names = getattr(getattr(data, "dtype", None), "names", None) or (data if isinstance(data, dict) else ())
    columns = {name.lower(): data[name] for name in names}
    for *channels, opacities in _COLOR_NAMES:
        if all(name in columns for name in channels):
            rgb = srgb_bytes(np.column_stack([np.ravel(columns[name]) for name in channels]))
            opacity = next((np.ravel(columns[name]) for name in opacities if name in columns), np.ones(len(rgb)))
            return np.column_stack((rgb, srgb_bytes(opacity)))
    return None


def srgb_bytes(values: NDArray[Any]) -> NDArray[np.uint8]:
    """Return colours as bytes. Floats are from 0 to 1, or as integers from 0 to 255 or 65535: the largest one tells."""
    if values.dtype == np.uint8:
        return values
    numbers = np.nan_to_num(values.astype(np.float64))
    largest = numbers.max(initial=0.0)
    full = 1.0 if values.dtype.kind == "f" and largest < 2.0 else 255.0 if largest <= 255.0 else 65535.0
    return np.rint(np.clip(numbers / full, 0.0, 1.0) * 255.0).astype(np.uint8)


def faces_of(
    raw: dict[str, Any], positions: NDArray[np.floating[Any]]
) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
    """Return the triangles of faces as trimesh reads them, (M, 3), and the face of each, (M,); None without faces."""
    data = raw.get("face", {}).get("data")
    if data is None:
        return None
    name = next((each for each in _INDEX_NAMES if each in (data if isinstance(data, dict) else data.dtype.names)), None)
    if name is None:
        return None
    corners = data[name] if isinstance(data, dict) else data[name]["f1"]
    if not len(corners):
        return None
    if isinstance(corners, np.ndarray) and corners.ndim == 2:
        indices, sizes = corners.ravel().astype(np.int64), np.full(len(corners), corners.shape[1])
    else:
        indices = np.concatenate(list(corners)).astype(np.int64)
        sizes = np.array([len(each) for each in corners], np.int64)
    triangles = triangles_of_polygons(indices, np.cumsum(sizes) - sizes, sizes, positions)
    return triangles, np.repeat(np.arange(len(sizes)), np.maximum(sizes - 2, 0))


def triangles_of_strips(raw: dict[str, Any]) -> NDArray[np.int64] | None:
    """Return the (M, 3) triangles of an element ``tristrips`` as trimesh reads it; None if there is none.

    Raises ValueError if it has no list of vertices.
    """
    element = raw.get("tristrips", {}).get("data")
    if not isinstance(element, dict):
        return None
    lists = next((element[name] for name in _INDEX_NAMES if name in element), None)
    if lists is None:
        raise ValueError("its element 'tristrips' has no list 'vertex_indices'")
    return triangles_of_strip(np.concatenate([np.append(np.asarray(each, np.int64), -1) for each in lists]))
