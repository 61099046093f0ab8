"""Reading of requests: tolerance, reasons, limits."""

import json
import math
from typing import Any

import pytest

from gateway.adapters.treeviewer.config import Limits
from scenegate.messages.geometry import Box
from tests.adapters.treeviewer.conversation import BOX, Viewer

POSE = {"translation": [1, 2, 3], "quaternion": [1, 0, 0, 0]}


@pytest.mark.parametrize(
    "request_",
    [
        pytest.param({}, id="no lists"),
        pytest.param({"setgeometry": None, "settransform": None, "delete": None}, id="null lists"),
        pytest.param({"setgeometry": {}, "settransform": {}, "delete": {}}, id="objects for lists"),
        pytest.param({"setgeometry": [None], "settransform": [None], "delete": [None]}, id="null commands"),
        pytest.param({"utime": 5, "list": [0, 1, 2]}, id="keys without a meaning"),
        pytest.param("null", id="null"),
    ],
)
def test_accepts_empty_requests(viewer: Viewer, request_: Any) -> None:
    lists = ("deleted_paths", "added_geometries", "set_transforms", "missing_paths")
    assert viewer.tell(request_) == {"timestamp": 7, "status": 0, **{name: [] for name in lists}}
    assert viewer.live.snapshot.revision == 0


BOX_AT_A = {"path": ["a"], "geometry": BOX}
POSE_OF_A = {"path": ["a"], "transform": {"translation": [0, 0, 1]}}


@pytest.mark.parametrize(
    "request_",
    [
        {"settransforms": [POSE_OF_A], "unknown": 1},
        {"setgeometry": [{**BOX_AT_A, "unknown": 1}]},
        {"setgeometry": [{"path": ["a"], "geometry": {**BOX, "transform": {"unknown": 1}}}]},
        {"settransform": [POSE_OF_A, {**POSE_OF_A, "unknown": 1}]},
        {"settransform": [{"path": ["a"], "transform": {"unknown": 1, "translation": [0, 0, 0]}}]},
        {"delete": [{"path": ["a"], "unknown": 1}]},
        {"setproperty": [{"path": ["a"], "visible": True, "unknown": 1}]},
        {"setview": {"grid": None, "unknown": 1}},
    ],
)
def test_unknown_fields_are_ignored_with_a_warning(viewer: Viewer, request_: Any) -> None:
    viewer.tell({"setgeometry": [BOX_AT_A]})
    answer = viewer.tell(request_)
    assert answer["status"] == 0
    (warning,) = answer["warnings"]
    assert '"unknown"' in warning
    assert "warnings" not in viewer.tell({"setgeometry": [BOX_AT_A], "settransform": [POSE_OF_A]})


@pytest.mark.parametrize(
    "command",
    [
        {"geometry": BOX},
        {"geometries": [BOX]},
        {"geometries": BOX},
        {"geometry": BOX, "geometries": [{"type": "sphere", "radius": 1}]},
        {"geometry": None, "geometries": [BOX]},
        {"geometry": {**BOX, "extra": 1}, "extra": 2},
        {"geometry": {**BOX, "color": None, "transform": None}},
    ],
)
def test_geometry_and_geometries(viewer: Viewer, command: dict[str, Any]) -> None:
    answer = viewer.tell({"setgeometry": [{"path": ["a"], **command}]})
    assert (answer["status"], answer["added_geometries"]) == (0, [["a"]])
    assert [part.shape for part in viewer.parts("a")] == [Box((1, 2, 3))]


@pytest.mark.parametrize("command", [{}, {"geometry": None}, {"geometries": None}])
def test_rejects_setgeometry_without_geometry(viewer: Viewer, command: dict[str, Any]) -> None:
    answer = viewer.tell({"setgeometry": [{"path": ["a"], **command}, {"path": ["b"], "geometries": []}]})
    assert answer["status"] == -3
    error = {"command": "setgeometry", "index": 0, "path": ["a"], "reason": "geometries is missing"}
    assert answer["errors"] == [error]
    assert answer["added_geometries"] == [["b"]]


