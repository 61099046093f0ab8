"""Long number arrays taken out of the JSON text give the numbers that Python's json gives."""

import json
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.adapters.treeviewer import request_reader
from gateway.adapters.treeviewer.config import Limits
from gateway.adapters.treeviewer.context import ReadContext
from gateway.adapters.treeviewer.number_arrays import MIN_NUMBERS, NumberArrays
from gateway.adapters.treeviewer.request_reader import JsonReader
from gateway.adapters.treeviewer.requests import Request, UnreadableRequestError
from gateway.scene.tree.geometry import Line, Part, PointCloud, Surface
from scenegate.messages import wire
from tests.adapters.treeviewer.conversation import Viewer, message


def read(request: Any) -> Request:
    """Read a request after its long arrays were taken out, whatever its size."""
    text = request if isinstance(request, str) else json.dumps(request)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(request_reader, "SMALL_JSON_BYTES", 0)
        return JsonReader(Limits()).read(memoryview(text.encode()), ReadContext())


NUMBERS = st.floats(width=64, allow_nan=True, allow_infinity=True) | st.integers(-(10**25), 10**25)


@pytest.mark.slow
@settings(deadline=None, max_examples=100)
@given(st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=90, max_size=200), st.sampled_from([None, 1, "\t"]))
def test_extracted_arrays_equal_pythons_json(rows: list[tuple[float, float, float]], indent: Any) -> None:
    data = {"setgeometry": [{"path": ["p"], "geometry": {"type": "line", "points": rows}}]}
    shape = read(json.dumps(data, indent=indent)).geometries[0][1]
    expected = np.array([[float(v) for v in row] for row in rows])
    with np.errstate(over="ignore"):
        single = expected.astype(np.float32)
    keep = (np.abs(single) <= np.float32(1e15)).all(axis=1)
    if keep.sum() < 2:
        assert shape == ()
        return
    assert isinstance(shape[0].shape, Line)
    np.testing.assert_array_max_ulp(shape[0].shape.points, single[keep], maxulp=1)


GOOD = ["0", "-0", "0.5", "1e5", "1E+5", "1e-400", "12345678901234567890123", "NaN", "-Infinity"]
BAD = ["01", "-", "+1", ".5", "1.", "1e", "1e+", "--1", "1-1", "Nan", "-NaN", "Inf", "1 2", "e", "[1]"]
BAD += ["nul", "nulll", "-null", "Null", '"null"', "nuln"]


@pytest.mark.parametrize("number", GOOD + BAD)
def test_number_grammar_of_extracted_arrays(number: str) -> None:
    points = f"[{'[1, 2, 3], ' * 100}[4, {number}, 6]]"
    text = f'{{"setgeometry": [{{"path": ["p"], "geometry": {{"type": "line", "points": {points}}}}}]}}'
    if number in BAD:
        try:
            request = read(text)
        except UnreadableRequestError as error:
            assert "not valid JSON" in str(error)
        else:
            assert "points has" in request.failures[0].reason
        return
    line: Any = read(text).geometries[0][1][0].shape
    value = float(json.loads(number))
    if abs(value) <= 1e15:
        assert line.points[-1, 1] == np.float32(value)
    else:
        assert len(line.points) == 100


def test_clients_cannot_forge_references() -> None:
    rows = [[0.0, 1.0, 2.0]] * 100
    for name in ("\x00", "\x00" + "0" * 24):
        data = {
            "setgeometry": [
                {"path": [name], "geometry": {"type": "line", "points": rows}},
                {"path": ["b"], "geometry": {"type": "line", "points": [{name: 0}]}},
            ]
        }
        request = read(data)
        assert request.geometries[0][0] == (name,)
        assert "points has something that is not a number" in request.failures[0].reason


@pytest.mark.parametrize("numbers", [[0.5] * 300, [[1, 2, 3]] * 100], ids=["numbers", "rows"])
def test_only_arrays_may_be_long_lists_of_numbers(numbers: Any) -> None:
    box = {"type": "box", "lengths": [1, 2, 3]}
    refused = [
        {"path": numbers, "geometry": box},
        {"path": [numbers], "geometry": box},
        {"path": ["a"], "geometry": {**box, "transform": numbers}},
        {"path": ["a"], "geometry": {**box, "lengths": numbers}},
        {"path": ["a"], "geometry": {"type": "text", "text": numbers}},
        {"path": ["a"], "geometry": numbers},
        {"path": ["a"], "geometries": numbers},
        numbers,
    ]
    request = read({"setgeometry": refused, "settransform": [{"path": ["a"], "transform": numbers}]})
    assert (request.geometries, request.transforms) == ([], [])
    assert len(request.failures) == len(refused) + 1
    assert all("\\u0000" not in failure.reason for failure in request.failures)


@pytest.mark.parametrize(("count", "taken_out"), [(MIN_NUMBERS - 1, False), (MIN_NUMBERS, True)])
def test_extracts_arrays_from_the_minimum_on(count: int, taken_out: bool) -> None:
    text = json.dumps({"ranges": [1.5] * count}).encode()
    assert (NumberArrays().extract(memoryview(text)) != text) is taken_out


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
    """JSON.jl and nlohmann/json write null for NaN; nil in MessagePack is the same."""

    def request(hole: Any) -> bytes:
        command = {"setgeometry": [{"path": ["it"], "geometries": geometries(count, hole)}]}
        return wire.encode(msgspec.msgpack.encode(command), 7, wire.BINARY) if binary else message(command)

    answer, found = shown(request(None))
    expected_answer, expected = shown(request(float("nan")))
    assert answer == expected_answer
    assert len(found) == len(expected) > 5
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)
