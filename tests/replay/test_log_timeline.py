"""Logs as timelines, compared with a viewer that gets their messages one after the other."""

import asyncio
import tempfile
from bisect import bisect_right
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.adapters.viewer.messages import TimeCommand
from gateway.adapters.viewer.playback import Playback
from gateway.files.assets.mesh_files import MeshFiles
from gateway.replay.log_replay import MAX_CHANNELS
from gateway.replay.log_timeline import Checkpoints, LogError, LogTimeline, open_log, scan_log
from gateway.scene.tree.geometry import PointCloud
from gateway.scene.tree.live import Snapshot
from gateway.scene.tree.nodes import Node
from tests.adapters.drakeviewer import encoding
from tests.adapters.treeviewer.conversation import BOX, message
from tests.replay.logs import BEGIN, CHANNEL, Message, content, nanoseconds, states, write_log
from tests.support.corpus import corpus_dir
from tests.support.view_frames import parse_frame

RECORDED = ["drakeviewer/drake_default.lcmlog", "treeviewer/dt_client.log", "treeviewer/deletes.log"]
XYZ = [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)]


Opener = Callable[..., LogTimeline]


@pytest.fixture
def opened() -> Iterator[Opener]:
    """Open a log with a checkpoint every few messages, until the end of the test."""
    with ExitStack() as stack:
        yield lambda *arguments, **options: stack.enter_context(with_small_parts(*arguments, **options))


def with_small_parts(log: Path, checkpoints: Checkpoints | None = None) -> LogTimeline:
    """Return the timeline of a log with a checkpoint every few messages."""
    return LogTimeline(log, MeshFiles(()), scan_log(log), checkpoints or Checkpoints(interval=3.0))


def box_at(*path: str) -> bytes:
    return message({"setgeometry": [{"path": list(path), "geometry": BOX}]})


def moved(x: float, *path: str) -> bytes:
    transform = {"translation": [x, 0, 0], "quaternion": [1, 0, 0, 0]}
    return message({"settransform": [{"path": list(path), "transform": transform}]})


def cloud_of(count: int, value: float = 0.0) -> bytes:
    return encoding.cloud(np.full((count, 3), value, "<f4").tobytes(), count, XYZ, 12)


def moving(count: int, rate: float = 10.0) -> list[Message]:
    """Return a box that moves one metre with each message."""
    return [(0.0, CHANNEL, box_at("a")), *((k / rate, CHANNEL, moved(k, "a")) for k in range(1, count))]


def x_of(snapshot: Any) -> float:
    return float(snapshot.root.children["a"].matrix[0, 3])


LOAD = encoding.load(encoding.link("arm", 0, encoding.geometry(encoding.BOX, (1, 1, 1))))
PATHS = st.sampled_from([("a",), ("a", "b"), ("c",), ("drake", "illustration")])
SHOWN = st.one_of(
    st.tuples(st.just(CHANNEL), PATHS.map(lambda path: box_at(*path))),
    st.tuples(st.just(CHANNEL), st.tuples(st.integers(0, 9), PATHS).map(lambda each: moved(each[0], *each[1]))),
    st.tuples(st.just(CHANNEL), PATHS.map(lambda path: message({"delete": [{"path": list(path)}]}))),
    st.tuples(
        st.just(CHANNEL), st.just(message({"setproperty": [{"path": ["a"], "property": "visible", "value": 0}]}))
    ),
    st.tuples(st.just("DRAKE_VIEWER_LOAD_ROBOT"), st.just(LOAD)),
    st.tuples(
        st.just("DRAKE_VIEWER_DRAW"),
        st.integers(0, 500).map(lambda time: encoding.draw({(0, "arm"): (time, 0, 0, 1, 0, 0, 0)}, time)),
    ),
    st.tuples(st.just("DRAKE_POINT_CLOUD_x"), st.integers(0, 5).map(cloud_of)),
    st.tuples(
        st.just("CONTACT_RESULTS"),
        st.integers(0, 3).map(
            lambda n: encoding.contacts([encoding.point_contact("p", "q", (k, 0, 0), (9, 0, 0)) for k in range(n)])
        ),
    ),
    st.tuples(
        st.just("DRAKE_DRAW_FRAMES"),
        st.sampled_from(["one", "two"]).map(lambda name: encoding.draw({(0, name): (0, 0, 1, 1, 0, 0, 0)})),
    ),
    st.tuples(st.sampled_from([CHANNEL, "DRAKE_VIEWER_DRAW", "CAMERA"]), st.binary(max_size=30)),
)
LOGS = st.lists(st.tuples(st.integers(0, 3), SHOWN), min_size=1, max_size=40)