@pytest.mark.parametrize(
    ("path", "echoed"),
    [
        ([], []),
        (["a", "b"], ["a", "b"]),
        (["a/b"], ["a/b"]),
        ("a/b", ["a", "b"]),
        ("/a//b/", ["a", "b"]),
        ("", []),
        (["", ""], ["", ""]),
        (["ü", "箱", "🤖", 'q"', "\\", "\t"], ["ü", "箱", "🤖", 'q"', "\\", "\t"]),
        ([0, "0", -5, 2**64 - 1], [0, "0", -5, 2**64 - 1]),
    ],
)
def test_paths(viewer: Viewer, path: Any, echoed: list[Any]) -> None:
    answer = viewer.tell(
        {"setgeometry": [{"path": path, "geometry": BOX}], "settransform": [{"path": path, "transform": POSE}]}
    )
    assert (answer["status"], answer["added_geometries"], answer["set_transforms"]) == (0, [echoed], [echoed])
    assert viewer.parts(*echoed) if echoed else viewer.live.snapshot.root.parts
    assert viewer.tell({"delete": [{"path": path}]})["deleted_paths"] == [echoed]
    assert not viewer.paths()


def test_a_number_and_its_text_are_different_names(viewer: Viewer) -> None:
    viewer.tell({"setgeometry": [{"path": [1], "geometry": BOX}]})
    assert viewer.tell({"settransform": [{"path": ["1"], "transform": {}}]})["missing_paths"] == [["1"]]


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        ([None], "path[0] must be a string or an integer, not null"),
        ([True], "path[0] must be a string or an integer, not true"),
        ([1.0], "path[0] must be a string or an integer, not 1.0"),
        (["a", ["b"]], 'path[1] must be a string or an integer, not ["b"]'),
        ([2**64], "path[0] is a number of more than 64 bits"),
        (["\ud800"], "path[0] is not Unicode text: <str>"),
        ({"a": 1}, 'path must be a list of strings, not {"a": 1}'),
        (None, "path must be a list of strings, not null"),
        (5, "path must be a list of strings, not 5"),
        (["x"] * 129, "path has 129 elements, the limit is 128"),
        (["x"] * 300, "path has 300 elements, the limit is 128"),
        (list(range(300)), "path has more than 128 elements"),
        (["x" * 4097], "path[0] has 4097 characters, the limit is 4096"),
    ],
)
@pytest.mark.parametrize("kind", ["delete", "setgeometry", "settransform"])
def test_bad_paths(viewer: Viewer, kind: str, path: Any, reason: str) -> None:
    bad: dict[str, Any] = {"path": path, "geometry": BOX, "transform": POSE}
    if len(json.dumps(path)) > 1000 and kind == "setgeometry":
        bad["geometry"] = {"type": "line", "points": [[0, 0, 0]] * 100}
        reason = reason.replace("has more than 128 elements", "has 300 elements, the limit is 128")
    answer = viewer.tell({kind: [bad, {**bad, "path": ["good"]}]})
    assert answer["status"] == -3
    said = [error["reason"] for error in answer["errors"]]
    assert said in ([reason], [reason.replace("has more than 128 elements", "has 300 elements, the limit is 128")])
    assert answer["errors"][0]["command"] == kind
    done = {"delete": "deleted_paths", "setgeometry": "added_geometries", "settransform": "set_transforms"}[kind]
    assert answer[done] == [["good"]]


def test_directors_older_keys_override_the_new_ones(viewer: Viewer) -> None:
    answer = viewer.tell(
        {
            "load": [{"path": ["old"], "geometry": BOX}],
            "setgeometry": [{"path": ["new"], "geometry": BOX}],
            "draw": [{"path": ["old"], "transform": POSE}],
            "settransform": [{"path": ["new"], "transform": POSE}],
        }
    )
    assert (answer["status"], answer["added_geometries"], answer["set_transforms"]) == (0, [["old"]], [["old"]])


def test_one_bare_command_counts_as_a_list(viewer: Viewer) -> None:
    answer = viewer.tell(
        {"setgeometry": {"path": ["a"], "geometry": BOX}, "settransform": {"path": ["a"], "transform": POSE}}
    )
    assert (answer["status"], answer["added_geometries"], answer["set_transforms"]) == (0, [["a"]], [["a"]])


@pytest.mark.parametrize(
    ("transform", "expected"),
    [
        ({}, (0, 0, 0, 1, 0, 0, 0)),
        ({"translation": None, "quaternion": None}, (0, 0, 0, 1, 0, 0, 0)),
        ({"translation": [1, 2, 3]}, (1, 2, 3, 1, 0, 0, 0)),
        ({"quaternion": [0, 1, 0, 0], "scale": [2, 2, 2]}, (0, 0, 0, 0, 1, 0, 0)),
        ({"translation": [True, False, 0]}, (1, 0, 0, 1, 0, 0, 0)),
    ],
)
def test_transforms(viewer: Viewer, transform: dict[str, Any], expected: tuple[float, ...]) -> None:
    assert viewer.tell({"settransform": [{"path": ["a"], "transform": transform}]})["status"] == 1
    assert viewer.node("a").pose == expected


