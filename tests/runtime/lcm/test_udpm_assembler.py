"""LCM's datagrams: split, and reassembled in any order, with losses, invalid and foreign datagrams."""

import random
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenegate.lcm import udpm, udpm_assembler
from scenegate.lcm.udpm_assembler import Address, Assembler

PREFIX = b"WANTED"
A, B = ("10.0.0.1", 1000), ("10.0.0.2", 2000)


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def read(assembler: Assembler, datagram: bytes, sender: Address = A) -> tuple[str, bytes] | None:
    message = assembler.receive(datagram, sender)
    return None if message is None else (message.channel, bytes(message.data))


def cut(channel: str, data: bytes, sequence: int = 7) -> list[bytes]:
    return [b"".join(pieces) for pieces in udpm.datagrams(channel, data, sequence)]


def make_assembler(max_message: int = 1 << 28, max_bytes: int = 1 << 28, clock: Clock | None = None) -> Assembler:
    return Assembler((PREFIX,), max_message, max_bytes, clock or Clock())


def fragment(sequence: int, size: int, offset: int, number: int, fragments: int, data: bytes) -> bytes:
    return b"LC03" + struct.pack(">IIIHH", sequence, size, offset, number, fragments) + data


def test_short_message_is_one_datagram() -> None:
    assert cut("WANTED_x", b"data", 258) == [b"LC02\0\0\1\2WANTED_x\0data"]
    assert read(make_assembler(), b"LC02\0\0\1\2WANTED_x\0data") == ("WANTED_x", b"data")


def test_several_prefixes_are_wanted() -> None:
    assembler = Assembler((PREFIX, b"ALSO_"), 1 << 28, 1 << 28, Clock())
    for sequence, (channel, wanted) in enumerate((("WANTED_x", True), ("ALSO_y", True), ("OTHER", False))):
        for size in (4, 100_000):
            messages = [read(assembler, datagram) for datagram in cut(channel, bytes(size), sequence)]
            assert (messages[-1] == (channel, bytes(size))) is wanted


def test_fragments_are_those_of_liblcm() -> None:
    data = bytes(200_000)
    pieces = cut("WANTED", data, 1)
    assert [len(piece) for piece in pieces] == [65_507, 65_507, 65_507, 20 + 200_000 + 7 - 3 * 65_487]
    assert pieces[1][:20] == b"LC03" + struct.pack(">IIIHH", 1, 200_000, 65_480, 1, 4)
    assert len(cut("WANTED", bytes(udpm.MAX_SHORT_BYTES - 7))) == 1
    assert len(cut("WANTED", bytes(udpm.MAX_SHORT_BYTES - 6))) == 2


def test_channels_end_with_a_zero_byte() -> None:
    assert read(make_assembler(), b"LC02\0\0\1\2WANTED_x") is None
    assembler = make_assembler()
    assert read(assembler, fragment(1, 10, 0, 0, 2, b"WANTED")) is None
    assert read(assembler, fragment(1, 10, 0, 1, 2, b"0123456789")) is None
    whole = [fragment(2, 10, 0, 0, 2, b"WANTED\x0001234"), fragment(2, 10, 5, 1, 2, b"56789")]
    assert [read(assembler, piece) for piece in whole] == [None, ("WANTED", b"0123456789")]


def test_rejects_messages_that_lcm_cannot_carry() -> None:
    with pytest.raises(ValueError, match=r"at most 63 characters, 'x{64}' has 64"):
        cut("x" * 64, b"")

    class Endless(bytes):
        def __len__(self) -> int:
            return 1 << 33

    with pytest.raises(ValueError, match="cannot send 8589934592 bytes"):
        cut("x", Endless())


