"""Reads OBJ files: polygons and points, with colours, normals, texture coordinates, and materials of MTL files."""

from __future__ import annotations

import contextlib
import re
from array import array
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import groupby
from operator import itemgetter
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.files.parsers.mesh_data import (
    MeshData,
    MeshFaultError,
    MeshOptions,
    Shape,
    check_limits,
    shape_of,
    srgb_bytes,
)
from gateway.files.parsers.mtl import read_materials, set_material
from gateway.files.parsers.polygons import triangles_of_polygons
from gateway.files.parsers.texture_files import ReadFile, TextureFiles

_CORNER: Final = re.compile(rb"(-?\d{1,9})(?:/(-?\d{1,9})?)?(?:/(-?\d{1,9})?)?")
"""Corner of a face: vertex, texture coordinates and normal, counted from 1, or below 0 back from the face's line."""
_COMMENT_OR_BACKSLASH: Final = re.compile(rb"[#\\]")
_NOT_DRAWN: Final = {b"l": "lines", b"curv": "curves", b"surf": "free-form surfaces"}
"""Elements that are not drawn by their keyword."""
_POLYPAINT: Final = b"#MRGB"
"""Start of a comment with the colours of the next vertices as ZBrush writes them: 8 hexadecimal digits of each, for a
mask, red, green and blue."""
_MAX_NAMED: Final = 5
"""Maximum number of names in a warning."""


@dataclass(slots=True, eq=False)
class _Faces:
    """Faces of one material."""

    corners: dict[bytes, int] = field(default_factory=dict)
    """Different corners as they are written, such as ``7/3``, and their numbers."""
    indices: array[int] = field(default_factory=lambda: array("q"))
    """Numbers of the corners of all faces."""
    sizes: array[int] = field(default_factory=lambda: array("q"))
    """Number of corners of each face."""
    lines: array[int] = field(default_factory=lambda: array("q"))
    """Line of each face, from 1."""


@dataclass(slots=True, eq=False)
class _ObjFile:
    """Statements of an OBJ file."""

    vertices: list[bytes] = field(default_factory=list)
    """Three coordinates of each vertex."""
    colored: array[int] = field(default_factory=lambda: array("q"))
    """Indices of the vertices with a colour."""
    colors: list[bytes] = field(default_factory=list)
    """Red, green and blue of each of these."""
    uv: list[bytes] = field(default_factory=list)
    """Two coordinates each."""
    normals: list[bytes] = field(default_factory=list)
    """Three coordinates each."""
    faces: defaultdict[str, _Faces] = field(default_factory=lambda: defaultdict(_Faces))
    """Faces by the name of their material; empty before the first ``usemtl``."""
    libraries: list[str] = field(default_factory=list)
    """Names of MTL files, as the statements ``mtllib`` have them."""
    broken: list[int] = field(default_factory=list)
    """Lines of faces that cannot be drawn."""
    not_drawn: Counter[bytes] = field(default_factory=Counter)
    """Number of elements that are not drawn, by their keyword."""
    face_count: int = 0

    def add_colored_vertices(self, words: list[bytes]) -> None:
        """Add vertices of six numbers each: coordinates, red, green and blue."""
        numbers, count = np.array(words, object).reshape(-1, 6), len(self.vertices) // 3
        self.colored.extend(range(count, count + len(numbers)))
        self.vertices += numbers[:, :3].ravel().tolist()
        self.colors += numbers[:, 3:].ravel().tolist()

    def add_faces(self, material: str, corners: list[bytes], sizes: Iterable[int], lines: Iterable[int]) -> None:
        """Add faces of ``sizes`` corners each, on ``lines``."""
        faces = self.faces[material]
        known = faces.corners
        faces.indices.extend([known.setdefault(corner, len(known)) for corner in corners])
        count = len(faces.sizes)
        faces.sizes.extend(sizes)
        faces.lines.extend(lines)
        self.face_count += len(faces.sizes) - count


