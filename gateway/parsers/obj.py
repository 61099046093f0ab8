"""Rewrites faces of OBJ files that trimesh would refuse or misread."""

from __future__ import annotations

import re
from typing import Final

from gateway.parsers.mesh_data import MeshFaultError

_CORNER: Final = re.compile(rb"(-?\d{1,9})(?:/(-?\d{1,9})?)?(?:/(-?\d{1,9})?)?")
"""Corner of a face: vertex, texture coordinates and normal, counted from 1, or from the end if negative."""
_KINDS: Final = (b"v", b"vt", b"vn")
"""Statements that the three numbers of a corner count."""


_RELATIVE_FACE: Final = re.compile(rb"^[ \t]*f[ \t][^\r\n]*[ \t/]-\d", re.MULTILINE)
_NEGATIVE: Final = re.compile(rb"-\d{1,9}")


def with_absolute_faces(data: bytes) -> bytes:
    """Return the file with negative indices of faces replaced by positive ones.

    A negative index counts back from the face's own line. trimesh counts from the end of the file.
    """
    if not _RELATIVE_FACE.search(data):
        return data
    lines = data.splitlines()
    counts = dict.fromkeys(_KINDS, 0)
    for number, line in enumerate(lines):
        statement = line.split(maxsplit=1)[:1]
        if statement == [b"f"]:
            corners = (corner.split(b"/") for corner in line.partition(b"#")[0].split()[1:])
            lines[number] = b"f " + b" ".join(_absolute(corner, counts) for corner in corners)
        elif statement and statement[0] in counts:
            counts[statement[0]] += 1
    return b"\n".join(lines)


def _absolute(corner: list[bytes], counts: dict[bytes, int]) -> bytes:
    """Return a corner of a face with positive indices.

    Args:
        corner: Indices of vertex, texture coordinates and normal.
        counts: Number of each of them in the lines before the face.
    """
    indices = [
        b"%d" % (count + 1 + int(index)) if _NEGATIVE.fullmatch(index) else index
        for index, count in zip(corner, counts.values(), strict=False)
    ]
    return b"/".join(indices)


def without_broken_faces(data: bytes, warnings: list[str]) -> bytes:
    """Return the file without faces that are not three or more corners, or refer to vertices that do not exist.

    Args:
        data: OBJ file.
        warnings: A sentence is appended if faces are left out: their number, and the first one with its line.

    Raises:
        MeshFaultError: All faces are broken.
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
        first = lines[broken[0]][:60].decode("ascii", "replace").strip()
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
        and all(not index or 1 <= abs(int(index)) <= count for index, count in zip(match.groups(), counts, strict=True))
        for match in matches
    )
