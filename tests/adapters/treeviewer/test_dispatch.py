"""The dispatcher of requests without a transport: order, sizes, errors, storage, delayed responses."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from typing import Any

import msgspec
import pytest
from structlog.testing import capture_logs

from gateway.adapters.treeviewer import responses
from gateway.adapters.treeviewer.config import Limits, TreeViewerConfig
from gateway.adapters.treeviewer.delivery import OVERHEAD_BYTES
from gateway.adapters.treeviewer.dispatch import MAX_LOGGED, Dispatcher
from gateway.adapters.treeviewer.protocol import REQUEST, TreeViewerProtocol
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Node
from renderers.compiler import pending
from scenegate.lcm.transport import LcmMessage
from scenegate.messages import wire
from tests.adapters.treeviewer.conversation import BOX, ONE_BOX, Viewer, decoded, message
from tests.support.waiting import until

CHANNEL = f"{REQUEST}_<a>"
MISSING = message({"settransform": [{"path": ["no"], "transform": {"translation": [1, 2, 3]}}]})
"""Its response has status 1."""


ONE_BOX_REQUEST = {"setgeometry": [{"path": ["a"], "geometry": BOX}]}


class Here(WorkerPool):
    """Runs calls at once, in the caller's thread, and counts them."""

    calls = 0

    async def run(self, fn: Callable[..., Any], *args: Any, nbytes: int = 0, **named: Any) -> Any:
        self.calls += 1
        await asyncio.sleep(0)
        return fn(*args, **named)


@dataclass
class Store:
    """Storage that has finished when the test says so."""

    full: bool = False
    waiting: list[tuple[Callable[[str], None], int]] = field(default_factory=list)

    def call_when_stored(self, done: Callable[[str], None], size: int) -> None:
        self.waiting.append((done, size))


def size_of(nbytes: int) -> int:
    """Return the memory of a queued message of ``nbytes`` bytes."""
    return nbytes + OVERHEAD_BYTES


def geometries(*geometries: dict[str, Any]) -> dict[str, Any]:
    """Return a request that shows geometries at one path."""
    return {"setgeometry": [{"path": ["it"], "geometries": geometries}]}


class World:
    def __init__(self, store: Store | None = None, **config: Any) -> None:
        self.viewer, self.pool = Viewer(), Here()
        self.dispatcher = Dispatcher(self.viewer.protocol, TreeViewerConfig(**config), self.pool, store)
        self.published: list[tuple[str, dict[str, Any]]] = []
        self.fails = False

    def publish(self, channel: str, data: bytes) -> None:
        if self.fails:
            raise OSError("the client is gone")
        self.published.append((channel, decoded(data)))

    def receive(self, data: bytes, channel: str = CHANNEL, sender: Any = None, arrival: int = 1) -> int:
        """Pass a request to the dispatcher; return the bytes that wait."""
        self.dispatcher.receive(self.publish, LcmMessage(channel, data, arrival=arrival), sender)
        return self.dispatcher.queues.waiting_bytes

    @property
    def statuses(self) -> list[int]:
        return [body["status"] for _, body in self.published]


@pytest.fixture
async def world() -> AsyncIterator[World]:
    world = World()
    yield world
    await world.dispatcher.close()


async def test_a_small_request_is_answered_at_once(world: World) -> None:
    assert world.receive(ONE_BOX) == 0
    ((channel, body),) = world.published
    assert channel == CHANNEL.replace("REQUEST", "RESPONSE")
    assert (body["status"], body["timestamp"], body["added_geometries"]) == (0, 7, [["a"]])
    counters = world.dispatcher.counters
    assert (counters.received, counters.received_bytes, counters.answered) == (1, len(ONE_BOX), 1)
    assert (counters.missing, counters.failed) == (0, 0)
    assert world.pool.calls == 0


CLOUD = message(
    {"setgeometry": [{"path": ["a"], "geometry": {"type": "pointcloud", "points": [[0.25, 0.5, 0.75]] * 1000}}]}
)
"""A small request whose array is read by a kernel."""