def read_obj(data: bytes, read_file: ReadFile, textures: TextureFiles, options: MeshOptions, content: MeshData) -> None:
    """Add a shape for each material to ``content``, or the points of a file without faces.

    Raises ValueError if the file is damaged; MeshFaultError if it has no face that can be drawn, or is beyond a limit.
    """
    file = _read_statements(data, options.submesh)
    vertices = _numbers(file.vertices, 3)
    colors = _colors_of(file, len(vertices))
    for keyword, count in file.not_drawn.items():
        if not file.face_count or keyword == b"surf":
            content.warnings.append(f"its {count} {_NOT_DRAWN[keyword]} are not drawn")
    if not file.face_count:
        if options.submesh:
            raise MeshFaultError(f"it has no group {options.submesh[:60]!r} with faces")
        shapes = [shape_of(vertices, None, content.warnings, colors=colors) if len(vertices) else None]
    else:
        materials, folders = read_materials(file.libraries, read_file)
        if materials and (undefined := {*file.faces} - {"", *materials}):
            names = ", ".join(sorted(repr(name[:60]) for name in undefined)[:_MAX_NAMED])
            start = f"materials of usemtl that no MTL file defines ({len(undefined)})"
            content.warnings.append(f"{start}: {names}; they are white")
        if len(file.faces) > options.max_instances:
            raise MeshFaultError(f"it has {len(file.faces)} parts, the limit is {options.max_instances}")
        vertex_count = sum(len(faces.corners) for faces in file.faces.values())
        triangle_count = sum(len(faces.indices) - 2 * len(faces.sizes) for faces in file.faces.values())
        check_limits(vertex_count, triangle_count, options)
        uv, normals = _numbers(file.uv, 2), _numbers(file.normals, 3)
        shapes = []
        for name, faces in file.faces.items():
            shape = _shape_of(file, faces, vertices, colors, uv, normals, content.warnings)
            if shape is not None and name in materials:
                set_material(shape, materials[name], folders, textures, content.warnings)
            shapes.append(shape)
        if file.broken:
            line = min(file.broken)
            text = data.splitlines()[line - 1][:60].decode("ascii", "replace").strip()
            sentence = f"{len(file.broken)} of {file.face_count} faces are left out, such as {text!r} in line {line}"
            if len(file.broken) == file.face_count:
                raise MeshFaultError(sentence)
            content.warnings.append(sentence)
    content.shapes = [shape for shape in shapes if shape is not None]
    content.instances = [(number, np.eye(4).tobytes()) for number in range(len(content.shapes))]


def _read_statements(data: bytes, submesh: str) -> _ObjFile:
    """Return the statements of a file; faces of a group or object only, unless the name ``submesh`` is empty."""
    reader = _StatementReader(submesh)
    number = 1
    for _, run in groupby(data.removeprefix(b"\xef\xbb\xbf").splitlines(), itemgetter(slice(2))):
        lines = list(run)
        if len(lines) == 1 or not reader.read_run(number, lines):
            for offset, line in enumerate(lines):
                reader.read_line(number + offset, line)
        number += len(lines)
    return reader.file


