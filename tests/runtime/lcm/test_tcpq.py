"""Parsing of TCPQ frames, and the patterns of subscriptions."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.runtime.lcm.subscriptions import PatternError, compile_pattern
from scenegate.lcm.tcpq import (
    CLIENT_HELLO,
    MAGIC_CLIENT,
    FrameError,
    FrameParser,
    FrameType,
    publish_header,
    subscription_frame,
)

FRAMES = st.lists(
    st.tuples(
        st.sampled_from(list(FrameType)),
        st.text(st.characters(codec="ascii"), max_size=60).map(lambda name: name * 20),
        st.integers(0, 400_000),
    ),
    max_size=6,
)


@settings(deadline=None, max_examples=60)
@given(FRAMES, st.lists(st.integers(1, 300_000), min_size=1, max_size=20))
def test_parses_frames_from_any_chunks(frames: list[tuple[FrameType, str, int]], cuts: list[int]) -> None:
    frames_received: list[tuple[FrameType, str, bytes]] = []
    parser = FrameParser(
        MAGIC_CLIENT, 1_000_000, lambda kind, name, data: frames_received.append((kind, name, bytes(data)))
    )
    stream = CLIENT_HELLO
    expected = []
    for index, (kind, name, size) in enumerate(frames):
        data = bytes([index]) * size if kind is FrameType.PUBLISH else b""
        stream += publish_header(name, size) + data if kind is FrameType.PUBLISH else subscription_frame(kind, name)
        expected.append((kind, name, data))
    position, turn = 0, 0
    while position < len(stream):
        buffer = parser.buffer()
        assert len(buffer) > 0
        piece = stream[position : position + min(len(buffer), cuts[turn % len(cuts)])]
        buffer[: len(piece)] = piece
        parser.received(len(piece))
        position, turn = position + len(piece), turn + 1
    assert frames_received == expected


@settings(deadline=None, max_examples=100)
@given(st.binary(max_size=400))
def test_survives_any_bytes(data: bytes) -> None:
    parser = FrameParser(MAGIC_CLIENT, 1000, lambda *_: None)
    for chunk in (CLIENT_HELLO, data):
        buffer = parser.buffer()
        buffer[: len(chunk)] = chunk
        try:
            parser.received(len(chunk))
        except FrameError:
            return


@pytest.mark.parametrize(
    ("pattern", "channel", "matches"),
    [
        ("POSE", "POSE", True),
        ("POSE", "POSE2", False),
        (".*", "anything", True),
        (r"DIRECTOR_TREE_VIEWER_RESPONSE_\<x\>", "DIRECTOR_TREE_VIEWER_RESPONSE_<x>", True),
        ("DIRECTOR_TREE_VIEWER_RESPONSE_<x>", "DIRECTOR_TREE_VIEWER_RESPONSE_<x>", True),
        ("A|B", "B", True),
        ("(?:A|B)[0-9]+", "B12", True),
        (r"a\*b", "a*b", True),
        ("[]*]x", "*x", True),
        ("(A|B|C)_.*_(LEFT|RIGHT).*?x?", "B_1_LEFT", True),
    ],
)
def test_patterns_are_anchored_regular_expressions(pattern: str, channel: str, matches: bool) -> None:
    assert bool(compile_pattern(pattern).regex.fullmatch(channel)) is matches


@pytest.mark.parametrize(
    "pattern",
    [
        *("(a+)+", "(a|a)*", "a*a*a*a*", "(?=a)", r"(a)\1", "(", "[", "*", "a{1,99999999999}", "(?P<n>a)", "(.*){9}"),
        *(r"[\][](a+)+b]", r"[^]\](a+)+](a+)+b", "}?" * 30 + "}" * 30, "[a", r"[a\]", "[]", "a\\"),
        *("a?" * 30 + "a" * 30, "(a|aa)" * 30 + "b", "((a|aa)?)" * 20, "(?:a|aa)" * 10 + ".*.*b"),
    ],
)
def test_rejects_patterns_with_exponential_cost(pattern: str) -> None:
    with pytest.raises(PatternError):
        compile_pattern(pattern)


@settings(deadline=None, max_examples=300)
@given(st.text(alphabet="ab.*+?{}()[]|\\1,^$<", max_size=20))
def test_accepted_patterns_match_fast(pattern: str) -> None:
    try:
        compiled = compile_pattern(pattern)
    except PatternError:
        return
    compiled.regex.fullmatch("a" * 62 + "!")
