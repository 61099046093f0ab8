"""Limits of the transports at exactly their value, and one beyond it."""

import io

import pytest

from gateway.runtime.lcm.subscriptions import PatternError, Subscriptions
from scenegate.lcm import event_log, tcpq, udpm
from scenegate.lcm.event_log import EventLogError, pack_event, read_events
from scenegate.lcm.tcpq import (
    CLIENT_HELLO,
    MAGIC_CLIENT,
    FrameError,
    FrameParser,
    FrameType,
    publish_header,
    subscription_frame,
)
from scenegate.lcm.udpm_assembler import MAX_PARTIAL, MIN_FRAGMENT_BYTES, Assembler


def parse(stream: bytes, max_message: int = 100) -> list[tuple[FrameType, str, bytes]]:
    """Frames of a stream that follows the hello."""
    frames: list[tuple[FrameType, str, bytes]] = []
    parser = FrameParser(MAGIC_CLIENT, max_message, lambda kind, name, data: frames.append((kind, name, bytes(data))))
    stream = CLIENT_HELLO + stream
    while stream:
        buffer = parser.buffer()
        size = min(len(buffer), len(stream))
        buffer[:size] = stream[:size]
        parser.received(size)
        stream = stream[size:]
    return frames


def test_frame_of_the_maximum_size() -> None:
    assert parse(publish_header("c", 100) + bytes(100)) == [(FrameType.PUBLISH, "c", bytes(100))]
    with pytest.raises(FrameError, match="a message of 101 bytes, 100 are allowed"):
        parse(publish_header("c", 101))


def test_frame_name_of_the_maximum_length() -> None:
    name = "n" * tcpq.MAX_NAME_BYTES
    assert parse(subscription_frame(FrameType.SUBSCRIBE, name)) == [(FrameType.SUBSCRIBE, name, b"")]
    with pytest.raises(FrameError, match="a channel of 65537 bytes"):
        parse(subscription_frame(FrameType.SUBSCRIBE, name + "n"))


@pytest.mark.parametrize("more", [0, 1])
def test_frame_at_half_of_the_scratch_buffer_and_beyond(more: int) -> None:
    size = tcpq.SCRATCH_BYTES // 2 - len(publish_header("c", 0)) + more
    stream = (publish_header("c", size) + bytes(size)) * 3
    assert [len(data) for _, _, data in parse(stream, 1 << 20)] == [size] * 3


def test_number_of_subscriptions() -> None:
    subscriptions = Subscriptions(2)
    assert subscriptions.add("a") is not None
    assert subscriptions.add("b") is not None
    assert subscriptions.add("a") is None, "the same pattern again"
    with pytest.raises(PatternError, match="2 subscriptions already"):
        subscriptions.add("c")
    subscriptions.remove("a")
    assert subscriptions.match("a"), "one of the two is left"
    subscriptions.remove("a")
    subscriptions.remove("unknown")
    assert not subscriptions.match("a")
    assert subscriptions.add("c") is not None


def test_pattern_of_the_maximum_length() -> None:
    subscriptions = Subscriptions(9)
    longest = "x" * tcpq.MAX_PATTERN_BYTES
    assert subscriptions.add(longest) is not None
    with pytest.raises(PatternError, match="it has 1999 bytes, 1998 are possible"):
        subscriptions.add(longest + "x")


def test_channel_of_the_maximum_length_over_udp() -> None:
    longest = "c" * udpm.MAX_CHANNEL_BYTES
    assembler = Assembler((b"",), 1 << 20, 1 << 20)
    for size in (5, 100_000):
        datagrams = [b"".join(buffers) for buffers in udpm.datagrams(longest, bytes(size), 1)]
        messages = [assembler.receive(datagram, ("x", 1)) for datagram in datagrams]
        assert (messages[-1].channel, len(messages[-1].data)) == (longest, size)
    assert assembler.receive(b"LC02\0\0\0\1" + b"c" * 64 + b"\0", ("x", 1)) is None


def test_incomplete_messages_that_fill_the_limit_exactly() -> None:
    assembler = Assembler((b"",), 1 << 20, 200_000)
    for sequence, expected in ((1, 100_000), (2, 200_000), (3, 200_000)):
        first = b"".join(next(udpm.datagrams("c", bytes(100_000), sequence)))
        assembler.receive(first, ("x", 1))
        assert assembler.waiting_bytes == expected
    assert assembler.incomplete == 1


def test_number_of_incomplete_messages() -> None:
    assembler = Assembler((b"",), 1 << 20, 1 << 30)
    for sequence in range(MAX_PARTIAL):
        assembler.receive(b"".join(next(udpm.datagrams("c", bytes(70_000), sequence))), ("x", 1))
    assert assembler.incomplete == 0
    assembler.receive(b"".join(next(udpm.datagrams("c", bytes(70_000), MAX_PARTIAL))), ("x", 1))
    assert assembler.incomplete == 1


def test_smallest_fragments() -> None:
    size = 10 * MIN_FRAGMENT_BYTES
    for count, refused in ((12, 0), (13, 1)):
        assembler = Assembler((b"",), 1 << 20, 1 << 20)
        fragment = udpm.Fragment(1, size, 0, 0, count, b"c", memoryview(b"x"))
        header = b"LC03" + b"".join(n.to_bytes(4, "big") for n in fragment[:3])
        header += b"".join(n.to_bytes(2, "big") for n in fragment[3:5])
        assembler.receive(header + b"c\0x", ("x", 1))
        assert (assembler.refused, assembler.waiting_bytes) == (refused, 0 if refused else size)


def test_log_channel_of_the_maximum_length(monkeypatch: pytest.MonkeyPatch) -> None:
    longest = "c" * event_log.MAX_CHANNEL_BYTES
    assert next(read_events(io.BytesIO(pack_event(0, 0, longest, b"x")))).channel == longest
    with pytest.raises(EventLogError):
        list(read_events(io.BytesIO(pack_event(0, 0, longest + "c", b"x"))))
    monkeypatch.setattr(event_log, "MAX_DATA_BYTES", 4)
    assert next(read_events(io.BytesIO(pack_event(0, 0, "c", b"1234")))).data == b"1234"
    with pytest.raises(EventLogError):
        list(read_events(io.BytesIO(pack_event(0, 0, "c", b"12345"))))
