"""Reads are handled in slices, one per iteration of the event loop."""

from collections.abc import Callable
from typing import Any

import pytest

from gateway.runtime.http.sliced_reads import SlicedReads


class FakeTransport:
    """A connection that records whether it is read."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.closing = False

    def is_closing(self) -> bool:
        return self.closing

    def pause_reading(self) -> None:
        self.calls.append("pause")

    def resume_reading(self) -> None:
        self.calls.append("resume")


class FakeLoop:
    """Runs the scheduled callbacks when the test says so."""

    def __init__(self) -> None:
        self.scheduled: list[Callable[[], None]] = []

    def call_soon(self, callback: Callable[[], None]) -> None:
        self.scheduled.append(callback)

    def step(self) -> None:
        callbacks, self.scheduled = self.scheduled, []
        for callback in callbacks:
            callback()


class Reader(SlicedReads):
    """Collects slices of at most three bytes."""

    slice_bytes = 3

    def __init__(self) -> None:
        self.slices: list[bytes] = []
        self.paused = False
        loop: Any = FakeLoop()
        transport: Any = FakeTransport()
        self.loop, self.transport = loop, transport

    def slice_received(self, data: bytes) -> None:
        self.slices.append(data)
        if data == b"end":
            transport: Any = self.transport
            transport.closing = True

    def reading_paused(self) -> bool:
        return self.paused


@pytest.fixture
def reader() -> Any:
    return Reader()


def test_a_short_read_is_handled_at_once(reader: Any) -> None:
    reader.data_received(b"abc")
    assert reader.slices == [b"abc"]
    assert (reader.transport.calls, reader.loop.scheduled) == ([], [])


def test_a_long_read_is_handled_slice_by_slice(reader: Any) -> None:
    reader.data_received(b"abcdefgh")
    assert reader.slices == [b"abc"]
    assert reader.transport.calls == ["pause"]
    reader.loop.step()
    assert reader.slices == [b"abc", b"def"]
    reader.loop.step()
    assert reader.slices == [b"abc", b"def", b"gh"]
    assert reader.transport.calls[-1] == "resume"
    assert reader.loop.scheduled == []


def test_data_that_arrives_meanwhile_waits_for_its_turn(reader: Any) -> None:
    reader.data_received(b"abcd")
    reader.data_received(b"ef")
    assert reader.slices == [b"abc"]
    reader.loop.step()
    assert reader.slices == [b"abc", b"def"]


def test_a_protocol_that_has_paused_stays_paused(reader: Any) -> None:
    reader.data_received(b"abcd")
    reader.paused = True
    reader.loop.step()
    assert reader.slices == [b"abc", b"d"]
    assert "resume" not in reader.transport.calls


def test_nothing_is_handled_after_the_connection_closes(reader: Any) -> None:
    reader.data_received(b"endabcdef")
    assert (reader.slices, reader.loop.scheduled) == ([b"end"], [])
    assert_nothing_is_kept(reader)
    reader = Reader()
    reader.data_received(b"abcdef")
    reader.transport.closing = True
    reader.loop.step()
    assert reader.slices == [b"abc"]
    assert "resume" not in reader.transport.calls
    assert_nothing_is_kept(reader)


def assert_nothing_is_kept(reader: Any) -> None:
    """Check that what was received before the connection closed is gone: it would be handled before ``new``."""
    reader.transport.closing = False
    reader.data_received(b"new")
    assert reader.slices[-1] == b"new"
