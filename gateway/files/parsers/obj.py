"""Rewrites faces of OBJ files that trimesh would refuse or misread."""

import re
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.files.parsers.mesh_data import MeshFaultError
from gateway.files.parsers.polygons import ears_of_concave_polygons

_CORNER: Final = re.compile(rb"(\d{1,9})(?:/(\d{1,9})?)?(?:/(\d{1,9})?)?")
"""Corner of a face with absolute indices: vertex, texture coordinates and normal, counted from 1."""
_KINDS: Final = (b"v", b"vt", b"vn")
"""Statements that the three numbers of a corner count."""


_RELATIVE_FACE: Final = re.compile(rb"^[ \t]*f[ \t][^\r\n]*[ \t/]-\d", re.MULTILINE)
_CONTINUED: Final = re.compile(rb"\\[\r\n]")
_NEGATIVE: Final = re.compile(rb"-\d{1,9}")
_PLAIN_VERTEX: Final = re.compile(rb"^([ \t]*v(?:[ \t]+\S+){3})(?=[ \t]*\r?$)", re.MULTILINE)
_COLORED_VERTEX: Final = re.compile(rb"^([ \t]*v(?:[ \t]+\S+){3})[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)", re.MULTILINE)
_POSITION: Final = re.compile(rb"^[ \t]*v((?:[ \t]+[^\s]+){3})", re.MULTILINE)
_POLYGON: Final = re.compile(rb"^[ \t]*f(?=[ \t])((?:[ \t]+[\d/]+){4,})[ \t]*(?:#[^\r\n]*)?\r?$", re.MULTILINE)
"""Face with four or more corners."""
_OTHER_INDICES: Final = re.compile(rb"/[\d/]*")
_NAME_COMMENT: Final = re.compile(rb"^((?:usemtl|mtllib) [^\r\n#]*) #[^\r\n]*", re.MULTILINE)
_INDENTATION: Final = re.compile(rb"^ +(?=\S)", re.MULTILINE)
_MISSING: Final = 999_999_999
"""Index that trimesh refuses; one below 1 would count from the end of the file."""


def with_plain_blanks(data: bytes) -> bytes:
    """Return an OBJ or MTL file without a byte order mark, indentation, tabs, and comments behind names."""
    data = _NAME_COMMENT.sub(rb"\1", data.removeprefix(b"\xef\xbb\xbf").replace(b"\t", b" "))
    return _INDENTATION.sub(b"", data) if b"\n " in data or data.startswith(b" ") else data


def with_absolute_faces(data: bytes) -> bytes:
    """Return the file with negative indices of faces replaced by positive ones, and continued lines joined.

    A negative index counts back from the face's own line. trimesh counts from the end of the file. Each statement keeps
    its line.
    """
    if not _CONTINUED.search(data) and not _RELATIVE_FACE.search(data):
        return data
    lines = _joined(data.splitlines())
    counts = dict.fromkeys(_KINDS, 0)
    for number, line in enumerate(lines):
        statement = line.split(maxsplit=1)[:1]
        if statement == [b"f"]:
            corners = (corner.split(b"/") for corner in line.partition(b"#")[0].split()[1:])
            lines[number] = b"f " + b" ".join(_absolute(corner, counts) for corner in corners)
        elif statement and statement[0] in counts:
            counts[statement[0]] += 1
    return b"\n".join(lines)


def with_convex_faces(data: bytes) -> bytes:
    """Return a file of ``with_absolute_faces`` with triangles in place of concave faces: trimesh makes fans."""
    faces: list[bytes] = _POLYGON.findall(data)
    positions = np.fromstring(b" ".join(_POSITION.findall(data)) if faces else b"", np.float64, sep=" ")
    if not faces or len(positions) % 3:
        return data
    indices, sizes = _indices(b"\n".join(faces), len(faces))
    starts = np.cumsum(sizes) - sizes
    triangles = dict(ears_of_concave_polygons(indices - 1, starts, sizes, positions.reshape(-1, 3)))
    if not triangles:
        return data
    number = -1

    def cut(match: re.Match[bytes]) -> bytes:
        nonlocal number
        number += 1
        if number not in triangles:
            return match[0]
        corners = match[1].split()
        return b"\n".join(
            b"f %s %s %s" % tuple(corners[corner] for corner in ear) for ear in triangles[number].tolist()
        )

    return _POLYGON.sub(cut, data)