@settings(deadline=None, max_examples=60)
@given(LOGS, st.lists(st.integers(-2, 130), max_size=25), st.booleans(), st.sampled_from([2, 5, 1000]))
def test_seeks_in_any_order(steps: list[Any], seeks: list[int], is_indexed: bool, max_count: int) -> None:
    """Each state is that of a viewer that got all earlier messages, whatever was sought before."""
    seconds, messages = 0, [(0.0, CHANNEL, box_at("a"))]
    for step, (channel, data) in steps:
        seconds += step
        messages.append((float(seconds), channel, data))
    with tempfile.TemporaryDirectory() as folder:
        asyncio.run(check_seeks(write_log(Path(folder) / "x.lcmlog", messages), seeks, is_indexed, max_count))


async def check_seeks(log: Path, seeks: list[int], is_indexed: bool, max_count: int = 1000) -> None:
    """Seek times in seconds after the log's begin, and compare."""
    expected = states(log)
    timeline = with_small_parts(log, Checkpoints(max_count=max_count, interval=3.0))
    assert timeline.span == (expected[0][0], expected[-1][0])
    if is_indexed:
        await timeline.build_index()
    revisions: dict[int, Any] = {}
    for seconds in seeks:
        snapshot = await timeline.snapshot_at(expected[0][0] + seconds * 1_000_000_000)
        index = bisect_right(expected, expected[0][0] + seconds * 1_000_000_000, key=lambda state: state[0]) - 1
        shown = content(snapshot.root)
        assert shown == content(expected[max(index, first_of(expected))][1])
        assert revisions.setdefault(snapshot.revision, shown) == shown
    timeline.close()


def first_of(expected: list[tuple[int, Node]]) -> int:
    """Return the index of the last of the events with the time of the first one."""
    return bisect_right(expected, expected[0][0], key=lambda state: state[0]) - 1


