"""Reads PLY files, text and binary: polygons, strips and points, with colours, normals and texture coordinates."""

import contextlib
import itertools
import math
import re
import struct
from array import array
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.files.parsers.mesh_data import (
    MeshData,
    MeshOptions,
    Shape,
    check_limits,
    checked_triangles,
    shape_of,
    srgb_bytes,
)
from gateway.files.parsers.ply_header import Element, Property, read_header, split_header
from gateway.files.parsers.polygons import triangles_of_polygons, triangles_of_strip
from gateway.files.parsers.texture_files import TextureFiles

_MAX_LENGTH: Final = 1e9
"""Length of a list above which text is not one."""
_PLACES: Final = ("x", "y", "z", "nx", "ny", "nz")
_UV_NAMES: Final = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))
_COLOR_NAMES: Final = (
    ("red", "green", "blue", ("alpha",)),
    ("diffuse_red", "diffuse_green", "diffuse_blue", ("diffuse_alpha", "alpha")),
    ("r", "g", "b", ("a", "alpha")),
    ("diffuse_r", "diffuse_g", "diffuse_b", ("diffuse_a", "alpha")),
    ("color_0", "color_1", "color_2", ()),
)
"""Properties of colours: red, green, blue, and names of the opacity. The last ones are Mitsuba's, linear."""
_MEAN_HARMONIC: Final = 0.5 / math.sqrt(math.pi)
"""Spherical harmonic of degree 0, the divisor of the colours of Gaussians."""
_FLOAT64: Final = np.dtype(np.float64)
_TEXTURE_FILE: Final = re.compile(r"^comment[ \t]+(?i:texturefile)[ \t]*(.*)", re.MULTILINE)


class _Column(NamedTuple):
    """Values of a property."""

    values: NDArray[Any]
    """Values of all rows, one after the other."""
    sizes: NDArray[np.int64]
    """Number of values in each row, (count,)."""


_Columns = dict[str, _Column]


