"""Log files of an LCM network: written, read, recorded and played; compared with LCM's own reader and writer."""

import asyncio
import io
import re
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.protocol import REQUEST
from gateway.adapters.treeviewer.service import TreeViewerService
from gateway.runtime.lcm.config import LcmConfig
from gateway.scene.tree.live import LiveTree
from scenegate.lcm import event_log, replay
from scenegate.lcm.event_log import MAX_DATA_BYTES, SYNC, Event, EventLogError, pack_event, read_events
from scenegate.lcm.network import open_transport
from scenegate.lcm.tcpq import HUB_HELLO, publish_header
from scenegate.lcm.transport import Transport, TransportLimits
from tests.adapters.treeviewer.conversation import BOX, message
from tests.adapters.treeviewer.transports import HubClient, free_url, join, lossless, serving
from tests.support.liblcm import liblcm
from tests.support.waiting import SECONDS, until

EVENTS = [
    Event(0, 1_000_000, f"{REQUEST}_<a>", message({"setgeometry": [{"path": ["a"], "geometry": BOX}]})),
    Event(1, 1_000_500, "IMU", bytes(range(256))),
    Event(2, 1_020_000, f"{REQUEST}_<a>", message({"setgeometry": [{"path": ["b"], "geometry": BOX}]})),
]


@asynccontextmanager
async def hub(live: LiveTree | None = None) -> AsyncIterator[tuple[TreeViewerService, str]]:
    """A tree viewer with a hub, and the hub's URL."""
    async with serving(live=live or LiveTree()) as service:
        yield service, f"tcpq://127.0.0.1:{service.tcpq_port}"


def written(events: list[Event]) -> bytes:
    return b"".join(pack_event(e.number, e.time_us, e.channel, e.data) for e in events)


@settings(deadline=None, max_examples=100)
@given(
    st.lists(
        st.builds(Event, st.integers(0, 2**63 - 1), st.integers(-(2**63), 2**63 - 1), st.text(max_size=20), st.binary())
    )
)
def test_round_trip(events: list[Event]) -> None:
    assert list(read_events(io.BytesIO(written(events)))) == events


@settings(deadline=None, max_examples=100)
@given(st.binary(max_size=60), st.integers(0, 200), st.binary(max_size=100_000))
def test_skips_damaged_events(junk: bytes, cut: int, more: bytes) -> None:
    whole = written(EVENTS)
    data = junk + whole + more + whole[: len(whole) - cut]
    found = list(read_events(io.BytesIO(data)))
    assert [event for event in found if event in EVENTS][:2] == EVENTS[:2]