class _StatementReader:
    """Reads lines of an OBJ file."""

    def __init__(self, submesh: str) -> None:
        self.file = _ObjFile()
        self._submesh = submesh
        self._is_shown = not submesh
        """False: the current group is another one than ``submesh``."""
        self._material = ""
        self._begun: list[bytes] = []
        """Lines that a backslash joins with the next one."""
        self._painted = 0
        """Number of vertices with a colour from ``_POLYPAINT``."""

    def read_run(self, number: int, lines: list[bytes]) -> bool:
        """Read successive lines of vertices, or of faces, with as many words each; return False for all others.

        It takes half of the time of ``read_line``. ``number`` is that of the first line.
        """
        text = b" ".join(lines)
        words = text.split()
        size = len(words) // len(lines)
        if self._begun or size < 2 or len(words) != size * len(lines) or _COMMENT_OR_BACKSLASH.search(text):
            return False
        keywords = words[::size]
        rows = {(b"v", 4): self.file.vertices, (b"vt", 3): self.file.uv, (b"vn", 4): self.file.normals}
        numbers = rows.get((keywords[0], size))
        has_colors = keywords[0] == b"v" and size == 7
        has_faces = keywords[0] == b"f" and size >= 4 and self._is_shown and b"-" not in text
        if keywords.count(keywords[0]) != len(lines) or not (has_faces or has_colors or numbers is not None):
            return False
        del words[::size]
        if numbers is not None:
            numbers += words
        elif has_colors:
            self.file.add_colored_vertices(words)
        else:
            self.file.add_faces(self._material, words, [size - 1] * len(lines), range(number, number + len(lines)))
        return True

    def read_line(self, number: int, line: bytes) -> None:
        """Read a line."""
        file = self.file
        if line.endswith(b"\\"):
            self._begun.append(line[:-1])
            return
        if self._begun:
            line = b" ".join((*self._begun, line))
            self._begun = []
        keyword, *words = line.split() or [b""]
        if keyword == _POLYPAINT and words:
            self._paint(words[0])
        if b"#" in line:
            words = words[: next((k for k, word in enumerate(words) if word.startswith(b"#")), len(words))]
        if keyword == b"v" and len(words) >= 3:
            if len(words) >= 6:
                file.add_colored_vertices(words[:6])
            else:
                file.vertices += words[:3]
        elif keyword == b"vt" and words:
            file.uv += (*words, b"0")[:2]
        elif keyword == b"vn" and len(words) == 3:
            file.normals += words
        elif keyword == b"f" and self._is_shown:
            if len(words) < 3:
                file.face_count += 1
                file.broken.append(number)
                return
            if b"-" in line:
                words = [_absolute(corner, file) for corner in words]
            file.add_faces(self._material, words, (len(words),), (number,))
        elif keyword == b"usemtl":
            self._material = b" ".join(words).decode("utf-8", "replace")
        elif keyword == b"mtllib":
            file.libraries.append(b" ".join(words).decode("utf-8", "replace").strip('"'))
        elif keyword in _NOT_DRAWN and self._is_shown:
            file.not_drawn[keyword] += 1
        elif self._submesh and keyword in (b"o", b"g"):
            self._is_shown = self._submesh.encode() in (*words, b" ".join(words))

    def _paint(self, digits: bytes) -> None:
        """Give the next vertices the colours of a ``_POLYPAINT``."""
        file, colors = self.file, b""
        with contextlib.suppress(ValueError):
            colors = bytes.fromhex(digits.decode("ascii", "replace"))
        count = min(len(colors) // 4, len(file.vertices) // 3 - self._painted)
        file.colored.extend(range(self._painted, self._painted + count))
        file.colors += [b"%.4f" % (colors[4 * k + c] / 255.0) for k in range(count) for c in (1, 2, 3)]
        self._painted += count


def _absolute(corner: bytes, file: _ObjFile) -> bytes:
    """Return a corner with indices from 1 in place of those that count back from here."""
    counts = len(file.vertices) // 3, len(file.uv) // 2, len(file.normals) // 3
    match = _CORNER.fullmatch(corner)
    if match is None:
        return corner
    indices = [int(index or 0) for index in match.groups()]
    return b"%d/%d/%d" % tuple(
        max(index + count + 1, 0) if index < 0 else index for index, count in zip(indices, counts, strict=True)
    )


def _numbers(words: list[bytes], columns: int) -> NDArray[np.float64]:
    """Return numbers in rows. Raises ValueError if one cannot be read."""
    return np.array(words, np.float64).reshape(-1, columns)


def _colors_of(file: _ObjFile, count: int) -> NDArray[np.uint8] | None:
    """Return the sRGB colours of vertices, (count, 4), white for those without; None if no vertex has one."""
    if not file.colors:
        return None
    colors = np.full((count, 4), 255, np.uint8)
    colors[np.array(file.colored), :3] = srgb_bytes(_numbers(file.colors, 3))
    return colors


def _shape_of(
    file: _ObjFile,
    faces: _Faces,
    vertices: NDArray[np.float64],
    colors: NDArray[np.uint8] | None,
    uv: NDArray[np.float64],
    normals: NDArray[np.float64],
    warnings: list[str],
) -> Shape | None:
    """Return the triangles of faces, whose different corners are its vertices. Broken faces are added to ``file``."""
    parsed = np.zeros((len(faces.corners), 3), np.int64)
    """Indices of each corner from 1; 0: it has none."""
    for corner, number in faces.corners.items():
        if match := _CORNER.fullmatch(corner):
            parsed[number] = [int(index or 0) for index in match.groups()]
    parsed[(parsed < 0) | (parsed > (len(vertices), len(uv), len(normals)))] = 0
    indices, sizes = np.array(faces.indices), np.array(faces.sizes)
    starts = np.cumsum(sizes) - sizes
    is_whole = np.logical_and.reduceat(parsed[indices, 0] > 0, starts)
    file.broken += np.array(faces.lines)[~is_whole].tolist()
    if not is_whole.any():
        return None
    used = parsed - 1
    positions = vertices[used[:, 0]]
    triangles = triangles_of_polygons(indices, starts[is_whole], sizes[is_whole], positions)
    has_uv, has_normals = (used[:, 1] >= 0).any(), (used[:, 2] >= 0).all()
    return shape_of(
        positions,
        triangles,
        warnings,
        normals=normals[used[:, 2]] if has_normals else None,
        uv=np.where(used[:, 1:2] >= 0, uv[used[:, 1]], 0.0) if has_uv else None,
        colors=None if colors is None else colors[used[:, 0]],
    )
