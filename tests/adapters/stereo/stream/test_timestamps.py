"""Timestamps as text, and the frames that they name."""

from functools import partial
from typing import Any

import numpy as np
import pytest

from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.device.stream_settings import read_settings
from gateway.adapters.stereo.device.timestamps import parse_timestamp, timestamp_text
from gateway.adapters.stereo.imaging.scene_view import Capture
from gateway.adapters.stereo.routes.rest_common import RestError
from gateway.adapters.stereo.routes.truth_routes import find_frame
from gateway.adapters.stereo.stream.faults import FaultInjector, Faults
from gateway.adapters.stereo.stream.frame import FrameRecord


def record(number: int, camera: int, depth: int) -> FrameRecord:
    scene: Any = None
    captures = [Capture(timestamp_ns, scene, 0, np.eye(4), 0, number) for timestamp_ns in (camera, depth)]
    return FrameRecord(scene, read_settings(Parameters()), captures[0], captures[1])


@pytest.mark.parametrize(
    ("text", "nanoseconds"),
    [
        ("0", 0), ("1.", 10**9), ("1.04", 1_040_000_000), ("1.000000001", 1_000_000_001),
        ("999999999999.999999999", 10**21 - 1),
    ],
)  # fmt: skip
def test_timestamps_are_exact(text: str, nanoseconds: int) -> None:
    assert parse_timestamp(text) == nanoseconds
    assert parse_timestamp(timestamp_text(nanoseconds)) == nanoseconds


@pytest.mark.parametrize("text", ["", ".5", "-1", "1.0000000001", "1000000000000", "1e3", "1.-5", "1,5", "٣", "nan"])
def test_malformed_timestamps_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r" is not like 1700000000\.040000000$"):
        parse_timestamp(text)


def test_frames_are_found_by_both_of_their_timestamps() -> None:
    history = [record(1, 10**9, 10**9), record(2, 2 * 10**9, 2_040_000_000)]
    assert find_frame(history, None).number == 2
    assert find_frame([*history, record(3, 3 * 10**9, 3 * 10**9)], None).number == 3
    assert find_frame(history[:1], None).number == 1
    assert find_frame(history, 10**9).number == 1
    assert find_frame(history, 2 * 10**9).number == find_frame(history, 2_040_000_000).number == 2
    with pytest.raises(RestError) as missing:
        find_frame(history, 2_050_000_000)
    assert str(missing.value) == (
        "no frame has the timestamp 2.050000000; the history has 2 from 1.000000000 to 2.040000000"
    )
    with pytest.raises(RestError, match="no frame was taken yet"):
        find_frame([], None)


def test_wrong_clocks() -> None:
    changes: list[bool] = []
    injector = FaultInjector(0, 0, lambda: changes.append(True))
    assert injector.timestamp(5) == 5
    injector.set(Faults(clock_offset=-1.0))
    assert injector.timestamp(3 * 10**9) == 2 * 10**9
    assert injector.timestamp(10**9 - 1) == 0, "not negative"
    injector.set(Faults(clock_frozen=True, clock_offset=2.0))
    assert [injector.timestamp(timestamp_ns) for timestamp_ns in (10**9, 5 * 10**9)] == [3 * 10**9, 3 * 10**9]
    injector.set(Faults(clock_frozen=True))
    assert injector.timestamp(9 * 10**9) == 10**9, "still frozen"
    injector.set(Faults())
    assert injector.timestamp(9 * 10**9) == 9 * 10**9
    assert len(changes) == 4


async def test_all_or_no_frames_are_dropped() -> None:
    for share, dropped in ((1.0, 50), (0.0, 0)):
        injector, delivered = FaultInjector(3, 0), list[int]()
        injector.set(Faults(drop=share))
        for number in range(50):
            injector.deliver(number, b"set", partial(delivered.append, number))
        assert (injector.dropped, len(delivered)) == (dropped, 50 - dropped)
