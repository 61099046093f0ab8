"""Encodes Drake's LCM messages; ``test_wire`` compares them with those of lcm-gen's classes."""

import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gateway.adapters.drakeviewer import wire

BOX, SPHERE, CYLINDER, MESH, CAPSULE, ELLIPSOID = range(1, 7)
IDENTITY = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
TETRAHEDRON = [4, 4, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]
"""``float_data`` of a mesh."""


def text(value: str) -> bytes:
    data = value.encode() + b"\0"
    return struct.pack(">I", len(data)) + data


def fingerprint(value: int) -> bytes:
    return value.to_bytes(8, "big")


def geometry(
    kind: int,
    floats: Sequence[float],
    color: Sequence[float] = (1.0, 0.5, 0.0, 1.0),
    pose: Sequence[float] = IDENTITY,
    string: str = "",
) -> bytes:
    head = struct.pack(">b11f", kind, *pose, *color)
    return head + text(string) + struct.pack(f">i{len(floats)}f", len(floats), *floats)


def link(name: str, robot: int, *geometries: bytes) -> bytes:
    return text(name) + struct.pack(">ii", robot, len(geometries)) + b"".join(geometries)


def load(*links: bytes) -> bytes:
    return fingerprint(wire.LOAD_ROBOT) + struct.pack(">i", len(links)) + b"".join(links)


def deformables(*geometries: bytes, name: str = "deformable_geometries") -> bytes:
    return fingerprint(wire.LINK_DATA) + link(name, 0, *geometries)


def draw(poses: Mapping[tuple[int, str], Sequence[float]], milliseconds: int = 1000) -> bytes:
    """Return a draw message of poses x, y, z, qw, qx, qy, qz by link."""
    values = np.array([*poses.values()], ">f4").reshape(-1, 7)
    return b"".join(
        (
            fingerprint(wire.DRAW),
            struct.pack(">qi", milliseconds, len(poses)),
            *(text(name) for _, name in poses),
            struct.pack(f">{len(poses)}i", *(robot for robot, _ in poses)),
            values[:, :3].tobytes(),
            values[:, 3:].tobytes(),
        )
    )


def point_contact(one: str, two: str, point: Sequence[float], force: Sequence[float]) -> bytes:
    return struct.pack(">q", 5) + text(one) + text(two) + struct.pack(">9d", *point, *force, 0.0, 0.0, 1.0)


def surface_contact(
    bodies: tuple[tuple[str, str, str, bool, int], tuple[str, str, str, bool, int]] = (
        ("box", "body1", "model1", True, 1),
        ("ball", "body2", "model2", True, 1),
    ),
    centroid: Sequence[float] = (0.0, 0.0, 0.0),
    force: Sequence[float] = (0.0, 0.0, 20.0),
    moment: Sequence[float] = (0.0, 0.0, 0.0),
    vertices: Any = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)),
    pressure: Sequence[float] = (0.0, 1.0, 2.0, 4.0),
    polygons: Sequence[int] = (4, 0, 1, 2, 3),
) -> bytes:
    names = b"".join(
        text(geom) + text(body) + text(model) + struct.pack(">bi", unique, count)
        for geom, body, model, unique, count in bodies
    )
    return b"".join(
        (
            names,
            struct.pack(">9d", *centroid, *force, *moment),
            struct.pack(">i9d", 1, *range(9)),
            struct.pack(">i", len(vertices)),
            np.array(vertices, ">f8").tobytes(),
            np.array(pressure, ">f8").tobytes(),
            struct.pack(f">i{len(polygons)}i", len(polygons), *polygons),
        )
    )


def contacts(points: Sequence[bytes] = (), surfaces: Sequence[bytes] = ()) -> bytes:
    return b"".join(
        (
            fingerprint(wire.CONTACT_RESULTS),
            struct.pack(">qi", 7, len(points)),
            *points,
            struct.pack(">i", len(surfaces)),
            *surfaces,
        )
    )


def cloud(
    data: bytes,
    width: int,
    fields: Sequence[tuple[str, int, int, int]],
    step: int,
    height: int = 1,
    row_step: int | None = None,
    flags: int = 2,
) -> bytes:
    return b"".join(
        (
            fingerprint(wire.POINT_CLOUD),
            struct.pack(">q", 9),
            text("world"),
            struct.pack(">qqi", width, height, len(fields)),
            *(text(name) + struct.pack(">ibi", offset, kind, count) for name, offset, kind, count in fields),
            struct.pack(">qiqh", flags, step, width * step if row_step is None else row_step, 0),
            struct.pack(">q", len(data)),
            data,
        )
    )
