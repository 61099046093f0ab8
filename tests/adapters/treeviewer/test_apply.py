"""Execution of requests on the tree, and the limits of the tree."""

import gc
from typing import Any

import numpy as np
import pytest

from gateway.adapters.treeviewer.config import Limits
from gateway.adapters.treeviewer.protocol import TreeViewerProtocol, client_of, response_channel
from scenegate.messages import wire
from scenegate.messages.geometry import Box, Sphere
from tests.adapters.treeviewer.conversation import BOX, Viewer, message

POSE = {"translation": [1, 2, 3], "quaternion": [1, 0, 0, 0]}
LINE = {"type": "line", "points": [[0, 0, 0], [1, 1, 1]]}


def test_order_of_execution(viewer: Viewer) -> None:
    viewer.tell({"setgeometry": [{"path": ["a"], "geometry": LINE}, {"path": ["a", "b"], "geometry": LINE}]})
    answer = viewer.tell(
        {
            "settransform": [{"path": ["a"], "transform": POSE}],
            "setgeometry": [{"path": ["a"], "geometry": BOX}],
            "delete": [{"path": ["a"]}],
        }
    )
    assert answer["status"] == 0
    assert viewer.paths() == {("a",)}
    assert [part.shape for part in viewer.parts("a")] == [Box((1, 2, 3))]
    assert viewer.node("a").pose == (1, 2, 3, 1, 0, 0, 0)


def test_one_message_is_one_revision(viewer: Viewer) -> None:
    seen = []
    viewer.live.listen(lambda: seen.append(viewer.live.snapshot.revision))
    viewer.tell({"setgeometry": [{"path": [i], "geometry": BOX} for i in range(5)], "delete": [{"path": []}]})
    viewer.tell({"settransform": [{"path": [i], "transform": POSE} for i in range(5)]})
    assert seen == [1, 2]


def test_geometry_keeps_transform_and_children(viewer: Viewer) -> None:
    viewer.publish(BOX)
    viewer.publish(BOX, path=["it", "child"])
    viewer.tell({"settransform": [{"path": ["it"], "transform": POSE}]})
    viewer.publish({"type": "sphere", "radius": 1})
    assert [part.shape for part in viewer.parts()] == [Sphere(1)]
    assert viewer.node("it").pose is not None
    assert viewer.paths() == {("it",), ("it", "child")}


def test_transform_before_geometry(viewer: Viewer) -> None:
    command = {"path": ["a", "b"], "transform": POSE}
    assert viewer.tell({"settransform": [command]})["missing_paths"] == [["a", "b"]]
    assert viewer.publish(BOX, path=["a", "b"])["status"] == 0
    assert viewer.tell({"settransform": [command, command]})["set_transforms"] == [["a", "b"]]
    assert viewer.node("a", "b").pose == (1, 2, 3, 1, 0, 0, 0)


def test_missing_paths_have_no_geometry_at_or_below(viewer: Viewer) -> None:
    viewer.publish(path=["empty"])
    viewer.publish(BOX, path=["a", "b", "c"])
    paths: list[Any] = [["empty"], ["a"], ["a", "b", "c"], ["a", "x"], ["z"], []]
    answer = viewer.tell({"settransform": [{"path": path, "transform": {}} for path in paths]})
    assert (answer["status"], answer["missing_paths"]) == (1, [["a", "x"], ["z"]])
    viewer.tell({"delete": [{"path": ["a", "b", "c"]}]})
    answer = viewer.tell({"settransform": [{"path": path, "transform": {}} for path in paths]})
    assert answer["missing_paths"] == [["a"], ["a", "b", "c"], ["a", "x"], ["z"]]


def test_deletes_the_root_and_missing_paths(viewer: Viewer) -> None:
    viewer.publish(BOX, path=[])
    viewer.publish(BOX)
    assert viewer.tell({"delete": [{"path": ["never"]}, {"path": ["never"]}]})["deleted_paths"] == [["never"]]
    assert viewer.tell({"delete": [{"path": []}]})["deleted_paths"] == [[]]
    assert viewer.paths() == set()
    assert viewer.tell({"settransform": [{"path": [], "transform": {}}]})["missing_paths"] == [[]]