@settings(deadline=None, max_examples=60)
@given(
    sizes=st.lists(st.integers(0, 400_000), min_size=1, max_size=4),
    seed=st.integers(0, 1000),
    shuffled=st.booleans(),
    repeated=st.booleans(),
)
def test_reassembles_in_any_order(sizes: list[int], seed: int, shuffled: bool, repeated: bool) -> None:
    chance = random.Random(seed)
    messages = {(f"10.0.0.{i}", 5): (f"WANTED_{i}", chance.randbytes(size)) for i, size in enumerate(sizes)}
    queues = {sender: cut(*message, sequence=3) for sender, message in messages.items()}
    if shuffled:
        for queue in queues.values():
            chance.shuffle(queue)
    if repeated:
        for queue in queues.values():
            queue[:-1] = [datagram for datagram in queue[:-1] for _ in range(2)]
    assembler = make_assembler()
    received = {}
    while queues:
        sender = chance.choice(list(queues))
        for _ in range(chance.randrange(1, 4)):
            message = read(assembler, queues[sender].pop(0), sender)
            if message is not None:
                received[sender] = message
            if not queues[sender]:
                del queues[sender]
                break
    assert received == messages
    assert assembler.waiting_bytes == assembler.incomplete == 0


def test_ignores_other_datagrams_between_fragments() -> None:
    assembler = make_assembler()
    data = random.Random(2).randbytes(500_000)
    other = random.Random(3).randbytes(300_000)
    junk = [b"", b"LC", b"junk" * 9, b"LC03", b"LC03" + bytes(12)]
    strangers = [*junk, *cut("OTHER", b"x" * 60_000), *cut("OTHER", other)]
    messages = []
    for piece in cut("WANTED", data):
        messages.append(read(assembler, piece))
        for stranger in strangers:
            assert read(assembler, stranger, B) is None
        assert read(assembler, b"LC02\0\0\0\0WANTED_s\0small", B) == ("WANTED_s", b"small")
    assert messages[-1] == ("WANTED", data)


def test_unwanted_messages_take_no_memory() -> None:
    assembler = make_assembler()
    pieces = cut("OTHER", bytes(500_000))
    for piece in pieces[:-1]:
        read(assembler, piece)
        assert assembler.waiting_bytes == 0
    assert read(assembler, pieces[-1]) is None
    assert assembler.incomplete == 0


def test_counts_incomplete_messages_at_the_next_message() -> None:
    clock = Clock()
    assembler = make_assembler(clock=clock)
    lost, whole = cut("WANTED", bytes(300_000), 1), cut("WANTED", bytes(200_000), 2)
    for piece in lost[:-1]:
        read(assembler, piece)
    clock.now += udpm_assembler.STALE_SECONDS
    assert [read(assembler, piece) for piece in whole][-1] == ("WANTED", bytes(200_000))
    assert (assembler.incomplete, assembler.waiting_bytes) == (1, 0)


def test_counts_incomplete_messages_when_stale() -> None:
    clock = Clock()
    assembler = make_assembler(clock=clock)
    lost = cut("WANTED", bytes(300_000))
    for piece in lost[:-1]:
        read(assembler, piece)
    assembler.discard_stale()
    assert (assembler.incomplete, assembler.waiting_bytes) == (0, 300_000)
    clock.now += udpm_assembler.STALE_SECONDS
    assembler.discard_stale()
    assert (assembler.incomplete, assembler.waiting_bytes) == (1, 0)
    assert read(assembler, lost[-1]) is None


def test_restarted_sender_reuses_sequence_numbers() -> None:
    assembler = make_assembler()
    read(assembler, cut("WANTED", bytes(300_000), 0)[0])
    data = b"y" * 200_000
    assert [read(assembler, piece) for piece in cut("WANTED", data, 0)][-1] == ("WANTED", data)
    assert assembler.incomplete == 1


def test_discards_the_oldest_beyond_the_limits() -> None:
    assembler = make_assembler(max_bytes=1_000_000)
    first = {sender: cut("WANTED", bytes(400_000)) for sender in (A, B)}
    for sender in (A, B):
        read(assembler, first[sender][0], sender)
    read(assembler, cut("WANTED", bytes(300_000))[0], ("10.0.0.3", 1))
    assert (assembler.incomplete, assembler.waiting_bytes) == (1, 700_000)
    assert [read(assembler, piece, B) for piece in first[B][1:]][-1] is not None