def read_ply(data: bytes, textures: TextureFiles, options: MeshOptions, content: MeshData) -> list[Shape]:
    """Return the triangles of a file, those of each texture, or, without any, its points. Warnings go to ``content``.

    Colours of vertices come before those of faces, and a texture that can be read before both. Raises ValueError if the
    file is damaged, MeshFaultError beyond a limit.
    """
    header, body = split_header(data)
    elements, is_text = read_header(header)
    vertices = next((each for each in elements if each.name == "vertex" and each.row_count), None)
    if vertices is None:
        return []
    drawn = next(
        (each for name in ("face", "tristrips") for each in elements if each.name == name and each.row_count), None
    )
    if is_text:
        body = _with_known_values(body, elements, content.warnings)
    texture_names = [name.strip() for name in _TEXTURE_FILE.findall(header)]
    _add_hints(elements, drawn, content.warnings)
    index_list = "" if drawn is None else drawn.index_list
    columns = _read_columns(body, elements, is_text)
    vertex = columns["vertex"]
    positions = _stacked(vertex, ("x", "y", "z"))
    if positions is None:
        raise ValueError("its element 'vertex' has not x, y and z")
    colors = _colors_of(vertex)
    lists = None if drawn is None else columns[drawn.name][index_list]
    if drawn is None or lists is None or np.isin(lists.sizes, (1, 2)).all():  # meshio writes points as faces
        if drawn is not None:
            content.warnings.append(
                f"its {drawn.row_count} elements {drawn.name!r} have no triangles, points are drawn"
            )
        check_limits(len(positions), 0, options)
        return list(filter(None, [shape_of(positions, None, content.warnings, colors=colors)]))
    normals = _stacked(vertex, ("nx", "ny", "nz"))
    uv = next((found for names in _UV_NAMES if (found := _stacked(vertex, names)) is not None), None)
    faces = columns[drawn.name]
    indices, sizes = lists.values.astype(np.int64), lists.sizes
    check_limits(len(positions), int(np.maximum(sizes - 2, 0).sum()), options)
    corner_uv = faces.get("texcoord")
    is_split = corner_uv is not None and np.array_equal(corner_uv.sizes, 2 * sizes)
    numbers = faces.get("texnumber") if 1 < len(texture_names) <= options.max_instances else None
    if numbers is not None and (drawn.name != "face" or (numbers.sizes != 1).any()):
        numbers = None
    if len({*texture_names}) > 1 and numbers is None and (is_split or uv is not None):
        content.warnings.append(f"it has {len({*texture_names})} textures, the last is drawn on all faces")
    names = texture_names[-1:] if numbers is None else texture_names
    images = [textures.index(name) for name in names] if is_split or uv is not None else []
    image = next((each for each in images if each is not None), None)
    face_colors = _colors_of(faces) if drawn.name == "face" and image is None else None
    if colors is not None and face_colors is not None and not (colors == colors[0]).all():
        face_colors = None
    if image is not None:
        colors = None
    elif colors is not None or face_colors is not None:
        uv, is_split = None, False
    if drawn.name == "tristrips":
        rows, is_split = triangles_of_strip(np.insert(indices, np.cumsum(sizes), -1)), False
    else:
        rows = _triangles(indices, sizes, positions)
    if not len(rows):
        raise ValueError(f"its {drawn.row_count} elements {drawn.name!r} have no triangles")
    rows = checked_triangles(rows, len(positions), content.warnings)

    def shape(rows: NDArray[np.int64], image: int | None) -> Shape | None:
        """Return triangles with a texture."""
        points, triangles = positions, rows[:, :3]
        values = {"normals": normals, "uv": uv, "colors": colors}
        if is_split or face_colors is not None or numbers is not None:
            corners = triangles.ravel()
            points, triangles = points[corners], np.arange(len(corners)).reshape(-1, 3)
            values = {name: None if each is None else each[corners] for name, each in values.items()}
            if face_colors is not None:
                values["colors"] = face_colors[rows[:, 3]].repeat(3, axis=0)
            if is_split and corner_uv is not None:
                values["uv"] = corner_uv.values.reshape(-1, 2)[rows[:, 4:].ravel()]
        color = None if image is None else (1.0, 1.0, 1.0, 1.0)
        return shape_of(points, triangles, content.warnings, **values, color=color, image=image)

    parts = [(rows, image)] if numbers is None else _split_by_texture(rows, numbers.values[rows[:, 3]], images)
    return [each for each in (shape(*part) for part in parts) if each is not None]


def _split_by_texture(
    rows: NDArray[np.int64], numbers: NDArray[Any], images: list[int | None]
) -> Iterator[tuple[NDArray[np.int64], int | None]]:
    """Yield the triangles of each texture, and its image; None for numbers of textures that do not exist."""
    is_known = np.isin(numbers, np.arange(len(images)))
    textures = np.full(len(rows), -1)
    textures[is_known] = numbers[is_known]
    order = np.argsort(textures, kind="stable")  # no mask for each texture: a file may name thousands
    for part in np.split(order, np.flatnonzero(np.diff(textures[order])) + 1):
        if len(part):  # there is an empty one if there are no triangles
            texture = int(textures[part[0]])
            yield rows[part], images[texture] if texture >= 0 else None


def _add_hints(elements: list[Element], drawn: Element | None, warnings: list[str]) -> None:
    """Append sentences about edges without faces, and Gaussians. Raises ValueError for a compressed splat."""
    names = {each.name for element in elements if element.name == "vertex" for each in element.properties}
    if "packed_position" in names:
        raise ValueError("it is a compressed Gaussian splat (packed_position); of a plain one, the centres are drawn")
    edges = sum(element.row_count for element in elements if element.name == "edge")
    if edges and drawn is None:
        warnings.append(f"its {edges} edges are not drawn, only their ends")
    if "f_dc_0" in names:
        warnings.append("it is a Gaussian splat (f_dc_0 …): its centres are drawn as points, without its Gaussians")