@pytest.mark.corpus
@pytest.mark.parametrize("name", RECORDED)
async def test_recorded_logs(opened: Opener, name: str) -> None:
    log = corpus_dir() / name
    expected = states(log)
    timeline = opened(log, Checkpoints(interval=20.0))
    times = [time for time, _ in expected]
    for index in [*range(0, len(times), max(1, len(times) // 40)), len(times) - 1, 0, len(times) // 2]:
        snapshot = await timeline.snapshot_at(times[index])
        assert content(snapshot.root) == content(expected[bisect_right(times, times[index]) - 1][1])
    timeline.close()


async def test_a_state_keeps_its_revision_and_its_time(opened: Opener, tmp_path: Path) -> None:
    timeline = opened(write_log(tmp_path / "x", moving(50)))
    late = await timeline.snapshot_at(nanoseconds(4.05))
    assert (x_of(late), late.timestamp) == (40.0, nanoseconds(4.0))
    early = await timeline.snapshot_at(nanoseconds(0.35))
    again = await timeline.snapshot_at(nanoseconds(4.09))
    assert (early.revision, again.revision) == (4, late.revision)
    assert again.root.children["a"].parts is late.root.children["a"].parts, "checkpoints share what is equal"
    assert x_of(await timeline.snapshot_at(0)) == 0.0
    assert x_of(await timeline.snapshot_at(nanoseconds(1e6))) == 49.0


async def test_the_index_grows_in_the_background(opened: Opener, tmp_path: Path) -> None:
    timeline = opened(write_log(tmp_path / "x", moving(30)))
    seen = [timeline.progress]
    await timeline.build_index(seen.append)
    assert seen[0] < 0.1
    assert seen[-1] == timeline.progress == 1.0
    assert timeline.is_fully_indexed


async def test_a_cancelled_seek(opened: Opener, tmp_path: Path) -> None:
    timeline = opened(write_log(tmp_path / "x", moving(2000)))
    seeks = [asyncio.create_task(timeline.snapshot_at(nanoseconds(1e6))) for _ in range(5)]
    await asyncio.sleep(0)
    for seek in seeks[1:]:
        seek.cancel()
    assert x_of(await seeks[0]) == 1999.0
    assert x_of(await timeline.snapshot_at(nanoseconds(1.0))) == 10.0


async def test_memory_is_bounded(opened: Opener, tmp_path: Path) -> None:
    """Of 200 clouds of 120 kB, checkpoints keep 1 MB."""
    clouds = [(k / 10, "DRAKE_POINT_CLOUD", cloud_of(10_000, k)) for k in range(200)]
    log = write_log(tmp_path / "x", clouds)
    checkpoints = Checkpoints(max_bytes=1_000_000, interval=1.0)
    timeline = opened(log, checkpoints)
    await timeline.build_index()
    assert 2 <= len(checkpoints) <= 9
    assert 120_000 < checkpoints.nbytes <= 1_000_000
    for k in (150, 3, 199, 151):
        root = (await timeline.snapshot_at(nanoseconds(k / 10))).root
        (part,) = root.children["drake"].children["point clouds"].children["default"].parts or ()
        assert isinstance(part.shape, PointCloud)
        assert part.shape.points[0, 0] == k


async def test_geometry_that_does_not_change_is_kept_once(opened: Opener, tmp_path: Path) -> None:
    """A cloud of 1.2 MB at the begin, then 500 moves of another node."""
    log = write_log(tmp_path / "x", [(0.0, "DRAKE_POINT_CLOUD", cloud_of(100_000)), *moving(500)])
    checkpoints = Checkpoints(interval=5.0)
    timeline = opened(log, checkpoints)
    await timeline.build_index()
    assert len(checkpoints) > 50
    assert checkpoints.nbytes < 1_500_000


@pytest.mark.parametrize("cut", [1, 100, 5000])
async def test_a_truncated_log(opened: Opener, cut: int, tmp_path: Path) -> None:
    """A recorder that was killed has written a part of its last event."""
    log = write_log(tmp_path / "x", [*moving(10), (2.0, "DRAKE_POINT_CLOUD", cloud_of(1000))])
    log.write_bytes(log.read_bytes()[:-cut])
    timeline = opened(log)
    assert timeline.span == (nanoseconds(0.0), nanoseconds(0.9))
    assert x_of(await timeline.snapshot_at(timeline.span[1])) == 9.0
    await timeline.build_index()
    assert x_of(await timeline.snapshot_at(timeline.span[1])) == 9.0


async def test_a_damaged_part(opened: Opener, tmp_path: Path) -> None:
    messages = moving(10)
    one, two = (
        write_log(tmp_path / "a", messages[:5]).read_bytes(),
        write_log(tmp_path / "b", messages[5:]).read_bytes(),
    )
    (tmp_path / "x").write_bytes(one + b"no event" * 100 + two)
    timeline = opened(tmp_path / "x")
    for seconds, x in ((0.45, 4.0), (0.9, 9.0), (0.5, 5.0)):
        assert x_of(await timeline.snapshot_at(nanoseconds(seconds))) == x


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "the log is empty"),
        (b"PK\3\4 is no log", "this is not an LCM log, it has no event"),
        (b"#ROSBAG V2.0\n" * 10_000, "this is not an LCM log, it has no event"),
    ],
)
def test_foreign_files(data: bytes, reason: str, tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(data)
    with pytest.raises(LogError, match=f"x: {reason}$"):
        open_log(tmp_path / "x")


def test_a_log_without_a_scene(tmp_path: Path) -> None:
    log = write_log(tmp_path / "x", [(0.0, "CAMERA", b"1"), (0.1, "CAMERA", b"2"), (0.2, "IMU", b"3")])
    with pytest.raises(LogError, match=r"CAMERA \(2\), IMU \(1\)$"):
        open_log(log)


async def test_messages_that_cannot_be_read(opened: Opener, tmp_path: Path) -> None:
    log = write_log(
        tmp_path / "x",
        [
            *moving(3),
            (0.4, CHANNEL, b"no message"),
            (0.5, CHANNEL, message("{")),
            (0.6, "DRAKE_VIEWER_DRAW", b"x" * 99),
        ],
    )
    timeline = opened(log)
    await timeline.build_index()
    assert timeline.incomplete.count == 3
    first, second = timeline.incomplete.listed()
    assert first.startswith(f"{CHANNEL}: messages that are not shown completely: 2; the first one: ")
    assert second.startswith("DRAKE_VIEWER_DRAW: messages that are not shown completely: 1; the first one: ")
    assert x_of(await timeline.snapshot_at(timeline.span[1])) == 2.0


async def test_too_many_channels(opened: Opener, tmp_path: Path) -> None:
    clouds = [(k / 1000, f"DRAKE_POINT_CLOUD_{k}", cloud_of(1)) for k in range(MAX_CHANNELS + 10)]
    timeline = opened(write_log(tmp_path / "x", [*clouds, (9.0, "DRAKE_POINT_CLOUD_7", cloud_of(2))]))
    await timeline.build_index()
    root = (await timeline.snapshot_at(timeline.span[1])).root
    assert len(root.children["drake"].children["point clouds"].children) == MAX_CHANNELS
    assert timeline.incomplete.count == 10
    assert "256 channels of clouds and frames are shown, which is the limit" in timeline.incomplete.listed()[0]


async def test_the_clock_of_the_recorder_is_set(opened: Opener, tmp_path: Path) -> None:
    """From 1970 to now, and back by an hour: all states can be reached, and the bar has no gap of decades."""
    messages = [(seconds - BEGIN, channel, data) for seconds, channel, data in moving(5)]
    messages += [(seconds, channel, moved(100.0 + seconds, "a")) for seconds, channel, _ in moving(5)]
    messages += [(seconds - 3600.0, channel, moved(200.0 + seconds, "a")) for seconds, channel, _ in moving(5)]
    timeline = opened(write_log(tmp_path / "x", messages))
    assert timeline.summary.clock_sets == 2
    assert timeline.span == (0, 3_200_000_000)
    found = [x_of(await timeline.snapshot_at(k * 100_000_000)) for k in range(33)]
    assert found[:5] == [0, 1, 2, 3, 4]
    assert found[14:19] == pytest.approx([100, 100.1, 100.2, 100.3, 100.4])
    assert found[28:33] == pytest.approx([200, 200.1, 200.2, 200.3, 200.4])


async def test_events_in_another_order(opened: Opener, tmp_path: Path) -> None:
    """Recorders with threads write events in another order than they arrived; the order in the file counts."""
    messages = [(0.0, CHANNEL, box_at("a")), (0.2, CHANNEL, moved(2, "a")), (0.19, CHANNEL, moved(1, "a"))]
    timeline = opened(write_log(tmp_path / "x", messages))
    assert (timeline.span, timeline.summary.clock_sets) == ((nanoseconds(0.0), nanoseconds(0.2)), 0)
    assert x_of(await timeline.snapshot_at(timeline.span[1])) == 1.0


async def test_the_time_of_the_simulation(opened: Opener, tmp_path: Path) -> None:
    draws = [
        (5 + k / 10, "DRAKE_VIEWER_DRAW", encoding.draw({(0, "arm"): encoding.IDENTITY}, milliseconds))
        for k, milliseconds in enumerate((1000, 1250, 0, 500))
    ]
    timeline = opened(
        write_log(tmp_path / "x", [(0.0, CHANNEL, box_at("a")), (4.0, "DRAKE_VIEWER_LOAD_ROBOT", LOAD), *draws])
    )
    await timeline.build_index()
    times = (4.9, 5.0, 5.05, 5.1, 5.2, 5.3, 9.0)
    found = [timeline.simulation_seconds_at(nanoseconds(seconds)) for seconds in times]
    assert found == [None, 1.0, 1.0, 1.25, 0.0, 0.5, 0.5]
    shown: list[Snapshot | None] = []
    page = Playback(timeline, has_live=False, show=shown.append, release=shown.clear, send=lambda frame: None)
    for seconds, simulation in ((4.5, None), (5.15, 1.25)):
        page.execute(TimeCommand("pause"))
        page.execute(TimeCommand("seek", at=BEGIN + seconds))
        assert parse_frame(page.frame())[0]["simulation"] == simulation