def test_many_slices_give_the_same_result() -> None:
    request = {
        "delete": [{"path": ["it", i]} for i in range(3)],
        "setgeometry": [{"path": ["it", i], "geometry": BOX} for i in range(7)],
        "settransform": [{"path": ["it", i], "transform": POSE} for i in range(9)],
    }
    answers = []
    for most in (1, 2, 5, 8, 1000):
        viewer = Viewer()
        for i in range(3):
            viewer.publish(BOX, path=["it", i])
        applier = viewer.protocol.read(wire.decode(message(request)))
        assert len(list(applier.slices(most))) == -(-19 // most)
        assert viewer.live.snapshot.revision == 3 + 1
        answers.append(applier.response(7))
        assert {path for path, node in viewer.live.snapshot.root.walk() if node.pose} == {("it", i) for i in range(9)}
    assert all(answer == answers[0] for answer in answers)


@pytest.mark.parametrize(
    ("channel", "client", "answer"),
    [
        ("DIRECTOR_TREE_VIEWER_REQUEST", "", "DIRECTOR_TREE_VIEWER_RESPONSE"),
        ("DIRECTOR_TREE_VIEWER_REQUEST_<py_1_2>", "py_1_2", "DIRECTOR_TREE_VIEWER_RESPONSE_<py_1_2>"),
        ("DIRECTOR_TREE_VIEWER_REQUEST_<a<b>c>", "a<b>c", "DIRECTOR_TREE_VIEWER_RESPONSE_<a<b>c>"),
        ("DIRECTOR_TREE_VIEWER_REQUEST_<>", "", "DIRECTOR_TREE_VIEWER_RESPONSE"),
        ("DIRECTOR_TREE_VIEWER_REQUEST_foo", "", "DIRECTOR_TREE_VIEWER_RESPONSE"),
        ("DIRECTOR_TREE_VIEWER_REQUEST_>x<", "", "DIRECTOR_TREE_VIEWER_RESPONSE"),
    ],
)
def test_response_channel(channel: str, client: str, answer: str) -> None:
    assert client_of(channel) == client
    assert response_channel(channel) == answer


def test_formats_and_versions() -> None:
    protocol = Viewer().protocol
    for name, version, status in (
        ("treeviewer_json", (1, 0), 0),
        ("treeviewer_json", (1, 1), -2),
        ("treeviewer_json", (2, 0), -2),
        ("other", (1, 0), -1),
        ("other", (9, 9), -1),
    ):
        answer = protocol.handle(wire.encode(b"{}", 3, name, version))
        assert (answer.status, answer.timestamp) == (status, 3)


# --- limits of the tree


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def bounded(limits: Limits) -> tuple[Viewer, Clock]:
    viewer, clock = Viewer(limits), Clock()
    viewer.protocol = TreeViewerProtocol(viewer.live, limits, clock=clock)
    return viewer, clock


@pytest.mark.parametrize("kind", ["setgeometry", "settransform"])
def test_limits_nodes(kind: str) -> None:
    viewer, clock = bounded(Limits(nodes=10))

    def fill(*names: str) -> dict[str, Any]:
        return viewer.tell({kind: [{"path": ["p", name], "geometry": BOX, "transform": POSE} for name in names]})

    answer = fill(*"abcdefghijkl")
    assert answer["status"] == -3
    assert len(answer["added_geometries"] + answer["set_transforms"]) == 8, "with the root and their parent, 10"
    assert "the tree has 10 nodes, the limit is 10" in answer["errors"][0]["reason"]
    assert len(answer["errors"]) == 4
    assert fill("a", "h")["status"] in (0, 1), "what exists can be changed"
    viewer.tell({"delete": [{"path": ["p", name]} for name in "abc"]})
    clock.now += 2
    assert fill("x", "y", "z")["status"] in (0, 1), "what was deleted makes room"


def test_limits_geometries() -> None:
    viewer, clock = bounded(Limits(parts=10))
    for _ in range(20):
        clock.now += 2
        assert viewer.publish(*[BOX] * 5)["status"] == 0
    clock.now += 2
    assert "the tree has 5 geometries, the limit is 10" in viewer.publish(*[BOX] * 6, path=["other"])["error"]


def test_limits_array_bytes_until_freed() -> None:
    cloud = {"type": "pointcloud", "points": [[0, 0, 0]] * 1000}
    viewer, _ = bounded(Limits(geometry_bytes=30_000))
    for name in "ab":
        assert viewer.publish(cloud, path=[name])["status"] == 0
    assert viewer.protocol.quota.array_bytes == 24_000
    answer = viewer.publish(cloud, path=["c"])
    assert "holds 24000 bytes and 12000 more are wanted, the limit is 30000" in answer["error"]
    kept = viewer.live.snapshot
    viewer.tell({"delete": [{"path": ["a"]}]})
    assert viewer.publish(cloud, path=["c"])["status"] == -3, "somebody may still be drawing it"
    del kept
    gc.collect()
    assert viewer.publish(cloud, path=["c"])["status"] == 0
    assert viewer.protocol.quota.array_bytes == 24_000


def test_counts_edits_of_other_interfaces() -> None:
    viewer, clock = bounded(Limits(nodes=10))
    with viewer.live.edit() as edit:
        for i in range(9):
            edit.set_matrix((i,), np.eye(4))
    clock.now += 2
    answer = viewer.tell({"setgeometry": [{"path": ["x", i], "geometry": BOX} for i in range(10)]})
    assert answer["status"] == -3
    assert "the tree has" in answer["error"]
