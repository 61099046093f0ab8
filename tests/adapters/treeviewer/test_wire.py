import importlib
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenegate.messages import wire
from tests.support.lcm_gen import generate

INT64 = st.integers(-(2**63), 2**63 - 1)
INT32 = st.integers(-(2**31), 2**31 - 1)
NAMES = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=50)


@settings(deadline=None)
@given(st.binary(max_size=300), INT64, NAMES, INT32, INT32)
def test_wire_round_trip(data: bytes, utime: int, name: str, major: int, minor: int) -> None:
    comms = wire.decode(wire.encode(data, utime, name, (major, minor)))
    assert (comms.data.tobytes(), comms.utime, comms.format, comms.major, comms.minor, comms.fault) == (
        *(data, utime, name, major, minor),
        "",
    )


@settings(deadline=None)
@given(st.binary(max_size=200))
def test_wire_survives_any_bytes(data: bytes) -> None:
    try:
        comms = wire.decode(data)
    except wire.WireError:
        return
    assert data.startswith(wire.FINGERPRINT.to_bytes(8, "big"))
    assert comms.data.nbytes <= len(data)


@settings(deadline=None)
@given(st.integers(0, 60))
def test_truncated_message(size: int) -> None:
    whole = wire.encode(b"x" * 20, 5)
    try:
        comms = wire.decode(whole[:size])
    except wire.WireError:
        assert size < len(whole) - 20
    else:
        assert bool(comms.fault) == (size < len(whole))
        assert len(comms.data) == max(0, size - (len(whole) - 20))


def test_ignores_trailing_bytes() -> None:
    comms = wire.decode(wire.encode(b"{}", 5) + b"more")
    assert (comms.data.tobytes(), comms.fault) == (b"{}", "")


@pytest.mark.parametrize(("count", "fault"), [(1000, "num_bytes is 1000"), (-5, "num_bytes is -5")])
def test_reports_a_wrong_length(count: int, fault: str) -> None:
    whole = wire.encode(b"{}", 5)
    comms = wire.decode(whole[:-6] + count.to_bytes(4, "big", signed=True) + b"{}")
    assert comms.utime == 5
    assert fault in comms.fault


def test_rejects_a_wrong_fingerprint() -> None:
    with pytest.raises(wire.WireError, match=r"0000000000000000 .*d368e03f33c568be"):
        wire.decode(bytes(8) + wire.encode(b"{}")[8:])


@pytest.mark.parametrize("length", [0, 257, 2**31, 2**32 - 1])
def test_rejects_an_impossible_name_length(length: int) -> None:
    whole = wire.encode(b"{}")
    with pytest.raises(wire.WireError, match="name"):
        wire.decode(whole[:16] + length.to_bytes(4, "big") + whole[20:])


@pytest.fixture
def generated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    generate(tmp_path, "viewer2_comms_t.lcm")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "robotlocomotion", raising=False)
    kind: Any = importlib.import_module("robotlocomotion").viewer2_comms_t
    return kind


def test_equals_lcm_gens_encoding(generated: Any) -> None:
    theirs = generated()
    theirs.utime, theirs.format, theirs.format_version_major, theirs.format_version_minor = 77, "größe", 1, -2
    theirs.num_bytes, theirs.data = 3, b"\x00\xffx"
    assert theirs.encode() == wire.encode(b"\x00\xffx", 77, "größe", (1, -2))
    back = generated.decode(wire.encode(b"{}", -1))
    assert (back.utime, back.format, back.num_bytes, bytes(back.data)) == (-1, "treeviewer_json", 2, b"{}")