@pytest.mark.parametrize("offset", [-4, -3, -2, -1, 0, 1])
def test_finds_a_sync_word_across_two_reads(offset: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(event_log, "_SEARCH_BYTES", 256)
    data = bytes(1 + 256 + offset) + written(EVENTS)  # the search begins at byte 1
    assert list(read_events(io.BytesIO(data))) == EVENTS


def test_rejects_files_without_events() -> None:
    assert list(read_events(io.BytesIO(b""))) == []
    for data in (b"x", b"junk" * 100_000):
        with pytest.raises(EventLogError, match="not an LCM log"):
            list(read_events(io.BytesIO(data)))


def test_matches_lcms_own_event_log(tmp_path: Path) -> None:
    lcm = liblcm()
    (tmp_path / "ours").write_bytes(written(EVENTS))
    theirs = lcm.EventLog(str(tmp_path / "ours"), "r")
    assert [Event(e.eventnum, e.timestamp, e.channel, e.data) for e in theirs] == EVENTS
    log = lcm.EventLog(str(tmp_path / "theirs"), "w", overwrite=True)
    for event in EVENTS:
        log.write_event(event.time_us, event.channel, event.data)
    log.close()
    assert (tmp_path / "theirs").read_bytes() == (tmp_path / "ours").read_bytes()


@asynccontextmanager
async def recording(out: Path, url: str, channels: str = ".*") -> AsyncIterator[replay.LogProgress]:
    stop, ready, progress = asyncio.Event(), asyncio.Event(), replay.LogProgress()
    task = asyncio.create_task(replay.record(out, url, channels, progress, stop, ready.set))
    waiting = asyncio.create_task(ready.wait())
    await asyncio.wait({task, waiting}, return_when=asyncio.FIRST_COMPLETED)
    yield progress
    stop.set()
    await task


@pytest.mark.lcm
async def test_records_and_plays_over_udp(tmp_path: Path) -> None:
    url = free_url()
    client = join(url)
    heard: list[str] = []
    lossless(client, ".*", lambda channel, data: heard.append(channel))
    log, out = tmp_path / "in.lcmlog", tmp_path / "out.lcmlog"
    log.write_bytes(written(EVENTS))
    live = LiveTree()
    async with (
        serving(TreeViewerConfig(lcm=LcmConfig(url=url, tcpq_port=None)), live=live),
        recording(out, url, "IMU|DIR.*") as received,
    ):
        await replay.play(log, url, replay.PlayOptions(rate=0.0, channels=".*_<a>"), replay.LogProgress())
        await until(lambda: set(live.snapshot.root.children) == {"a", "b"})
        await replay.play(log, url, replay.PlayOptions(rate=100.0, channels="IMU"), replay.LogProgress())
        await until(lambda: received.events == 5)  # and two responses
    channels = [event.channel for event in read_events(io.BytesIO(out.read_bytes()))]
    assert sorted(channels) == sorted(
        [f"{REQUEST}_<a>"] * 2 + [f"{REQUEST.replace('REQUEST', 'RESPONSE')}_<a>"] * 2 + ["IMU"]
    )


async def test_loops_until_cancelled(tmp_path: Path) -> None:
    log = tmp_path / "in.lcmlog"
    log.write_bytes(written(EVENTS))
    async with hub() as (service, url):
        progress = replay.LogProgress()
        playing = asyncio.create_task(replay.play(log, url, replay.PlayOptions(rate=0.0, loop=True), progress))
        await until(lambda: service.status()["received"] >= 10)
        playing.cancel()
        await asyncio.gather(playing, return_exceptions=True)


async def test_no_channel_matches(tmp_path: Path) -> None:
    """Also in a loop, which would never end."""
    log = tmp_path / "in.lcmlog"
    log.write_bytes(written(EVENTS))
    async with hub() as (_, url):
        with pytest.raises(ValueError, match=r"--channels 'nothing'.* IMU"):
            await replay.play(log, url, replay.PlayOptions(loop=True, channels="nothing"), replay.LogProgress())


async def test_a_loop_of_one_message_does_not_flood(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log, progress, slept = tmp_path / "in.lcmlog", replay.LogProgress(), []
    log.write_bytes(written(EVENTS[:1]))
    sleep = asyncio.sleep

    async def note(seconds: float) -> None:
        slept.append((progress.events, seconds))
        await sleep(0)
        if progress.events >= 3:
            raise asyncio.CancelledError

    async with hub() as (_, url):
        monkeypatch.setattr(replay, "MIN_LOOP_SECONDS", 3600.0)
        monkeypatch.setattr(asyncio, "sleep", note)
        with pytest.raises(asyncio.CancelledError):
            await replay.play(log, url, replay.PlayOptions(loop=True), progress)
        monkeypatch.undo()
    assert [count for count, seconds in slept if seconds > 3000.0] == [1, 2, 3]


@pytest.mark.parametrize(
    ("url", "reason"), [("tcpq://127.0.0.1:1", "LCM cannot join tcpq"), ("bogus://", "the URL must begin with")]
)
async def test_a_log_stays_if_the_network_cannot_be_joined(
    url: str, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "out.lcmlog"
    log.write_bytes(b"earlier")
    monkeypatch.setattr(replay, "CONNECT_SECONDS", 0.05)  # short: no hub listens
    with pytest.raises((OSError, RuntimeError), match=reason):
        await replay.record(log, url, ".*", replay.LogProgress(), asyncio.Event())
    assert log.read_bytes() == b"earlier"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
async def test_a_full_disk_ends_a_recording() -> None:
    async with hub() as (_, url):
        stop = asyncio.Event()
        recording = asyncio.create_task(replay.record(Path("/dev/full"), url, "IMU", replay.LogProgress(), stop))
        sender = open_transport(url, ("NOTHING",), TransportLimits())
        connected = asyncio.Event()
        sender.start(lambda *message: None, connected.set)
        await connected.wait()
        while not recording.done():
            sender.publish("IMU", b"sample")
            await asyncio.sleep(0.01)  # short: until the recorder has subscribed
        with pytest.raises(OSError, match="No space left on device") as caught:
            await recording
        assert caught.value.filename == "/dev/full"
        await sender.close()


@pytest.mark.lcm
async def test_records_what_has_arrived_when_it_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(replay, "DRAIN_SECONDS", SECONDS)  # of a busy computer
    url, out = free_url(), tmp_path / "out.lcmlog"
    sender = open_transport(url, ("NOTHING",), TransportLimits())
    sender.start(lambda message: None, lambda: None)
    sent = [number.to_bytes(2, "big") for number in range(300)]
    async with recording(out, url) as progress:
        for data in sent:
            sender.publish("IMU", data)
        await sender.drain(0)
    await sender.close()
    assert [event.data for event in read_events(io.BytesIO(out.read_bytes()))] == sent
    assert (progress.events, progress.lost) == (300, "")


@pytest.mark.parametrize(
    ("counters", "lost"),
    [
        ({}, []),
        ({"lost_datagrams": 0, "incomplete": 0, "dropped": 0}, []),
        ({"lost_datagrams": 7, "incomplete": 2, "dropped": 0}, ["7", "2"]),
        ({"dropped": 3}, ["3"]),
    ],
)
async def test_a_recording_says_what_it_has_lost(
    counters: dict[str, int], lost: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def open_counting(*arguments: Any) -> Transport:
        transport = open_transport(*arguments)
        monkeypatch.setattr(transport, "status", lambda: counters)
        return transport

    monkeypatch.setattr(replay, "open_transport", open_counting)
    async with hub() as (_, url), recording(tmp_path / "out.lcmlog", url) as progress:
        assert progress.lost == ""
    assert re.findall(r"\d+", progress.lost) == lost


async def test_a_message_that_is_written_in_part_ends_a_recording(tmp_path: Path) -> None:
    """As on a disk whose last bytes it takes: the system reports an error only for the next write."""
    resource = pytest.importorskip("resource", reason="needs limits of the size of files")
    out, (soft, hard) = tmp_path / "out.lcmlog", resource.getrlimit(resource.RLIMIT_FSIZE)
    async with hub() as (service, url):
        progress = replay.LogProgress()
        stop, ready = asyncio.Event(), asyncio.Event()
        task = asyncio.create_task(replay.record(out, url, "IMU", progress, stop, ready.set))
        await ready.wait()
        client = await HubClient.connect(service.tcpq_port)
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
        try:
            await client.publish("IMU", bytes(200_000))
            await until(lambda: out.stat().st_size == 100_000)
            stop.set()
            with pytest.raises(OSError, match="File too large"):
                await task
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        await client.close()
    assert progress.events == 0


async def test_finish_loses_nothing_when_the_hub_sends(tmp_path: Path) -> None:
    """Closing a connection with unread bytes resets it, and the hub loses what it has not read."""
    log = tmp_path / "in.lcmlog"
    log.write_bytes(written(EVENTS) * 500)
    received: asyncio.Future[int] = asyncio.get_running_loop().create_future()

    async def chatter(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readexactly(8)
        writer.write(HUB_HELLO)
        size = 0
        try:
            while data := await reader.read(4096):
                size += len(data)
                writer.write(publish_header("CHATTER", 1000) + bytes(1000))
        except ConnectionError:
            size = -1
        received.set_result(size)
        writer.close()

    server = await asyncio.start_server(chatter, "127.0.0.1", 0)
    url = f"tcpq://127.0.0.1:{server.sockets[0].getsockname()[1]}"
    await replay.play(log, url, replay.PlayOptions(rate=0.0), replay.LogProgress())
    assert await received > sum(len(event.data) for event in EVENTS) * 500
    server.close()
    await server.wait_closed()


async def test_keeps_recorded_times(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = tmp_path / "in.lcmlog"
    log.write_bytes(written(EVENTS))
    slept: list[float] = []
    sleep = asyncio.sleep

    async def note(seconds: float) -> None:
        slept.append(seconds)
        await sleep(0)

    async with hub() as (_, url):
        monkeypatch.setattr(asyncio, "sleep", note)
        await replay.play(log, url, replay.PlayOptions(rate=0.001), replay.LogProgress())
        monkeypatch.undo()
    waits = [seconds for seconds in slept if seconds > 0.1]
    assert waits == [pytest.approx(0.5, abs=0.4), pytest.approx(20.0, abs=0.5)]


async def test_rejects_invalid_pattern(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="is not a pattern"):
        await replay.record(tmp_path / "x", "memq://", "(", replay.LogProgress(), asyncio.Event())
    with pytest.raises(ValueError, match=r"--channels '\[' is not a pattern"):
        await replay.play(tmp_path / "x", "memq://", replay.PlayOptions(channels="["), replay.LogProgress())


def test_damaged_lengths_do_not_read_the_rest_each_time() -> None:
    """Each of 20,000 headers says that 256 MiB follow. With the 40 MB after them, reading those would take 800 GB."""
    header = struct.pack(">IqqII", SYNC, 0, 0, 1, MAX_DATA_BYTES)
    log = header * 20_000 + bytes(40_000_000) + pack_event(7, 1, "A", b"data")
    (event,) = read_events(io.BytesIO(log))
    assert (event.number, event.data) == (7, b"data")