@pytest.mark.parametrize(
    "datagram",
    [
        fragment(1, 100, 90, 0, 2, b"WANTED\0" + bytes(20)),
        fragment(1, 100, 0, 2, 2, bytes(20)),
        fragment(1, (1 << 28) + 1, 0, 0, 2, b"WANTED\0" + bytes(20)),
        fragment(1, 100, 0, 0, 2, b"W" * 80),
        fragment(1, 0, 0, 0, 0, b"WANTED\0"),
        fragment(1, 100, 4_294_967_295, 1, 2, bytes(20)),
    ],
    ids=["beyond the end", "number beyond the count", "too big", "endless channel", "no fragments", "far offset"],
)
def test_ignores_invalid_fragments(datagram: bytes) -> None:
    assembler = make_assembler()
    assert read(assembler, datagram) is None
    assert assembler.waiting_bytes == 0


def test_refuses_tiny_fragments() -> None:
    assembler = make_assembler()
    for number in range(2000):
        read(assembler, fragment(1, 65_535, number, number, 65_535, b"x"))
    assert assembler.waiting_bytes == 0
    data = random.Random(5).randbytes(50_000)
    size, cuts = 1423, range(0, 50_000, 1423)  # as liblcm on macOS
    pieces = [fragment(1, 50_000, at, i, len(cuts), data[at : at + size]) for i, at in enumerate(cuts)]
    pieces[0] = pieces[0][:20] + b"WANTED\0" + pieces[0][20:]
    assert [read(assembler, piece) for piece in pieces][-1] == ("WANTED", data)


def test_counts_refused_messages_once() -> None:
    assembler = make_assembler(max_message=1_000_000)
    for sequence, name in ((1, "WANTED"), (2, "WANTED"), (3, "OTHER")):
        for piece in cut(name, bytes(1_000_001), sequence):
            assert read(assembler, piece) is None
    for number in range(3):  # a wanted message with too many fragments
        assert read(assembler, fragment(9, 70_000, 0, number, 60_000, b"WANTED\0x")) is None
    assert (assembler.refused, assembler.incomplete, assembler.waiting_bytes) == (3, 0, 0)
    assert [read(assembler, piece) for piece in cut("WANTED", bytes(1_000_000))][-1] is not None
    assert assembler.refused == 3


def test_ignores_repeated_datagrams() -> None:
    clock = Clock()
    assembler = make_assembler(clock=clock)
    pieces = cut("WANTED", random.Random(1).randbytes(300_000))
    other = cut("OTHER", bytes(300_000), 8)
    for piece in pieces[:-1] + other[:-1]:
        read(assembler, piece)
    assert read(assembler, pieces[-1]) is not None
    assert read(assembler, other[-1]) is None
    assert [read(assembler, piece) for piece in pieces + other] == [None] * (len(pieces) + len(other))
    clock.now = udpm_assembler.STALE_SECONDS + 1.0
    assembler.discard_stale()
    assert (assembler.incomplete, assembler.waiting_bytes) == (0, 0)
    # later the same sequence number is another message, or at once if the size differs
    assert [read(assembler, piece) for piece in pieces][-1] is not None
    assert [read(assembler, piece) for piece in cut("WANTED", bytes(200_000))][-1] is not None
    for number in range(udpm_assembler.MAX_ENDED + 10):
        for piece in cut("WANTED", bytes(70_000), 100 + number):
            read(assembler, piece)
    assert len(assembler.ended) == udpm_assembler.MAX_ENDED


def test_gaps_never_expose_uninitialised_memory() -> None:
    assembler = make_assembler()
    assert read(assembler, fragment(1, 100, 0, 0, 2, b"WANTED\0" + bytes(50))) is None
    assert read(assembler, fragment(1, 100, 10, 1, 2, bytes(50))) is None
    assert assembler.waiting_bytes == 0


@settings(deadline=None, max_examples=200)
@given(st.lists(st.tuples(st.integers(0, 3), st.binary(max_size=64), st.booleans()), max_size=30))
def test_survives_any_datagrams(datagrams: list[tuple[int, bytes, bool]]) -> None:
    assembler = make_assembler(max_message=1000, max_bytes=5000)
    for sender, rest, long in datagrams:
        read(assembler, (b"LC03" if long else b"LC02") + rest, ("x", sender))
        assert assembler.waiting_bytes <= 5000