def _with_known_values(body: bytes, elements: list[Element], warnings: list[str]) -> bytes:
    """Return text without those values of rows that the header names wrongly, or not at all.

    Assimp 6.0 writes colours that it does not declare, and texture coordinates that it calls colours. MeshLab wrote the
    colours of a face's corners in place of the face's own.
    """
    lines, start = body.strip().split(b"\n"), 0
    if len(lines) != sum(element.row_count for element in elements):
        return body
    for name, row_count, properties in elements:
        rows, start = slice(start, start + row_count), start + row_count
        words = lines[rows][0].split() if row_count else []
        found, declared = len(words), _word_count(words, properties)
        if found == declared or not row_count:
            continue
        known = list(itertools.takewhile(lambda each: each.counter is not None or each.name in _PLACES, properties))
        row_words = [line.split() for line in lines[rows]]
        counts = [_word_count(words, known) for words in row_words]
        if any(len(words) < count for words, count in zip(row_words, counts, strict=True)):
            break
        names = ", ".join(each.name for each in known) or "none"
        warnings.append(
            f"rows of its element {name!r} have {found} values, its header names {declared}; of them are read: {names}"
        )
        properties[:] = known
        lines[rows] = [b" ".join(words[:count]) for words, count in zip(row_words, counts, strict=True)]
    return b"\n".join(lines)


def _word_count(words: list[bytes], properties: list[Property]) -> int:
    """Return the number of words that a row of properties has, of which ``words`` are the first."""
    count = 0
    for each in properties:
        length = 0.0
        if each.counter is not None and count < len(words):
            with contextlib.suppress(ValueError):
                length = float(words[count])
        count += 1 + (int(length) if 0.0 <= length < _MAX_LENGTH else 0)
    return count


def _read_columns(body: bytes, elements: list[Element], is_text: bool) -> dict[str, _Columns]:
    """Return the properties of all elements. Text is read as if its numbers were binary float64. Raises ValueError."""
    if is_text:
        body = _numbers(body.split()).tobytes()
    place = 0
    columns: dict[str, _Columns] = {}
    for element in elements:
        layout = element.properties
        if is_text:
            layout = [Property(name, _FLOAT64, counter and _FLOAT64) for name, _, counter in layout]
        found, place = _read_rows(body, place, Element(element.name, element.row_count, layout))
        with np.errstate(invalid="ignore", over="ignore"):  # text may have numbers beyond the type
            columns[element.name] = {
                each.name: _Column(
                    column.values
                    if is_text and each.name in _PLACES[:3]
                    else column.values.astype(each.dtype, copy=False),
                    column.sizes,
                )
                for each, column in zip(element.properties, found, strict=True)
            }
    return columns


def _numbers(words: list[bytes]) -> NDArray[np.float64]:
    """Return the numbers of a text, up to the first word that is none: some files have rests after their data."""
    try:
        return np.array(words, np.float64)
    except ValueError:
        numbers = array("d")
        with contextlib.suppress(ValueError):
            numbers.extend(map(float, words))
        return np.array(numbers)


def _read_rows(data: bytes, place: int, element: Element) -> tuple[list[_Column], int]:
    """Return the columns of an element at a place, and its end. Raises ValueError if the file is too short."""
    _, count, properties = element
    first_sizes, _, end = _measured(data, place, element, min(count, 1))
    if not first_sizes.size:
        return [_Column(np.zeros(0, each.dtype), np.zeros(0, np.int64)) for each in properties], place
    # If the lists are as long as in the first row, all rows are read at once.
    row: list[Any] = []
    for number, (each, size) in enumerate(zip(properties, first_sizes[0].tolist(), strict=True)):
        row += [] if each.counter is None else [(f"size {number}", each.counter)]
        row.append((str(number), each.dtype, (size,)))
    end = place + count * np.dtype(row).itemsize
    if end <= len(data):
        rows = np.frombuffer(data, np.dtype(row), count, place)
        if all((rows[name] == rows[name][0]).all() for name, *_ in row if name.startswith("size")):
            return [
                _Column(rows[str(number)].ravel(), np.full(count, size)) for number, size in enumerate(first_sizes[0])
            ], end
    elif all(each.counter is None for each in properties):
        raise ValueError("it is shorter than its header says")
    sizes, places, end = _measured(data, place, element, count)
    columns = zip(properties, sizes.T, places.T, strict=True)
    return [
        _Column(_gathered(data, each_sizes, each_places, each.dtype), each_sizes)
        for each, each_sizes, each_places in columns
    ], end


