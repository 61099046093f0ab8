"""Bodies cut into parts: the same however they arrive, and as python-multipart understands them."""

from __future__ import annotations

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser

from gateway.render.parts import MAX_BOUNDARY, Head, MalformedBody, PartCutter

BOUNDARY = b"--bnd"
DELIMITER = b"\r\n--" + BOUNDARY
Parts = list[tuple[Head, bytes]]
MALFORMED = "malformed"
HEADERS, HEADER_BYTES = 3, 40


def cut(body: bytes, steps: list[int] | None = None, *, scratch: bool = False) -> tuple[Parts, bool] | str:
    """The parts that came to an end, and whether the body did; or that it is malformed.

    Args:
        steps: lengths of the pieces, again and again; None: one piece.
        scratch: the pieces come in one buffer, which is overwritten, as from a connection.
    """
    parts: Parts = []
    open_: Parts = []

    def begin(head: Head) -> None:
        assert not open_
        open_.append((head, b""))

    def data(piece: memoryview) -> None:
        assert len(piece) > 0
        head, before = open_.pop()
        open_.append((head, before + piece))

    cutter = PartCutter(
        BOUNDARY,
        begin,
        data,
        lambda: parts.append(open_.pop()),
        max_headers=HEADERS,
        max_header_bytes=HEADER_BYTES,
    )
    lengths = steps or [max(1, len(body))]
    buffer = bytearray(max(lengths) + 10)
    at = number = 0
    try:
        while at < len(body):
            piece = body[at : at + lengths[number % len(lengths)]]
            if scratch:
                buffer[:] = bytes(len(buffer))
                buffer[: len(piece)] = piece
                buffer[len(piece) :] = DELIMITER[: len(buffer) - len(piece)].ljust(len(buffer) - len(piece))
                cutter.feed(buffer, len(piece))
            else:
                cutter.feed(piece)
            at += len(piece)
            number += 1
    except MalformedBody:
        return MALFORMED
    return parts, cutter.complete


def understood(body: bytes) -> tuple[Parts, bool] | str:
    """The same by python-multipart, which is given the body in one piece."""
    parts: Parts = []
    head: Head = []
    texts = {"name": b"", "value": b"", "data": b""}
    ended: list[None] = []

    def gather(name: str, data: bytes, start: int, end: int) -> None:
        texts[name] += data[start:end]

    def header_end() -> None:
        head.append((texts["name"].lower(), texts["value"]))
        texts["name"] = texts["value"] = b""

    def part_end() -> None:
        parts.append((list(head), texts["data"]))
        head.clear()
        texts["data"] = b""

    parser = MultipartParser(
        BOUNDARY,
        {
            "on_header_field": lambda *args: gather("name", *args),
            "on_header_value": lambda *args: gather("value", *args),
            "on_header_end": header_end,
            "on_part_data": lambda *args: gather("data", *args),
            "on_part_end": part_end,
            "on_end": lambda: ended.append(None),
        },
        max_header_count=HEADERS,
        max_header_size=HEADER_BYTES,
    )
    try:
        parser.write(body)
    except FormParserError:
        return MALFORMED
    return parts, bool(ended)


PIECES = st.sampled_from(
    (
        *(DELIMITER[:length] for length in range(1, len(DELIMITER) + 1)),
        *(b"\r\n", b"\r", b"\n", b"--", b"-", b" ", b"\t", b"\r\n\r\n", b"x", b"some data", b"\r\r\r\r\r\r\r\r\r\r"),
        DELIMITER + b"\r\nA: b\r\n\r\n",
        DELIMITER + b'\r\nContent-Disposition: form-data; name="a"\r\n\r\n',
        DELIMITER + b" \t\r\nA:  b\r\nC:d\r\n\r\n",
        DELIMITER + b"--",
    )
)
STEPS = st.none() | st.lists(st.integers(1, 40), min_size=1, max_size=4)


@settings(deadline=None, max_examples=400)
@given(st.lists(PIECES, max_size=12).map(b"".join), st.booleans(), STEPS, st.booleans())
@example(b"1\r\n--bnd", True, [1], True)
def test_bodies_are_cut_as_python_multipart_does(
    rest: bytes, ended: bool, steps: list[int] | None, scratch: bool
) -> None:
    body = b"--" + BOUNDARY + b"\r\nA: b\r\n\r\n" + rest + (DELIMITER + b"--\r\n" if ended else b"")
    cutting, expected = cut(body, steps, scratch=scratch), understood(body)
    if expected == MALFORMED:  # a head is looked at when it has arrived
        assert cutting == MALFORMED or cutting[1] is False
    else:
        assert cutting == expected


@settings(deadline=None, max_examples=200)
@given(st.lists(PIECES | st.binary(max_size=5), max_size=8).map(b"".join), STEPS)
def test_however_it_is_cut_it_is_the_same(body: bytes, steps: list[int] | None) -> None:
    assert cut(body, steps) == cut(body)
    assert cut(body, steps, scratch=True) == cut(body)


def test_what_comes_before_and_after() -> None:
    part = b"--" + BOUNDARY + b"\r\n\r\nvalue" + DELIMITER + b"--"
    whole = ([([], b"value")], True)
    for body in (part, b"\r\n\r\n" + part, b"\r\nwritten by hand: " + part, part + b"\r\nthe end" + part):
        for step in (1, 7, len(body)):
            assert cut(body, [step]) == whole
    assert cut(b"--" + BOUNDARY + b"--") == ([], True)
    assert cut(b"") == ([], False)
    for body in (b"written by hand: " + part, b"--" + BOUNDARY + b"xx", b"--" + BOUNDARY + b" \r\n"):
        assert cut(body) == MALFORMED


def test_heads_are_bounded_before_they_are_complete() -> None:
    start = b"--" + BOUNDARY + b"\r\n"
    assert cut(start + b"A: b\r\n" * HEADERS + b"\r\n", [1]) == ([], False)
    assert cut(start + b"A: b\r\n" * HEADERS + b"A: b", [1]) == ([], False)
    assert cut(start + b"A: b\r\n" * (HEADERS + 1) + b"A: b", [1]) == MALFORMED
    assert cut(start + b"A: " + b"b" * HEADER_BYTES, [1]) == MALFORMED


@pytest.mark.parametrize("line", [b"no colon", b": no name", b"a b: c", b"a\xff: c", b"a: b\rc"])
def test_lines_that_are_no_headers(line: bytes) -> None:
    body = b"--" + BOUNDARY + b"\r\n" + line + b"\r\n\r\n" + DELIMITER + b"--"
    assert cut(body) == cut(body, [1]) == MALFORMED


def test_boundaries_are_bounded() -> None:
    for boundary in (b"", b"x" * (MAX_BOUNDARY + 1)):
        with pytest.raises(MalformedBody, match="it may have 1 to 256"):
            PartCutter(boundary, print, print, print, max_headers=1, max_header_bytes=1)
