"""Counters and errors of frames that are made."""

import asyncio
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import pytest
from structlog.testing import capture_logs

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.stream.frame_publisher import FramePublisher, FramesInFlight
from gateway.adapters.stereo.stream.set_kind import SetKind
from gateway.runtime.workers.pool_errors import QueueFull
from tests.support.waiting import until

LEFT, DEPTH = SetKind(left=True), SetKind(disparity=True)


@dataclass
class FakeHub:
    published: list[tuple[SetKind, int, bytes, int]] = field(default_factory=list)
    ended: list[tuple[SetKind, str]] = field(default_factory=list)
    demand_changes: int = 0

    def notify_demand(self) -> None:
        self.demand_changes += 1

    def publish(self, kind: SetKind, number: int, data: bytes, generation: int) -> None:
        self.published.append((kind, number, data, generation))

    def end_streams(self, kind: SetKind, message: str) -> None:
        self.ended.append((kind, message))


@dataclass
class FakeFrame:
    """Serialises to the results of its kinds."""

    results: dict[SetKind, bytes | Exception]
    left_metered: Any = None
    record: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(number=7, generation=3))
    cancelled: int = 0
    forever: bool = False
    started: bool = False

    async def serialised(self, kind: SetKind) -> bytes:
        if self.forever:
            self.started = True
            try:
                await asyncio.Event().wait()
            except asyncio.CancelledError:
                self.cancelled += 1
                raise
        result = self.results[kind]
        if isinstance(result, Exception):
            raise result
        return result


@pytest.fixture
def hub() -> FakeHub:
    return FakeHub()


@pytest.fixture
def publisher(hub: FakeHub) -> FramePublisher:
    target: Any = hub
    events: Any = None
    return FramePublisher(target, events, None, StereoConfig(rate="max"))


async def make(publisher: FramePublisher, frame: Any) -> None:
    await publisher.publish_sets(frame, set(frame.results))


async def test_frames_and_depth_frames_are_counted(publisher: FramePublisher, hub: FakeHub) -> None:
    metered = object()
    await make(publisher, FakeFrame({LEFT: b"left"}, left_metered=metered))
    counts = publisher.counts
    assert (counts.frames, counts.depth_frames, counts.depth_seconds) == (1, 0, 0.0)
    camera_seconds = counts.camera_seconds
    assert camera_seconds > 0.0
    await make(publisher, FakeFrame({LEFT: b"left", DEPTH: b"depth"}))
    assert (counts.frames, counts.depth_frames, counts.camera_seconds) == (2, 1, camera_seconds)
    assert counts.depth_seconds > 0.0
    assert publisher.last_metered is metered
    assert sorted(data for _, _, data, _ in hub.published) == [b"depth", b"left", b"left"]
    assert hub.published[0] == (LEFT, 7, b"left", 3)


async def test_a_full_queue_drops_the_set_and_ends_no_stream(publisher: FramePublisher, hub: FakeHub) -> None:
    await make(publisher, FakeFrame({LEFT: QueueFull("full", 1), DEPTH: b"depth"}))
    assert publisher.counts.dropped == 1
    assert [kind for kind, *_ in hub.published] == [DEPTH]
    assert hub.ended == []


async def test_an_error_ends_the_streams_of_its_kind_until_the_next_frame_is_made(
    publisher: FramePublisher, hub: FakeHub
) -> None:
    await make(publisher, FakeFrame({LEFT: ValueError("broken"), DEPTH: KeyError("x")}))
    assert sorted(hub.ended, key=str) == sorted(
        [(LEFT, "frame 7 (left) could not be made: broken"), (DEPTH, "frame 7 (disparity) could not be made: 'x'")],
        key=str,
    )
    assert "could not be made" in publisher.counts.problem
    await make(publisher, FakeFrame({LEFT: b"left"}))
    assert publisher.counts.problem == ""


@pytest.mark.parametrize("broken", [LEFT, DEPTH])
async def test_the_error_of_a_set_stays_though_another_set_of_the_frame_is_made(
    publisher: FramePublisher, broken: SetKind
) -> None:
    results: dict[SetKind, bytes | Exception] = {LEFT: b"left", DEPTH: b"depth", broken: ValueError("broken")}
    await publisher.publish_sets(cast(Any, FakeFrame(results)), [LEFT, DEPTH])
    assert publisher.counts.problem == f"frame 7 ({broken}) could not be made: broken"


async def test_only_unexpected_errors_are_logged_with_a_traceback(publisher: FramePublisher) -> None:
    with capture_logs() as entries:
        publisher.end_streams(LEFT, "no frame", RuntimeError("unexpected"))
        publisher.end_streams(LEFT, "no frame", ValueError("expected"))
    assert [entry["event"] for entry in entries] == ["no frame: unexpected", "no frame: expected"]
    assert isinstance(entries[0]["exc_info"], RuntimeError)
    assert entries[1]["exc_info"] is None


async def test_cancelling_the_work_cancels_the_frame(publisher: FramePublisher, hub: FakeHub) -> None:
    group, frame = FramesInFlight(), FakeFrame({LEFT: b""}, forever=True)
    publisher.spawn(group, make(publisher, frame))
    await until(lambda: frame.started)
    assert len(group) == 1
    group.cancel()
    await until(lambda: not len(group))
    assert (frame.cancelled, publisher.counts.frames, publisher.counts.problem) == (1, 0, "")
    assert hub.demand_changes == 1


async def test_unexpected_errors_of_the_work_are_the_problem(publisher: FramePublisher, hub: FakeHub) -> None:
    async def fail() -> None:
        raise RuntimeError("no event could be sent")

    group = FramesInFlight()
    publisher.spawn(group, fail())
    await until(lambda: not len(group) and hub.demand_changes)
    assert publisher.counts.problem == "no event could be sent"
