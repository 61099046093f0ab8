"""What the tree viewer's client makes of responses, with a connection that only records."""

import logging
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from typing import Any

import msgspec
import numpy as np
import pytest

from scenegate.messages import wire
from scenegate.messages.changes import Changes, Entry, path_of
from scenegate.messages.geometry import Box, PointCloud, Sphere
from scenegate.messages.request_encoding import Response, encode_request
from scenegate.tree import requests as requests_module
from scenegate.tree import viewer as viewer_module
from scenegate.tree.answer import Answer, TreeViewerError
from scenegate.tree.requests import SentRequest
from scenegate.tree.viewer import MAX_LOGGED, TreeViewer
from tests.support.waiting import SECONDS


class FakeConnection:
    """Answers every request with the next body."""

    url = "tcpq://fake"

    is_connected = True

    def __init__(self, _: str | None, handlers: dict[str, Callable[[bytes], None]], __: float) -> None:
        self.respond, self.announce = handlers.values()
        self.bodies: list[dict[str, Any]] = []
        self.requests: list[dict[str, Any]] = []

    def publish(self, channel: str, message: Any, failed: Any) -> None:
        request = wire_body(message)
        self.requests.append(request)
        if self.bodies:
            self.respond(response(**{"timestamp": request["timestamp"], **self.bodies.pop(0)}))

    def run_in_turn(self, calls: Iterable[Callable[[], None]]) -> None:
        for call in calls:
            call()

    def close(self) -> None:
        """Nothing to close."""


def wire_body(message: Any) -> dict[str, Any]:
    data = bytes(message)
    body: dict[str, Any] = msgspec.json.decode(data[data.index(b'{"') :])
    return body


def response(**body: Any) -> bytes:
    return bytes(encode_request(body, 0, wire.JSON))


@pytest.fixture
def viewer(monkeypatch: pytest.MonkeyPatch) -> Iterator[TreeViewer]:
    monkeypatch.setattr(requests_module, "LcmConnection", FakeConnection)
    with TreeViewer(timeout=SECONDS, binary=False) as viewer:
        yield viewer


def connection(viewer: TreeViewer) -> Any:
    return viewer.requests.connection


def test_paths_and_warnings_of_a_response(viewer: TreeViewer) -> None:
    paths = {"deleted_paths": [["a"]], "added_geometries": [["b", 1]], "set_transforms": [["c"], ["d"]]}
    connection(viewer).bodies = [{"status": 0, **paths, "warnings": ["odd"]}]
    assert viewer["a"].set(Sphere(1)) == Answer(0, (("a",),), (("b", 1),), (("c",), ("d",)), (), ("odd",), "")


def test_each_warning_is_logged_once(viewer: TreeViewer, caplog: pytest.LogCaptureFixture) -> None:
    connection(viewer).bodies = [{"status": 0, "warnings": texts} for texts in (["odd", "big"], ["odd"], ["small"])]
    with caplog.at_level(logging.WARNING, "scenegate.tree.viewer"):
        for _ in range(3):
            viewer["a"].set(Sphere(1))
    assert [record.getMessage().rpartition(": ")[2] for record in caplog.records] == ["odd", "big", "small"]


def test_a_flood_of_warnings_is_not_logged(viewer: TreeViewer, caplog: pytest.LogCaptureFixture) -> None:
    connection(viewer).bodies = [{"status": 0, "warnings": [f"pose {i} is odd" for i in range(MAX_LOGGED + 50)]}]
    with caplog.at_level(logging.WARNING, "scenegate.tree.viewer"):
        viewer["a"].set(Sphere(1))
    assert len(caplog.records) == MAX_LOGGED + 1
    assert caplog.records[-1].message.endswith("in the answers only")


@pytest.mark.parametrize(("errors", "more"), [(0, ""), (1, ""), (2, " (2 commands failed)")])
def test_the_number_of_failed_commands_is_added_from_two_on(viewer: TreeViewer, errors: int, more: str) -> None:
    connection(viewer).bodies = [{"status": -3, "error": "no", "errors": ["x"] * errors}]
    with pytest.raises(TreeViewerError) as caught:
        viewer["a"].set(Sphere(1))
    assert str(caught.value) == f"no{more}"
    assert caught.value.answer.error == f"no{more}"


def test_an_error_without_text_has_its_status(viewer: TreeViewer) -> None:
    connection(viewer).bodies = [{"status": -3}]
    with pytest.raises(TreeViewerError, match=r"^the viewer answered with status -3$"):
        viewer["a"].delete()


def test_missing_paths_without_geometry_are_reported(viewer: TreeViewer) -> None:
    connection(viewer).bodies = [{"status": 1, "missing_paths": [["a", "b"]]}]
    answer = viewer["a"]["b"].transform((1, 2, 3))
    assert (answer.status, answer.missing) == (1, (("a", "b"),))
    assert len(connection(viewer).requests) == 1