async def test_requests_are_read_in_a_thread_until_all_kernels_are_compiled(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = world.pool.run

    async def run_when_compiled(*args: Any) -> Any:
        await compiled.wait()
        return await run(*args)

    compiled = asyncio.Event()
    monkeypatch.setattr(world.pool, "run", run_when_compiled)
    with pending.announced({"formats": lambda name: True}):
        assert world.receive(CLOUD) > 0
        await asyncio.sleep(0)
    compiled.set()
    await until(lambda: world.statuses == [0])
    assert world.pool.calls == 1
    await until(lambda: world.dispatcher.queues.waiting_bytes == 0)
    assert world.receive(CLOUD) == 0
    assert (world.statuses, world.pool.calls) == ([0, 0], 1)


async def test_requests_fail_with_the_reason_where_kernels_could_not_be_compiled() -> None:
    world = World()
    with pending.announced({"formats": lambda name: True}):
        pending.fail(4)
        world.receive(CLOUD)
        await until(lambda: world.published)
    ((_, body),) = world.published
    assert "kernels that this needs could not be loaded" in json.dumps(body)
    assert world.statuses == [wire.ERROR_HANDLING_REQUEST]


@pytest.mark.parametrize(("limit", "offloaded"), [(0, 0), (1, 1)])
async def test_requests_beyond_the_size_are_read_in_a_thread(limit: int, offloaded: int) -> None:
    world = World(offload_bytes=len(ONE_BOX) - limit)
    size = world.receive(ONE_BOX)
    assert size == (size_of(len(ONE_BOX)) if offloaded else 0)
    await until(lambda: world.published)
    assert (world.statuses, world.pool.calls) == ([0], offloaded)
    await until(lambda: world.dispatcher.queues.waiting_bytes == 0)
    assert world.dispatcher.status()["waiting"] == 0


@pytest.mark.parametrize(
    ("request_", "in_thread"),
    [
        (geometries({"type": "image", "image": "iVBORw0KGgo="}), 1),
        (geometries({"type": "mesh", "vertices": [], "faces": [], "uv": [], "image": "iVBORw0KGgo="}), 1),
        (geometries({"type": "text", "text": "it"}), 1),
        (geometries({"type": "line", "points": [[0, 0, 0], [1, 0, 0]]}, {"type": "text", "text": "it"}), 1),
        (geometries({"type": "mesh_file", "filename": "it.obj"}), 1),
        (geometries({"type": "mesh_file", "filename": "it.obj", "data": "dmVydGljZXM="}), 1),
        ({"setcontrols": []}, 1),
        (geometries({"type": "pointcloud", "points": [[1, 2, 3]] * 100}), 0),
        (geometries({"type": "line", "points": [[0, 0, 0], [1, 0, 0]]}), 0),
        (geometries({"type": "planar_lidar", "angle_start": 0, "angle_step": 0.01, "ranges": [1.5] * 360}), 0),
        (geometries({"type": "mesh", "vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "faces": [[0, 1, 2]]}), 0),
        (geometries({"type": "box", "lengths": [1, 2, "3"]}), 0),
        ({"settransform": [{"path": ["it"], "transform": {"translation": [1, 2, float("nan")]}}]}, 0),
        ({"settransform": [{"path": ["image"], "transform": {}}], "delete": [{"path": ["it"]}, {}]}, 0),
        ({"setproperty": [{"path": ["it"], "visible": False}], "setclicks": []}, 0),
        ({"delete": [7]}, 0),
        ([], 0),
    ],
)
@pytest.mark.parametrize("binary", [False, True])
async def test_small_requests_without_images_and_files_are_read_on_the_event_loop(
    request_: Any, in_thread: int, binary: bool
) -> None:
    """Images, text, files and controls take milliseconds."""
    world = World()
    data = wire.encode(msgspec.msgpack.encode(request_), 7, wire.BINARY) if binary else message(request_)
    world.publish = lambda channel, data: world.published.append((channel, {}))  # type: ignore[method-assign]  # a fake
    assert (world.receive(data) > 0) == in_thread, "a request for a thread is in the queue"
    await until(lambda: world.dispatcher.queues.waiting_bytes == 0)
    assert world.pool.calls == in_thread


async def test_requests_behind_a_big_one_keep_their_order() -> None:
    big = message({"setgeometry": [{"path": ["big"], "geometry": BOX}] * 20}, utime=1)
    world = World(offload_bytes=len(big) - 1, slice_commands=3)
    world.receive(big)
    assert world.receive(ONE_BOX) == size_of(len(big)) + size_of(len(ONE_BOX))
    world.receive(ONE_BOX, channel=f"{REQUEST}_<other>")
    await until(lambda: len(world.published) == 3)
    assert [body["timestamp"] for channel, body in world.published if channel.endswith("<a>")] == [1, 7]
    assert world.published[0][0].endswith("<other>"), "another client does not wait"


class Sender:
    """A client's connection; notes the bytes that wait when it is paused and resumed."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.calls: list[tuple[str, int]] = []

    def pause_reading(self) -> None:
        self.calls.append(("pause", self._world.dispatcher.queues.waiting_bytes))

    def resume_reading(self) -> None:
        self.calls.append(("resume", self._world.dispatcher.queues.waiting_bytes))


async def test_a_client_is_paused_above_its_limit_and_resumed_below_half_of_it() -> None:
    size = size_of(len(ONE_BOX))
    world = World(offload_bytes=0, client_waiting_bytes=4 * size)
    sender = Sender(world)
    for _ in range(5):
        world.receive(ONE_BOX, sender=sender)
    await until(lambda: len(world.published) == 5 and world.dispatcher.queues.waiting_bytes == 0)
    assert sender.calls == [("pause", 5 * size), ("resume", size), ("resume", 0)]


@pytest.mark.parametrize(("extra", "refused"), [(0, False), (-1, True)])
async def test_requests_beyond_the_bytes_of_all_clients_are_refused(extra: int, refused: bool) -> None:
    world = World(offload_bytes=0, waiting_bytes=2 * size_of(len(ONE_BOX)) + extra)
    for _ in range(2):
        world.receive(ONE_BOX)
    counters = world.dispatcher.counters
    assert (counters.dropped, counters.dropped_bytes) == ((1, len(ONE_BOX)) if refused else (0, 0))
    if refused:
        assert world.published[0][1]["error"] == "too many messages are waiting; send slower"
        assert world.published[0][1]["timestamp"] == 7
        assert counters.failed == 1
    await until(lambda: len(world.published) == 2)
    await world.dispatcher.close()


@pytest.mark.parametrize("config", [{"offload_bytes": 0}, {}, {"offload_bytes": 0, "waiting_bytes": 0}])
async def test_messages_of_other_types_are_counted(config: dict[str, Any]) -> None:
    world = World(**config)
    world.receive(b"junk")
    await until(lambda: world.dispatcher.counters.undecodable == 1)
    assert world.published == []
    assert str(world.dispatcher.status()["last_undecodable"]).startswith(f"{CHANNEL}: ")
    await until(lambda: world.dispatcher.queues.waiting_bytes == 0)
    assert "last_undecodable" not in World().dispatcher.status()


@pytest.mark.parametrize("offload_bytes", [1 << 20, 0])
async def test_unexpected_errors_are_answered(offload_bytes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(offload_bytes=offload_bytes)

    def fail(*_: Any, **__: Any) -> Any:
        raise RuntimeError("bug")

    monkeypatch.setattr(world.viewer.protocol, "read", fail)
    world.receive(ONE_BOX)
    await until(lambda: world.published)
    ((_, body),) = world.published
    assert (body["timestamp"], body["error"]) == (7, "internal error; the viewer's log says more")
    assert body["status"] < 0
    assert world.dispatcher.counters.internal_errors == world.dispatcher.counters.failed == 1


async def test_big_requests_that_are_refused_have_their_own_response() -> None:
    world = World(offload_bytes=0)
    world.receive(wire.encode(b"{}", 7, "another_format"))
    await until(lambda: world.published)
    assert world.statuses == [-1]


async def test_responses_that_cannot_be_sent_are_counted(world: World) -> None:
    world.fails = True
    world.receive(ONE_BOX)
    assert (world.dispatcher.counters.unanswerable, world.dispatcher.counters.answered) == (1, 0)


async def test_responses_wait_in_order_until_the_tree_is_stored() -> None:
    store = Store()
    world = World(store)
    for utime, request in enumerate(({"settransform": [{"path": ["b"]}]}, "no JSON", ONE_BOX_REQUEST)):
        world.receive(message(request, utime))
    await until(lambda: len(store.waiting) == 3)
    assert world.published == []
    for done, _ in store.waiting:
        done("")
    assert [(body["timestamp"], body["status"]) for _, body in world.published] == [(0, -3), (1, -3), (2, 0)]
    world.receive(message({"delete": [{"path": [str(number)]} for number in range(1000)]}))
    assert store.waiting[2][1] < 1000 < 50_000 < store.waiting[3][1], "the size of a response is that of its paths"


async def test_a_response_that_waits_does_not_keep_the_request() -> None:
    store, data = Store(), bytearray(ONE_BOX)
    world = World(store)
    world.dispatcher.receive(world.publish, LcmMessage(CHANNEL, memoryview(data)))
    assert len(store.waiting) == 1
    data.clear()  # raises BufferError while something refers to it


@pytest.mark.parametrize(
    ("request_", "error"),
    [
        (ONE_BOX, "the tree has been changed, but the change could not be stored: disk full"),
        (
            message({"setgeometry": [{"path": ["a"], "geometry": {"type": "cube"}}]}),
            "; the tree has been changed, but the change could not be stored: disk full",
        ),
    ],
)
async def test_a_tree_that_cannot_be_stored_is_an_error(request_: bytes, error: str) -> None:
    store = Store()
    world = World(store)
    world.receive(request_)
    await until(lambda: store.waiting)
    store.waiting[0][0]("disk full")
    ((_, body),) = world.published
    assert body["error"].endswith(error)
    assert body["error"].startswith(error) == (request_ is ONE_BOX)
    assert body["status"] < 0
    assert world.dispatcher.counters.failed == 1


async def test_requests_are_refused_while_the_storage_is_full() -> None:
    store = Store(full=True)
    world = World(store)
    assert world.receive(ONE_BOX) == 0
    assert world.dispatcher.counters.dropped == 1
    assert world.statuses[0] < 0
    assert world.viewer.paths() == set()
    store.full = False
    world.receive(ONE_BOX)
    assert len(store.waiting) == 1


async def test_responses_that_miss_paths_are_delayed_in_order(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.adapters.treeviewer.delivery.DELAY_SECONDS", 1000.0)
    world.receive(MISSING)
    world.receive(ONE_BOX)
    world.receive(ONE_BOX, channel=f"{REQUEST}_<other>")
    assert world.statuses == [0], "the other client's"
    await world.dispatcher.close()
    assert world.statuses == [0, 1, 0]
    assert world.dispatcher.counters.missing == 1


async def test_the_delay_ends_by_itself(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.adapters.treeviewer.delivery.DELAY_SECONDS", 0.0)
    for data in (MISSING, ONE_BOX, MISSING, ONE_BOX):
        world.receive(data)
    await until(lambda: len(world.published) == 4)
    assert world.statuses == [1, 0, 1, 0]
    assert world.dispatcher.counters.missing == 2
    world.receive(ONE_BOX)
    assert len(world.published) == 5, "the delay is over"
    world.receive(MISSING)
    await world.dispatcher.close()
    await asyncio.sleep(0.01)
    assert len(world.published) == 6, "once"


@pytest.mark.parametrize("begun", [False, True])
async def test_requests_that_wait_when_the_viewer_ends_are_answered(begun: bool) -> None:
    big = message({"setgeometry": [{"path": ["big"], "geometry": BOX}] * 20})
    world = World(offload_bytes=0, slice_commands=1)
    for data in (big, ONE_BOX):
        world.receive(data)
    if begun:
        await until(lambda: world.pool.calls)
    await world.dispatcher.close()
    world.receive(ONE_BOX)
    assert [body["error"] for _, body in world.published] == ["the viewer is shutting down"] * 3
    assert (world.dispatcher.queues.waiting_bytes, world.dispatcher.status()["waiting"]) == (0, 0)
    assert asyncio.all_tasks() == {asyncio.current_task()}


async def test_only_the_first_undecodable_messages_are_logged(world: World) -> None:
    with capture_logs() as entries:
        for _ in range(1000):
            world.receive(b"junk")
        assert len(entries) == MAX_LOGGED + 1, "and every thousandth"
        for _ in range(999):
            world.receive(b"junk")
    assert len(entries) == MAX_LOGGED + 1


async def test_a_big_request_is_one_revision_beside_other_clients() -> None:
    entries = [["world", number] for number in range(20)]
    big = message(
        {
            "delete": [{"path": ["old"]}],
            "setgeometry": [{"path": path, "geometry": BOX} for path in entries],
            "settransform": [{"path": path, "transform": {"translation": [1, 2, 3]}} for path in entries],
        }
    )
    world = World(offload_bytes=len(big) - 1, slice_commands=3)
    live = world.viewer.live
    world.viewer.publish(BOX, path=["old"])
    seen: list[tuple[int, int, bool, list[Any]]] = []

    def watch() -> None:
        snapshot = live.snapshot
        world_node = snapshot.root.children.get("world", Node())
        poses = [node.pose[:3] for node in world_node.children.values() if node.pose is not None]
        others = [name for name in snapshot.root.children if name not in ("old", "world")]
        seen.append((world_node.nodes_with_parts, len(poses), "old" in snapshot.root.children, others))

    live.listen(watch)
    world.receive(big)
    for number in range(5):
        await asyncio.sleep(0)
        box = message({"setgeometry": [{"path": [f"other {number}"], "geometry": BOX}]})
        world.receive(box, channel=f"{REQUEST}_<other>")
    await until(lambda: len(world.published) == 6)
    others = [f"other {number}" for number in range(5)]
    assert seen == [(0, 0, True, others[: number + 1]) for number in range(5)] + [(20, 20, False, others)]
    assert live.snapshot.root.node_count == 1 + 1 + 20 + 5


async def test_nodes_of_requests_that_are_applied_at_the_same_time_count_together() -> None:
    big = message({"setgeometry": [{"path": ["big", number], "geometry": BOX} for number in range(6)]})
    world = World()
    world.viewer.protocol = TreeViewerProtocol(world.viewer.live, Limits(nodes=10))
    config = TreeViewerConfig(offload_bytes=len(big) - 1, slice_commands=1)
    world.dispatcher = Dispatcher(world.viewer.protocol, config, world.pool)
    world.receive(big)
    for number in range(12):
        await asyncio.sleep(0)
        box = message({"setgeometry": [{"path": ["other", number], "geometry": BOX}]})
        world.receive(box, channel=f"{REQUEST}_<other>")
    await until(lambda: len(world.published) == 13)
    assert world.viewer.live.snapshot.root.node_count == 10
    failed = [body["error"] for _, body in world.published if "error" in body]
    assert failed
    assert all("nodes, the limit is 10" in error for error in failed)


async def test_a_big_request_that_is_interrupted_changes_nothing() -> None:
    big = message({"setgeometry": [{"path": [number], "geometry": BOX} for number in range(50)]})
    world = World(offload_bytes=0, slice_commands=1)
    world.receive(big)
    await until(lambda: world.pool.calls)
    for _ in range(5):
        await asyncio.sleep(0)
    await world.dispatcher.close()
    assert world.statuses == [wire.ERROR_HANDLING_REQUEST]
    assert world.viewer.live.snapshot.revision == 0


async def test_requests_are_valid_from_their_arrival_however_long_they_wait() -> None:
    big = message({"settransform": [{"path": ["big"], "transform": {"translation": [1, 2, 3]}}] * 20})
    small = message({"settransform": [{"path": ["small"], "transform": {"translation": [1, 2, 3]}}]})
    world, live = World(), LiveTree()
    world.dispatcher = Dispatcher(TreeViewerProtocol(live), TreeViewerConfig(offload_bytes=len(big) - 1), world.pool)
    live.keep_recent("camera", active=True)
    for arrival, request in ((10, big), (20, small), (30, big)):
        world.receive(request, arrival=arrival)
    assert (live.has_unapplied_before(9), live.has_unapplied_before(10)) == (False, True)
    await until(lambda: len(world.published) == 3)
    await until(lambda: not live.unapplied_arrivals)
    assert [live.snapshot_at(time).timestamp for time in (9, 10, 20, 30, 40)] == [0, 10, 20, 30, 30]


@pytest.mark.parametrize("step", ["encode", "call_when_stored"])
async def test_later_requests_are_answered_after_an_unexpected_error_of_a_response(step: str) -> None:
    size = size_of(len(ONE_BOX))
    store = Store()
    world = World(store, offload_bytes=0, client_waiting_bytes=size)
    sender = Sender(world)

    def fail_once(*_: Any, **__: Any) -> Any:
        patch.undo()
        raise RuntimeError("bug")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(responses if step == "encode" else store, step, fail_once)
        for _ in range(3):
            world.receive(ONE_BOX, sender=sender)
        await until(lambda: world.dispatcher.queues.waiting_bytes == 0)
        for done, _ in store.waiting:
            done("")
    # the response that cannot be encoded is lost, that of a broken store says that nothing was stored
    assert world.statuses == ([0, 0] if step == "encode" else [-3, 0, 0])
    assert world.dispatcher.counters.internal_errors == 1
    assert sender.calls[-1] == ("resume", 0), "the sender is not paused any more"
    world.receive(ONE_BOX, sender=sender)
    await until(lambda: world.dispatcher.queues.waiting_bytes == 0)
