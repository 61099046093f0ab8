"""Sections of a log: which events, when, and what of the time before."""

import asyncio
import io
from pathlib import Path

import pytest

from gateway.scene.tree.live import LiveTree
from scenegate.cli import main
from scenegate.cli.play import STATE_CHANNELS
from scenegate.lcm.event_log import EmptySectionError, Event, Section, pack_event, read_events, section_events
from tests.adapters.treeviewer.conversation import BOX, message
from tests.adapters.treeviewer.transports import serving
from tests.support.corpus import corpus_dir
from tests.support.waiting import until

REQUEST = "DIRECTOR_TREE_VIEWER_REQUEST_<a>"
EVENTS = [
    Event(0, 5_000_000, REQUEST, message({"setgeometry": [{"path": ["a"], "geometry": BOX}]})),
    Event(1, 5_100_000, "DRAKE_VIEWER_DRAW", b"old"),
    Event(2, 5_200_000, "CAMERA", bytes(100_000)),
    Event(3, 6_000_000, REQUEST, message({"setgeometry": [{"path": ["b"], "geometry": BOX}]})),
    Event(4, 6_100_000, "DRAKE_VIEWER_DRAW", b"last before"),
    Event(5, 7_000_000, "CAMERA", b"inside"),
    Event(6, 7_500_000, REQUEST, message({"delete": [{"path": ["a"]}]})),
    Event(7, 9_000_000, REQUEST, message({"delete": [{"path": ["b"]}]})),
]
LOG = b"".join(pack_event(e.number, e.time_us, e.channel, e.data) for e in EVENTS)


def played(section: Section, leave_out: str = "") -> list[tuple[float | None, int]]:
    events = list(section_events(io.BytesIO(LOG), section, lambda channel: channel != leave_out))
    assert all(event == EVENTS[event.number] for _, event in events)
    return [(None if seconds is None else round(seconds, 6), event.number) for seconds, event in events]


def test_the_whole_log() -> None:
    assert played(Section()) == [(round(e.time_us / 1e6 - 5, 6), e.number) for e in EVENTS]


def test_a_section() -> None:
    assert played(Section(2.0, 1.5)) == [(0.0, 5), (0.5, 6)]
    assert played(Section(2.0, 0.5)) == [(0.0, 5)]  # the end does not belong to it
    assert played(Section(1.05)) == [(0.05, 4), (0.95, 5), (1.45, 6), (2.95, 7)]


def test_what_holds_from_before() -> None:
    """All requests, the last message of Drake's, nothing of the camera; and only channels that are played."""
    assert played(Section(2.0, 0.6, STATE_CHANNELS)) == [(None, 0), (None, 3), (None, 4), (0.0, 5), (0.5, 6)]
    assert played(Section(2.0, 0.1, STATE_CHANNELS), REQUEST) == [(None, 4), (0.0, 5)]
    assert played(Section(2.0, 0.1, STATE_CHANNELS), "DRAKE_VIEWER_DRAW") == [(None, 0), (None, 3), (0.0, 5)]


def test_a_section_after_the_end() -> None:
    with pytest.raises(EmptySectionError, match=r"the log has 4.0 s, and nothing at 4.5 s"):
        played(Section(4.5))


def test_what_is_left_out_is_not_read() -> None:
    class Counted(io.BytesIO):
        count = 0

        def read(self, size: int | None = -1) -> bytes:
            data = super().read(size)
            Counted.count += len(data)
            return data

    file = Counted(b"".join(pack_event(k, k, "CAMERA", bytes(1 << 20)) for k in range(20)))
    found = list(read_events(file, lambda channel: False))
    assert [event.position for event in found] == [k * (28 + 6 + (1 << 20)) for k in range(20)]
    assert Counted.count < 1000


@pytest.mark.parametrize("cut", [1, 1000])
def test_a_truncated_event_that_is_not_read(cut: int) -> None:
    log = LOG + pack_event(8, 9_000_000, "CAMERA", bytes(1000))
    assert [event.number for event in read_events(io.BytesIO(log[:-cut]), lambda channel: False)] == list(range(8))


async def test_play_from_the_middle_over_tcpq(tmp_path: Path) -> None:
    """A viewer that gets the second half has the scene of the whole log."""
    log = tmp_path / "in.lcmlog"
    log.write_bytes(LOG)
    live = LiveTree()
    async with serving(live=live) as service:
        await run_play(log, service.tcpq_port, "--start", "1.5", "--duration", "0.2")
        await until(lambda: set(live.snapshot.root.children) == {"a", "b"})
        await run_play(log, service.tcpq_port, "--start", "2.4", "--duration", "0.3", "--rate", "0")
        await until(lambda: set(live.snapshot.root.children) == {"b"})


async def test_a_recording_of_directors_client_from_its_last_second(tmp_path: Path) -> None:
    log = corpus_dir() / "treeviewer" / "dt_interface.log"
    if not log.is_file():
        pytest.skip("SCENEGATE_CORPUS has no recordings of the tree viewer")
    whole, part = LiveTree(), LiveTree()
    for live, arguments in ((whole, ()), (part, ("--start", "2.5"))):
        async with serving(live=live) as service:
            await run_play(log, service.tcpq_port, "--rate", "0", *arguments)
            await until(lambda: service.status()["received"] >= 2000 and not service.status()["waiting"])
    shown = [[(path, node.matrix.tolist()) for path, node in live.snapshot.root.walk()] for live in (whole, part)]
    assert shown[0] == shown[1]


async def run_play(log: Path, port: int, *arguments: str) -> None:
    url = f"tcpq://127.0.0.1:{port}"
    await asyncio.to_thread(main, ["play", str(log), "--lcm-url", url, "--channels", "DIRECTOR.*REQUEST.*", *arguments])