def _indices(text: bytes, lines: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the vertices of the corners of faces, and the number of corners in each line, (``lines``,)."""
    characters = np.frombuffer(b" " + text, np.uint8)
    is_blank = characters <= ord(" ")
    line = np.cumsum(characters == ord("\n"), dtype=np.int32)[1:]
    sizes = np.bincount(line[is_blank[:-1] & ~is_blank[1:]], minlength=lines)
    corners, plain = int(sizes.sum()), text.replace(b"//", b"/")
    slashes = plain.count(b"/")
    if slashes % corners == 0:  # most files have the same indices at all corners
        numbers = np.fromstring(plain.replace(b"/", b" "), np.int64, sep=" ")
        if len(numbers) == corners + slashes:
            return numbers[:: 1 + slashes // corners], sizes
    return np.fromstring(_OTHER_INDICES.sub(b"", text), np.int64, sep=" "), sizes


def with_unit_colors(data: bytes) -> bytes:
    """Return the file with colours of vertices from 0 to 1, which are also written from 0 to 255 or 65535.

    If only some objects have colours, the vertices of the others become white: trimesh reads all colours or none.
    """
    first = _POSITION.search(data)
    if first is None or (data.count(b"\no ") < 2 and not _COLORED_VERTEX.match(data, first.start())):
        return data
    try:
        largest = max((max(map(float, match.groups()[1:])) for match in _COLORED_VERTEX.finditer(data)), default=None)
    except ValueError:
        return data
    if largest is None:
        return data
    if 2.0 <= largest < float("inf"):
        full = 255.0 if largest <= 255.0 else 65535.0

        def scaled(match: re.Match[bytes]) -> bytes:
            return b" ".join((match[1], *(b"%.6f" % (float(channel) / full) for channel in match.groups()[1:])))

        data = _COLORED_VERTEX.sub(scaled, data)
    return _PLAIN_VERTEX.sub(rb"\1 1 1 1", data)


def with_one_group(data: bytes, name: str) -> bytes:
    """Return the file with the faces of the objects and groups of a name only. Raises MeshFaultError if it has none."""
    lines, is_shown, count = data.splitlines(), False, 0
    for number, line in enumerate(lines):
        match line.split():
            case [b"o" | b"g", *names]:
                is_shown = name.encode() in (*names, b" ".join(names))
            case [b"f", *_]:
                count += is_shown
                lines[number] = line if is_shown else b""
    if not count:
        raise MeshFaultError(f"it has no group {name[:60]!r} with faces")
    return b"\n".join(lines)


def _joined(lines: list[bytes]) -> list[bytes]:
    """Return lines in which one with a backslash at its end holds the next ones, too, and these are empty."""
    joined: list[bytes] = []
    parts: list[bytes] = []
    for line in lines:
        parts.append(line.removesuffix(b"\\"))
        if not line.endswith(b"\\"):
            joined += [b" ".join(parts), *[b""] * (len(parts) - 1)]
            parts = []
    return [*joined, b" ".join(parts)]


def _absolute(corner: list[bytes], counts: dict[bytes, int]) -> bytes:
    """Return a corner of a face with positive indices of vertex, texture coordinates and normal.

    ``counts``: number of each of them in the lines before the face.
    """
    indices = [
        b"%d" % (count + 1 + int(index) if -int(index) <= count else _MISSING) if _NEGATIVE.fullmatch(index) else index
        for index, count in zip(corner, counts.values(), strict=False)
    ]
    return b"/".join(indices)


def without_broken_faces(data: bytes, original: bytes, warnings: list[str]) -> bytes:
    """Return a file of ``with_absolute_faces`` without faces that are not three or more corners that exist.

    A sentence is appended with their number, and the first one with its line in ``original``. Raises MeshFaultError if
    all are broken.
    """
    lines = data.splitlines()
    statements = [line.split(maxsplit=1)[:1] for line in lines]
    for number, statement in enumerate(statements):
        if statement == [b"f"]:
            lines[number] = lines[number].partition(b"#")[0]  # trimesh reads no comments behind faces
    counts = [sum(statement == [kind] for statement in statements) for kind in _KINDS]
    broken = [
        number
        for number, (line, statement) in enumerate(zip(lines, statements, strict=True))
        if statement == [b"f"] and not _is_face(line.split()[1:], counts)
    ]
    if broken:
        total = sum(statement == [b"f"] for statement in statements)
        first = original.splitlines()[broken[0]][:60].decode("ascii", "replace").strip()
        sentence = f"{len(broken)} of {total} faces are left out, such as {first!r} in line {broken[0] + 1}"
        if len(broken) == total:
            raise MeshFaultError(sentence)
        warnings.append(sentence)
    for number in broken:
        lines[number] = b""
    return b"\n".join(lines)


def _is_face(corners: list[bytes], counts: list[int]) -> bool:
    """Return True for three or more corners of existing vertices, texture coordinates and normals."""
    matches = [_CORNER.fullmatch(corner) for corner in corners]
    return len(corners) >= 3 and all(
        match
        and all(not index or 1 <= int(index) <= count for index, count in zip(match.groups(), counts, strict=True))
        for match in matches
    )
