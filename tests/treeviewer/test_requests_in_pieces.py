"""The fast ways of reading requests, in pieces and with arrays taken out, read the same as the slow one."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.scene.geometry import Line, PointCloud
from gateway.treeviewer import slices
from gateway.treeviewer.config import Limits
from gateway.treeviewer.requests import Request, RequestError, RequestReader

NAN = float("nan")


def whole(data: dict[str, Any], **how: Any) -> Request:
    return RequestReader(Limits()).read(memoryview(json.dumps(data).encode()), **how)


def same(one: Request, other: Request) -> None:
    assert (one.deletes, one.transforms, one.failures, one.warnings) == (
        *(other.deletes, other.transforms, other.failures),
        other.warnings,
    )
    assert [path for path, _ in one.geometries] == [path for path, _ in other.geometries]
    for (_, ours), (_, theirs) in zip(one.geometries, other.geometries, strict=True):
        for a, b in zip(ours, theirs, strict=True):
            assert type(a.shape) is type(b.shape)
            if isinstance(a.shape, PointCloud | Line):
                assert isinstance(b.shape, PointCloud | Line)
                np.testing.assert_array_equal(a.shape.points, b.shape.points)


def many_commands(count: int) -> dict[str, Any]:
    return {
        "delete": [{"path": ["gone", i]} for i in range(count)] + [{"no": "path"}],
        "note": "}],[{" * 5,
        "setgeometry": [
            {
                "path": ["it", f"n{i}]", '"\\'],
                "geometry": {"type": "box" if i % 7 else "cone", "lengths": [1, 1, 1 + i]},
            }
            for i in range(count)
        ],
        "settransform": [
            {"path": ["it", i], "transform": {"translation": [i, NAN if i == 77 else 1, 0]}} for i in range(count)
        ],
    }


def test_a_request_read_in_pieces_says_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    data = many_commands(3000)
    in_one = whole(data)
    assert in_one.commands > 8000
    assert {failure.index for failure in in_one.failures if failure.command == "setgeometry"} == set(range(0, 3000, 7))
    monkeypatch.setattr(slices, "LEAST_CUT", 10)
    monkeypatch.setattr(slices, "SLICE_BYTES", 1000)
    cut = slices.pieces(json.dumps(data).encode())
    assert cut is not None
    assert len(list(cut)) > 100
    in_pieces = whole(data)
    for request in (in_one, in_pieces):
        request.transforms = [(path, tuple(map(str, pose))) for path, pose in request.transforms]
    same(in_pieces, in_one)


@pytest.mark.parametrize(
    "text",
    [
        '{"delete": [] "x": 1}',
        '{"delete": [],}',
        '{"delete": []}{"delete": []}',
        '{}{"delete": []}',
        '{"delete": [{"path": ["a"]},]}',
        '{"delete": [{"path": ["a"]}, ,{"path": ["a"]}]}',
        '{"delete": [{"path": ["a"]}]] }',
        '{"delete": [{"path": ["a"}]]}',
        '{"delete" []}',
        '{"delete": [1 2]}',
        "{delete: []}",
        '{"delete": [{"path": ["a"]}]',
        '{"delete": [{"path": ["a]}]}',
        '{"unknown": [1, }',
        '[{"delete": []}]',
        "  ",
    ],
)
def test_pieces_of_damaged_text_are_refused_like_the_whole(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    reader = RequestReader(Limits())
    monkeypatch.setattr(slices, "LEAST_CUT", 1)
    monkeypatch.setattr(slices, "SLICE_BYTES", 1)
    with pytest.raises(RequestError):
        reader.read(memoryview(text.encode()))


@settings(deadline=None, max_examples=300)
@given(
    st.recursive(
        st.none() | st.booleans() | st.integers(-5, 5) | st.text(max_size=4),
        lambda inner: (
            st.lists(inner, max_size=4)
            | st.dictionaries(
                st.sampled_from(["delete", "setgeometry", "draw", "path", "geometry", ']"\\']), inner, max_size=4
            )
        ),
        max_leaves=30,
    )
)
def test_any_json_reads_the_same_in_pieces(data: Any) -> None:
    reader = RequestReader(Limits())
    text = memoryview(json.dumps(data).encode())
    results: list[Any] = []
    for least, size in ((1 << 30, 1), (1, 1), (1, 20)):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(slices, "LEAST_CUT", least)
            patch.setattr(slices, "SLICE_BYTES", size)
            try:
                results.append(reader.read(text))
            except RequestError as error:
                results.append(str(error))
    for result in results[1:]:
        if isinstance(result, str):
            assert result == results[0]
        else:
            same(result, results[0])


NUMBERS = st.floats(width=64, allow_nan=True, allow_infinity=True) | st.integers(-(10**25), 10**25)


@settings(deadline=None, max_examples=100)
@given(st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=90, max_size=200), st.sampled_from([None, 1, "\t"]))
def test_taken_out_arrays_are_what_pythons_json_reads(rows: list[tuple[float, float, float]], indent: Any) -> None:
    data = {"setgeometry": [{"path": ["p"], "geometry": {"type": "line", "points": rows}}]}
    text = memoryview(json.dumps(data, indent=indent).encode())
    shape = RequestReader(Limits()).read(text, extract=True).geometries[0][1]
    expected = np.array([[float(v) for v in row] for row in rows])
    with np.errstate(over="ignore"):
        single = expected.astype(np.float32)
    keep = (np.abs(single) <= np.float32(1e15)).all(axis=1)
    if keep.sum() < 2:
        assert shape == ()
        return
    assert isinstance(shape[0].shape, Line)
    np.testing.assert_array_max_ulp(shape[0].shape.points, single[keep], maxulp=1)


@pytest.mark.parametrize(
    ("number", "good"),
    [
        *(
            (text, True)
            for text in ("0", "-0", "0.5", "1e5", "1E+5", "1e-400", "12345678901234567890123", "NaN", "-Infinity")
        ),
        *(
            (text, False)
            for text in (
                "01",
                "-",
                "+1",
                ".5",
                "1.",
                "1e",
                "1e+",
                "--1",
                "1-1",
                "Nan",
                "-NaN",
                "Inf",
                "1 2",
                "e",
                "[1]",
            )
        ),
    ],
)
def test_the_grammar_of_numbers_in_taken_out_arrays(number: str, good: bool) -> None:
    text = (
        '{"setgeometry": [{"path": ["p"], "geometry": {"type": "line", "points": ['
        + "[1, 2, 3], " * 100
        + f"[4, {number}, 6]"
        + "]}}]}"
    )
    reader = RequestReader(Limits())
    if not good:
        try:
            request = reader.read(memoryview(text.encode()), extract=True)
        except RequestError as error:
            assert "not valid JSON" in str(error)
        else:
            assert "points has" in request.failures[0].reason
        return
    line = reader.read(memoryview(text.encode()), extract=True).geometries[0][1][0].shape
    assert isinstance(line, Line)
    value = float(json.loads(number))
    if abs(value) <= 1e15:
        assert line.points[-1, 1] == np.float32(value)
    else:
        assert len(line.points) == 100


def test_no_client_can_write_the_name_of_a_taken_out_array() -> None:
    reader = RequestReader(Limits())
    rows = [[0.0, 1.0, 2.0]] * 100
    for name in ("\x00:0", "\x00" + "0" * 24 + ":0"):
        data = {
            "setgeometry": [
                {"path": [name], "geometry": {"type": "line", "points": rows}},
                {"path": ["b"], "geometry": {"type": "line", "points": name}},
            ]
        }
        request = reader.read(memoryview(json.dumps(data).encode()), extract=True)
        assert request.geometries[0][0] == (name,)
        assert "points must be a list" in request.failures[0].reason
