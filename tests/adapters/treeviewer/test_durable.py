"""Responses wait until the tree is stored, keep their order, and report a failed store."""

from collections.abc import Callable

import pytest

from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.dispatch import Dispatcher
from gateway.adapters.treeviewer.protocol import TreeViewerProtocol
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.tree.live import LiveTree
from scenegate.lcm.transport import LcmMessage
from tests.adapters.treeviewer.conversation import BOX, decoded, message
from tests.support.waiting import until

CHANNEL = "DIRECTOR_TREE_VIEWER_REQUEST_<it>"


class Held:
    """A store that finishes when the test wants it."""

    def __init__(self) -> None:
        self.waiting: list[tuple[Callable[[str], None], int]] = []
        self.full = False

    def call_when_stored(self, done: Callable[[str], None], size: int) -> None:
        self.waiting.append((done, size))

    def tell(self, problem: str = "") -> None:
        waiting, self.waiting = self.waiting, []
        for done, _ in waiting:
            done(problem)


class Talk:
    def __init__(self) -> None:
        self.live = LiveTree()
        self.held = Held()
        self.dispatcher = Dispatcher(TreeViewerProtocol(self.live), TreeViewerConfig(), WorkerPool(1), store=self.held)
        self.answers: list[dict[str, object]] = []

    def send(self, utime: int, request: object) -> None:
        self.dispatcher.receive(self._reply, LcmMessage(CHANNEL, message(request, utime)))

    def _reply(self, channel: str, data: bytes) -> None:
        self.answers.append(decoded(data))


@pytest.fixture
def talk() -> Talk:
    return Talk()


def box(name: str) -> object:
    return {"setgeometry": [{"path": [name], "geometries": [BOX]}]}


async def test_responses_wait_for_the_store(talk: Talk) -> None:
    talk.send(1, box("a"))
    talk.send(2, {"settransform": [{"path": ["b"]}]})
    talk.send(3, "no JSON")
    await until(lambda: len(talk.held.waiting) == 3)
    assert talk.answers == []
    assert list(talk.live.snapshot.root.children) == ["a"]
    talk.held.tell()
    assert [(answer["timestamp"], answer["status"]) for answer in talk.answers] == [(1, 0), (2, -3), (3, -3)]
    assert "stored" not in str(talk.answers)


def test_reports_failed_store(talk: Talk) -> None:
    talk.send(1, box("a"))
    talk.held.tell("the disk is full")
    (answer,) = talk.answers
    assert answer["status"] == -3
    assert answer["added_geometries"] == [["a"]]
    assert answer["error"] == "the tree has been changed, but the change could not be stored: the disk is full"
    assert talk.dispatcher.counters.failed == 1


def test_refuses_requests_while_the_store_is_full(talk: Talk) -> None:
    talk.send(1, box("a"))
    talk.held.full = True
    talk.send(2, box("b"))
    assert [(answer["timestamp"], answer["status"]) for answer in talk.answers] == [(2, -3)]
    assert "too many messages are waiting" in str(talk.answers[0]["error"])
    assert list(talk.live.snapshot.root.children) == ["a"]
    talk.held.full = False
    talk.send(3, box("c"))
    talk.held.tell()
    assert [answer["timestamp"] for answer in talk.answers] == [2, 1, 3]


def test_size_of_a_response_grows_with_its_paths(talk: Talk) -> None:
    talk.send(1, {"delete": [{"path": [str(number)]} for number in range(1000)]})
    assert talk.held.waiting[0][1] > 50_000