def _measured(
    data: bytes, place: int, element: Element, count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """Return the numbers of values of an element's first rows, their places, both (count, properties), and the end.

    Raises ValueError if the file is too short, or a length is negative.
    """
    layout = [
        (None if counter is None else struct.Struct(f"{counter.str[0]}{counter.char}".replace("|", "<")), each.itemsize)
        for _, each, counter in element.properties
    ]
    sizes, places = array("q"), array("q")
    for _ in range(count):  # each list takes a byte or more, so the data ends this
        for counter, value_bytes in layout:
            number = 1
            if counter is not None and place + counter.size <= len(data):
                number = int(counter.unpack_from(data, place)[0])
                place += counter.size
                if number < 0:
                    raise ValueError(f"a list of its element {element.name!r} has a length of {number}")
            if place + number * value_bytes > len(data):
                raise ValueError("it is shorter than its header says")
            sizes.append(number)
            places.append(place)
            place += number * value_bytes
    shape = (-1, max(len(layout), 1))
    return np.array(sizes, np.int64).reshape(shape), np.array(places, np.int64).reshape(shape), place


def _gathered(data: bytes, sizes: NDArray[np.int64], places: NDArray[np.int64], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return the values of lists of these sizes, one after the other, whose first values are at these places."""
    first = np.repeat(places - (np.cumsum(sizes) - sizes) * dtype.itemsize, sizes)
    value_places = first + np.arange(len(first)) * dtype.itemsize
    raw = np.frombuffer(data, np.uint8)[value_places[:, None] + np.arange(dtype.itemsize)]
    values: NDArray[Any] = raw.view(dtype)[:, 0]
    return values


def _triangles(
    indices: NDArray[np.int64], sizes: NDArray[np.int64], positions: NDArray[np.floating[Any]]
) -> NDArray[np.int64]:
    """Return the triangles of polygons, (M, 7): vertices, number of the polygon, places of the corners in ``indices``.

    ``sizes``: number of corners of each polygon.
    """
    corners: NDArray[np.int64] = np.arange(len(indices))
    if (sizes == 3).all():  # most files; three times as fast
        corners = corners.reshape(-1, 3)
    else:
        of_corners = positions[np.clip(indices, 0, len(positions) - 1)]
        corners = triangles_of_polygons(corners, np.cumsum(sizes) - sizes, sizes, of_corners)
    polygons = np.repeat(np.arange(len(sizes)), np.maximum(sizes - 2, 0))
    return np.column_stack((indices[corners], polygons, corners))


def _stacked(columns: _Columns, names: tuple[str, ...]) -> NDArray[Any] | None:
    """Return properties of an element as (count, number of names); None if it has not all of them."""
    if not columns.keys() >= {*names}:
        return None
    return np.column_stack([columns[name].values for name in names])


def _colors_of(columns: _Columns) -> NDArray[np.uint8] | None:
    """Return the sRGB colours of an element, (count, 4); None if it has none."""
    for *channels, opacities in _COLOR_NAMES:
        stacked = _stacked(columns, tuple(channels))
        if stacked is not None:
            if channels[0] == "color_0" and stacked.dtype.kind == "f":
                stacked = np.where(stacked < 0.0031308, 12.92 * stacked, 1.055 * np.abs(stacked) ** (1 / 2.4) - 0.055)
            rgb = srgb_bytes(stacked)
            opacity = next((columns[name].values for name in opacities if name in columns), np.ones(len(rgb)))
            return np.column_stack((rgb, srgb_bytes(opacity)))
    harmonics = _stacked(columns, ("f_dc_0", "f_dc_1", "f_dc_2"))
    if harmonics is not None:
        rgb = srgb_bytes(np.clip(0.5 + _MEAN_HARMONIC * harmonics, 0.0, 1.0))
        return np.column_stack((rgb, np.full(len(rgb), 255, np.uint8)))
    return None