@pytest.mark.parametrize(
    ("second", "status", "missing"), [({"status": 0}, 0, ()), ({"status": 1, "missing_paths": [["a"]]}, 1, (("a",),))]
)
def test_missing_geometry_is_sent_again(
    viewer: TreeViewer, second: dict[str, Any], status: int, missing: tuple[Any, ...]
) -> None:
    connection(viewer).bodies = [{"status": 0}, {"status": 1, "missing_paths": [["a"]]}, second]
    viewer["a"].set(Sphere(1))
    answer = viewer["a"].transform((1, 2, 3))
    assert (answer.status, answer.missing) == (status, missing)
    sent = connection(viewer).requests[-1]
    assert [entry["path"] for entry in sent["setgeometry"]] == [["a"]]
    assert [entry["path"] for entry in sent["settransform"]] == [["a"]]


def test_a_change_of_another_thread_arrives_after_what_is_sent_again(
    viewer: TreeViewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake = connection(viewer)
    publish = fake.publish
    other = threading.Thread(target=lambda: viewer["a"].transform((2, 0, 0)))

    def publish_slowly(channel: str, message: Any, failed: Any) -> None:
        if wire_body(message)["setgeometry"] and not other.ident:
            other.start()
            other.join(0.1)  # short: it has to wait until this message is on its way
        publish(channel, message, failed)

    fake.bodies = [{"status": 0}]
    viewer["a"].set(Sphere(1))
    monkeypatch.setattr(fake, "publish", publish_slowly)
    fake.bodies = [{"status": 1, "missing_paths": [["a"]]}, {"status": 0}, {"status": 0}]
    viewer["a"].transform((1, 0, 0))
    other.join(SECONDS)
    sent = [request["settransform"][0]["transform"]["translation"] for request in fake.requests[1:]]
    assert sent == [[1, 0, 0], [1, 0, 0], [2, 0, 0]]


def test_the_second_responses_error_is_raised(viewer: TreeViewer) -> None:
    missing, full = {"status": 1, "missing_paths": [["a"]]}, {"status": -4, "error": "full"}
    connection(viewer).bodies = [{"status": 0}, missing, full]
    viewer["a"].set(Sphere(1))
    with pytest.raises(TreeViewerError, match=r"^full$"):
        viewer["a"].transform((1, 2, 3))


def test_times_of_requests_increase(viewer: TreeViewer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("time.time_ns", lambda: 5_000_999)
    connection(viewer).bodies = [{"status": 0}] * 3
    for _ in range(3):
        viewer["a"].delete()
    assert [request["timestamp"] for request in connection(viewer).requests] == [5000, 5001, 5002]


def test_a_viewer_that_has_just_started_gets_everything(viewer: TreeViewer) -> None:
    fake = connection(viewer)
    fake.announce(response(timestamp=0, status=0, ready=True))
    assert fake.requests == [], "nothing is published yet"
    fake.bodies = [{"status": 0}]
    viewer["a"].set(Sphere(1))
    for body in ({"ready": False}, {"ready": 1}, {}):
        fake.announce(response(timestamp=0, status=0, **body))
    assert len(fake.requests) == 1
    fake.announce(response(timestamp=0, status=0, ready=True))
    assert [entry["path"] for entry in fake.requests[1]["setgeometry"]] == [["a"]]
    assert not viewer.requests.pending


def test_everything_is_sent_again_in_parts(viewer: TreeViewer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer_module, "PART_BYTES", 25_000)
    fake = connection(viewer)
    cloud = PointCloud(np.zeros((800, 3)))  # 9.6 kB
    fake.bodies = [{"status": 0, "newer_commands": ["setview", "setproperty"]}] * 20
    for name in "abcde":
        viewer["map", name].set(cloud)
    viewer["huge"].set(PointCloud(np.zeros((5000, 3))))
    viewer.set_view(grid=False)
    run_in_turn = fake.run_in_turn

    def delete_meanwhile(calls: Iterable[Callable[[], None]]) -> None:
        first, *others = calls
        first()
        viewer["map", "c"].delete()
        run_in_turn(others)

    monkeypatch.setattr(fake, "run_in_turn", delete_meanwhile)
    del fake.requests[:]
    fake.announce(response(timestamp=0, status=0, ready=True))
    view, first, deletion, *others = fake.requests
    assert view["setview"] == {"grid": False}
    assert deletion["delete"] == [{"path": ["map", "c"]}]
    paths = [[entry["path"][-1] for entry in request["setgeometry"]] for request in (first, *others)]
    assert paths == [["a", "b"], ["d"], ["e"], ["huge"]]
    fake.bodies = [{"status": 1, "missing_paths": [["map"]]}, {"status": 0}, {"status": 1, "missing_paths": [["x"]]}]
    fake.bodies[0]["newer_commands"] = ["setproperty"]
    del fake.requests[:]
    assert viewer["map"].set_visible(True).missing == (("x",),)
    paths = [[entry["path"][-1] for entry in request["setgeometry"]] for request in fake.requests[1:]]
    assert paths == [["a", "b"], ["d", "e"]]


def test_a_request_beyond_lcms_limit_is_not_sent(viewer: TreeViewer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(requests_module, "MAX_REQUEST_BYTES", 3000)
    with pytest.raises(ValueError, match=r"\d+ bytes.* 3000"):
        viewer["a"].set(*[Box((1, 1, 1))] * 100)
    monkeypatch.setattr(requests_module, "encode_request", None)
    with pytest.raises(ValueError, match=r"at least 6000 bytes, the limit is 3000"):
        viewer["a"].set(PointCloud(np.zeros((2000, 3))))
    connection(viewer).announce(response(timestamp=0, status=0, ready=True))
    assert connection(viewer).requests == [], "it is not recorded, either"


def test_geometry_of_the_root(viewer: TreeViewer) -> None:
    connection(viewer).bodies = [{"status": 0}]
    viewer.set(Sphere(2))
    assert connection(viewer).requests[-1]["setgeometry"][0]["path"] == []


def test_the_response_to_a_big_request_may_take_longer(viewer: TreeViewer, monkeypatch: pytest.MonkeyPatch) -> None:
    times: list[float | None] = []
    future: Future[Response] = Future()
    monkeypatch.setattr(future, "result", times.append)
    viewer.requests.wait(SentRequest(1, future, 50_000_000))
    assert times == [viewer.requests.timeout + 5.0]


@pytest.mark.parametrize(
    ("value", "text"),
    [(3, "3"), ("x" * 38, repr("x" * 38)), ("x" * 39, "'" + "x" * 39 + "…"), ([1], "[1]"), (None, "None")],
)
def test_other_things_than_geometries_are_refused(viewer: TreeViewer, value: Any, text: str) -> None:
    with pytest.raises(TypeError) as caught:
        viewer["a"].set(value)
    assert str(caught.value) == f"set takes geometries such as Box((1, 1, 1)), not {text}"


@pytest.mark.parametrize(
    ("value", "path"),
    [("a/b", ("a", "b")), ("/a//b/", ("a", "b")), ("", ()), (3, (3,)), (("a/b", 1), ("a/b", 1)), ((), ())],
)
def test_paths(value: Any, path: tuple[str | int, ...]) -> None:
    assert path_of(value) == path


@pytest.mark.parametrize("value", [["a", "b"], 1.5, None, b"a", slice(1, 2), np.array([1, 2])])
def test_what_is_no_path(viewer: TreeViewer, value: Any) -> None:
    with pytest.raises(ValueError, match=r"^a path must be "):
        viewer[value]


@pytest.mark.parametrize(
    ("call", "error"),
    [
        (lambda viewer: viewer.set_transforms(["a"], "x"), r"poses must have shape \(1, 7\) for 1 paths, not 'x'"),
        (lambda viewer: viewer.set_transforms(["a"], [[1], [1, 2]]), r"poses .* not \[\[1\], \[1, 2\]\]"),
        (lambda viewer: viewer.set_view(home=5), "home must be eye, target and optionally up, not 5"),
        (lambda viewer: viewer.set_view(background="grau"), "background 'grau' is neither"),
        (lambda viewer: viewer.robot("r", "r.urdf", roots="/tmp"), "roots must be a list of folders, not '/tmp'"),
        (lambda viewer: viewer.robot("r", "r.urdf", gltf_up="x"), "gltf_up must be 'y' or 'z', not 'x'"),
    ],
)
def test_names_invalid_arguments(viewer: TreeViewer, call: Callable[[TreeViewer], Any], error: str) -> None:
    with pytest.raises((TypeError, ValueError), match=f"^{error}"):
        call(viewer)


def test_a_delete_discards_what_was_set_below_it() -> None:
    changes = Changes()
    for path in (("a",), ("a", "b"), ("ab",), ("c",)):
        changes.set_entry(path, Entry([]))
    changes.set_entry(("a", "b"), Entry(transform={"x": 1}))
    changes.delete(("a",))
    assert changes.body() == {
        "delete": [{"path": ("a",)}],
        "setgeometry": [{"path": ("ab",), "geometries": []}, {"path": ("c",), "geometries": []}],
        "settransform": [],
    }


def test_missing_geometry_comes_with_the_transforms_of_its_parents() -> None:
    tree, changes = Changes(), Changes()
    changes.set_entry(("a",), Entry(transform={"x": 1}))
    changes.set_entry(("a", "b"), Entry([{}]))
    changes.set_entry(("a", "c"), Entry([{}]))
    changes.set_entry(("d",), Entry(transform={"x": 2}))
    tree.add(changes)
    again = tree.missing([("a", "b")])
    assert list(again.entries) == [("a", "b"), ("a",)], "a part with the transform only would have a missing path"
    assert (again.entries["a",].geometries, again.entries["a",].transform) == (None, {"x": 1})
    assert tree.missing([("d",)]).entries == {}, "no geometry was published there"
    update = Changes()
    update.set_entry(("a", "b"), Entry(transform={"x": 3}))
    tree.add(update)
    entry = tree.entries["a", "b"]
    assert (entry.geometries, entry.transform) == ([{}], {"x": 3})