@pytest.mark.parametrize(
    ("transform", "reason"),
    [
        ([], "transform must be an object with translation and quaternion, not []"),
        (None, "transform must be an object with translation and quaternion, not null"),
        ({"translation": [1, 2]}, "transform.translation has 2 numbers, not 3"),
        ({"translation": 5}, "transform.translation must be a list of 3 numbers, not 5"),
        ({"translation": ["1", 2, 3]}, 'transform.translation must be a number, not "1"'),
        ({"quaternion": [1, 0, 0]}, "transform.quaternion has 3 numbers, not 4"),
        ({"quaternion": [1, 0, None, 0]}, "transform.quaternion must be a number, not null"),
    ],
)
def test_bad_transforms(viewer: Viewer, transform: Any, reason: str) -> None:
    answer = viewer.tell({"settransform": [{"path": ["a"], "transform": transform}]})
    assert (answer["status"], answer["errors"][0]["reason"]) == (-3, reason)
    assert viewer.live.snapshot.revision == 0


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999", "1" + "0" * 400])
def test_keeps_nan_and_infinity(viewer: Viewer, number: str) -> None:
    text = f'{{"settransform": [{{"path": ["a"], "transform": {{"translation": [{number}, 0, 1]}}}}]}}'
    answer = viewer.tell(text)
    assert answer["status"] == 1, answer
    assert answer["warnings"] == ['settransform[0] ["a"]: transform is not finite, so nothing below it is drawn']
    pose: Any = viewer.node("a").pose
    assert not math.isfinite(pose[0])
    assert viewer.node("a").matrix.shape == (4, 4)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "not valid JSON"),
        ("{", "not valid JSON"),
        ("[" * 100_000, "nested too deeply"),
        ('{"a":' * 50_000 + "1" + "}" * 50_000, "nested too deeply"),
        ('{"setgeometry": [' + "[" * 3000 + "]" * 3000 + "]}", "a command must be an object"),
        ('{"a": ' + "1" * 5000 + "}", None),
        (f'{{"settransform": [{{"path": ["a"], "transform": {{"translation": [{"1" * 5000}, 0, 0]}}}}]}}', "not valid"),
        ("[]", "must be a JSON object, not []"),
        ('"x"', "must be a JSON object"),
        ("\ud800", "continuation byte"),
        ('{"delete": [], }', "not valid JSON"),
        ("{'delete': []}", "not valid JSON"),
    ],
)
def test_survives_bombs_and_damage(viewer: Viewer, text: str, reason: str | None) -> None:
    answer = viewer.tell(text)
    if reason is not None and answer["status"] != 0:
        assert answer["status"] == -3
        assert reason in answer["error"] or "nested too deeply" in answer["error"]
    assert viewer.tell({"setgeometry": [{"path": ["a"], "geometry": BOX}]})["status"] == 0


def test_the_last_of_equal_keys_counts(viewer: Viewer) -> None:
    viewer.tell('{"delete": [1], "delete": [], "settransform": [{"path": ["a"], "path": ["b"], "transform": {}}]}')
    assert viewer.live.snapshot.root.find(("b",)) is not None
    assert viewer.live.snapshot.root.find(("a",)) is None


def test_limits_listed_problems() -> None:
    viewer = Viewer(Limits(problems=3))
    answer = viewer.tell({"delete": [5] * 10})
    assert len(answer["errors"]) == 3
    assert answer["error"].endswith("(and 9 more)")


@pytest.mark.parametrize("command", ["delete", "setgeometry", "settransform"])
def test_limits_failed_commands(command: str) -> None:
    good = {"path": ["good"], "geometries": [BOX]}
    viewer = Viewer(Limits(failed_commands=20))
    answer = viewer.tell({"setgeometry": [good], command: [{"path": 5.5}] * 20} | {"x": 1})
    assert answer["error"].endswith("(and 19 more)")
    answer = viewer.tell({"setgeometry": [good], "delete": [5.5] * 10, command: [{"path": 5.5}] * 21})
    assert answer["status"] == -3
    assert answer["error"].startswith("more than 20 commands cannot be executed, so nothing is done; ")
