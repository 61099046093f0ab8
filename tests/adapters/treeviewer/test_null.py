"""``null`` in number arrays, which JSON.jl and nlohmann/json write for NaN, and nil in MessagePack: read as NaN."""

from typing import Any

import msgspec
import numpy as np
import pytest

from gateway.scene.tree.geometry import Line, Part, PointCloud, Surface
from scenegate.messages import wire
from tests.adapters.treeviewer.conversation import Viewer, message

COUNTS = [4, 300]
"""Rows of short arrays, which Python decodes, and of long ones, which kernels parse."""


def with_hole(rows: list[Any], hole: Any) -> list[Any]:
    """Return rows whose second one has ``hole`` in place of its first number."""
    second = hole if not isinstance(rows[1], list) else [hole, *rows[1][1:]]
    return [rows[0], second, *rows[2:]]


def geometries(count: int, hole: Any) -> list[dict[str, Any]]:
    rows = [[float(i), float(i % 3), 1.0] for i in range(count)]
    points = with_hole(rows, hole)
    channels = {"x": with_hole([1.0] * count, hole), "rgb": with_hole([[0.5, 0.5, 0.5]] * count, hole)}
    faces = [[i, i + 1, i + 2] for i in range(2, count - 2)] or [[0, 2, 3]]
    return [
        {"type": "pointcloud", "points": points, "channels": channels},
        {"type": "line", "points": points},
        {"type": "mesh_data", "vertices": points, "faces": faces},
        {"type": "planar_lidar", "ranges": with_hole([1.0] * count, hole), "angle_start": 0.0, "angle_step": 0.01},
    ]


def arrays(parts: tuple[Part, ...]) -> list[np.ndarray]:
    found: list[np.ndarray] = []
    for part in parts:
        shape = part.shape
        if isinstance(shape, Surface):
            found += [shape.mesh.positions, shape.mesh.elements]
        elif isinstance(shape, PointCloud):
            found += [shape.points, *shape.channels.values()]
        else:
            assert isinstance(shape, Line)
            found.append(shape.points)
    return found


def shown(request: bytes) -> tuple[dict[str, Any], list[np.ndarray]]:
    viewer = Viewer()
    answer = msgspec.json.decode(msgspec.json.encode(viewer.protocol.handle(request)))
    assert answer["status"] == 0, answer
    return answer, arrays(viewer.node("it").parts or ())


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("binary", [False, True])
def test_null_is_nan(count: int, binary: bool) -> None:
    def request(hole: Any) -> bytes:
        command = {"setgeometry": [{"path": ["it"], "geometries": geometries(count, hole)}]}
        return wire.encode(msgspec.msgpack.encode(command), 7, wire.BINARY) if binary else message(command)

    answer, found = shown(request(None))
    expected_answer, expected = shown(request(float("nan")))
    assert answer == expected_answer
    assert len(found) == len(expected) > 5
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)
