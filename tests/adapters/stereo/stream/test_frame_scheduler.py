"""Due times and timestamps of frames, and the scheduler's waits."""

import asyncio
from dataclasses import replace

import pytest

from gateway.adapters.stereo.device.camera_config import Rate
from gateway.adapters.stereo.device.stream_settings import StreamSettings
from gateway.adapters.stereo.device.timestamps import NANOSECONDS_PER_SECOND
from gateway.adapters.stereo.stream import frame_scheduler
from gateway.adapters.stereo.stream.frame_scheduler import FrameClock
from renderers.stereo.model import Quality
from renderers.stereo.sensor.exposure import Exposure
from tests.adapters.stereo.conftest import settings

PERIOD = 40_000_000
"""Nanoseconds, 25 Hz."""
SETTINGS = replace(settings(), quality=Quality.MEDIUM)
"""Depth at 15 Hz."""
AT_4_HZ = replace(SETTINGS, fps=4.0)
INSTANT = replace(SETTINGS, auto_exposure=None, manual_exposure=Exposure(0.0))
"""Exposures that take no time."""
PREVIOUS = 1_700_000_000 * NANOSECONDS_PER_SECOND


def with_depth_rate(rate: float) -> StreamSettings:
    return replace(SETTINGS, limits=replace(SETTINGS.limits, depth_rates={SETTINGS.quality: rate}))


DEPTH_AT_8_HZ, DEPTH_AT_10_HZ = with_depth_rate(8.0), with_depth_rate(10.0)


class FixedTime:
    """A system time that is set by the test, nanoseconds since the epoch."""

    now = 0

    def __call__(self) -> int:
        return self.now


@pytest.fixture(autouse=True)
def source(monkeypatch: pytest.MonkeyPatch) -> FixedTime:
    source = FixedTime()
    monkeypatch.setattr("time.time_ns", source)
    return source


def clock_at(rate: Rate = "device") -> FrameClock:
    return FrameClock(rate, simulated=False)


def depth_due_at(clock: FrameClock, source: FixedTime, timestamp: int) -> bool:
    """Return True if a frame with this timestamp, which is not late, includes depth."""
    source.now = timestamp + round(0.5 * SETTINGS.longest_exposure * NANOSECONDS_PER_SECOND)
    return clock.depth_due(SETTINGS, clock.frame_due, None)


def test_frames_keep_their_beat() -> None:
    clock = clock_at()
    assert clock.advance_to_due_frame(SETTINGS, 10.0) == 0
    assert clock.seconds_until_frame(SETTINGS, 10.0) == pytest.approx(0.04)
    assert clock.advance_to_due_frame(SETTINGS, 10.045) == 0  # 5 ms late
    assert clock.seconds_until_frame(SETTINGS, 10.045) == pytest.approx(0.035)


@pytest.mark.parametrize(("late", "missed", "wait"), [(0.125, 0, 0.125), (0.25, 1, 0.25), (3.0625, 12, 0.1875)])
def test_missed_frames_are_counted_and_not_made_up_for(late: float, missed: int, wait: float) -> None:
    clock = clock_at()
    clock.advance_to_due_frame(AT_4_HZ, 7.75)  # next at 8.0
    assert clock.advance_to_due_frame(AT_4_HZ, 8.0 + late) == missed
    assert clock.seconds_until_frame(SETTINGS, 8.0 + late) == pytest.approx(wait)


def test_frames_without_depth_are_neither_waited_for_nor_missed_if_only_depth_is_needed(source: FixedTime) -> None:
    clock = clock_at()
    clock.advance_to_due_frame(SETTINGS, 8.0)
    source.now = 8 * NANOSECONDS_PER_SECOND
    assert clock.seconds_until_frame(SETTINGS, 8.0, depth_only=True) == pytest.approx(0.04), "the first frame has depth"
    clock.schedule_next_depth(DEPTH_AT_8_HZ, clock.next_timestamp(SETTINGS, 8.0))
    assert clock.seconds_until_frame(SETTINGS, 8.0) == pytest.approx(0.04)
    assert clock.seconds_until_frame(replace(SETTINGS, single_frame=True), 8.0, depth_only=True) == pytest.approx(0.04)
    assert clock.seconds_until_frame(SETTINGS, 8.0, depth_only=True) == pytest.approx(0.12)
    source.now = round(8.15 * NANOSECONDS_PER_SECOND)
    assert clock.seconds_until_frame(SETTINGS, 8.15, depth_only=True) == pytest.approx(-0.03)
    assert clock.advance_to_due_frame(SETTINGS, 8.15) == 0
    assert clock.frame_due == pytest.approx(8.12)
    assert clock.depth_due(SETTINGS, 8.15, None)


@pytest.mark.parametrize(("late", "missed"), [(0.0, 0), (0.02, 0), (0.1, 2)])
@pytest.mark.parametrize("then", ["camera images", "faster depth"])
def test_frames_before_the_end_of_a_wait_for_depth_are_not_missed(
    then: str, late: float, missed: int, source: FixedTime
) -> None:
    """The wait for depth ends early, because a client requests camera images or depth gets a higher rate."""
    slow = replace(SETTINGS, quality=Quality.FULL)
    clock = clock_at()
    clock.advance_to_due_frame(SETTINGS, 8.0)
    source.now = 8 * NANOSECONDS_PER_SECOND
    clock.schedule_next_depth(slow, clock.next_timestamp(slow, 8.0))
    assert clock.seconds_until_frame(slow, 8.0, depth_only=True) > 0.55
    source.now = round(8.5 * NANOSECONDS_PER_SECOND)
    depth_only = then == "faster depth"
    faster = replace(slow, quality=Quality.LOW)
    assert clock.seconds_until_frame(faster, 8.5, depth_only=depth_only) < 0.0
    clock.seconds_until_frame(faster, 8.5 + late, depth_only=depth_only)
    assert clock.advance_to_due_frame(SETTINGS, 8.5 + late) == missed


def test_the_rate_of_camera_images_may_change_during_a_wait_for_depth(source: FixedTime) -> None:
    slow = replace(settings(fps=5.0), quality=Quality.FULL)
    clock = clock_at()
    clock.advance_to_due_frame(slow, 8.0)
    source.now = 8 * NANOSECONDS_PER_SECOND
    clock.schedule_next_depth(slow, clock.next_timestamp(slow, 8.0))
    assert clock.seconds_until_frame(slow, 8.0, depth_only=True) > 0.55
    assert clock.seconds_until_frame(SETTINGS, 8.5) < 0.0
    assert clock.advance_to_due_frame(SETTINGS, 8.5) == 0


@pytest.mark.parametrize("late", [0.0, 0.0625, 0.1875, 0.5, 0.75])
def test_timestamps_do_not_depend_on_lateness(late: float, source: FixedTime) -> None:
    with_exposure = replace(INSTANT, manual_exposure=Exposure(0.015625))
    clock = clock_at()
    clock.advance_to_due_frame(AT_4_HZ, 8.0)
    clock.advance_to_due_frame(AT_4_HZ, 8.25 + late)
    for delay in (0.0, 0.03125):  # until the timestamp is needed
        now = 8.25 + late + delay
        source.now = round(now * NANOSECONDS_PER_SECOND)
        timestamp = clock.next_timestamp(with_exposure, now)
        assert (timestamp / NANOSECONDS_PER_SECOND + 0.0078125) % 0.25 == 0.0, "the exposure ends when it is due"


def test_no_frames_are_missed_while_no_client_streams() -> None:
    clock = clock_at()
    assert clock.advance_to_due_frame(AT_4_HZ, 100.0) == 0
    assert clock.seconds_until_frame(SETTINGS, 100.0) == pytest.approx(0.25)
    clock.stop_schedule()
    assert clock.seconds_until_frame(SETTINGS, 100.125) == pytest.approx(0.125), "not faster by disconnecting"
    assert clock.advance_to_due_frame(AT_4_HZ, 150.125) == 0
    assert clock.seconds_until_frame(SETTINGS, 150.125) == pytest.approx(0.25)


def test_simulated_frames_are_never_missed() -> None:
    clock = FrameClock("device", simulated=True)
    clock.advance_to_due_frame(AT_4_HZ, 1.0)
    assert clock.advance_to_due_frame(AT_4_HZ, 9.0) == 0


def test_depth_is_due_within_half_a_period(source: FixedTime) -> None:
    clock = clock_at()
    assert depth_due_at(clock, source, 0), "the first frame has depth"
    clock.schedule_next_depth(DEPTH_AT_10_HZ, 0)  # next at 0.1 s
    for now, due in ((79_999_999, False), (80_000_000, True), (100_000_000, True), (300_000_000, True)):
        assert depth_due_at(clock, source, now) == due, now


def test_depth_is_due_and_keeps_its_rate_when_the_system_clock_was_set_back(source: FixedTime) -> None:
    clock = clock_at()
    clock.schedule_next_depth(DEPTH_AT_10_HZ, 10 * NANOSECONDS_PER_SECOND)
    far = round(10.1 * NANOSECONDS_PER_SECOND - 2e9 / SETTINGS.depth_rate)
    for now, due in ((far + 1, False), (far - 1, True)):
        assert depth_due_at(clock, source, now) == due, now
    clock.schedule_next_depth(SETTINGS, 5 * NANOSECONDS_PER_SECOND)
    assert not depth_due_at(clock, source, 5 * NANOSECONDS_PER_SECOND + PERIOD)


def test_depth_in_single_frame_mode_needs_the_trigger() -> None:
    clock, single = clock_at("max"), replace(SETTINGS, single_frame=True)
    assert not clock.depth_due(single, 8.0, None)
    assert not clock.depth_due(single, 8.0, 8.0), "the exposure has begun before"
    assert clock.depth_due(single, 8.0, 8.0 - SETTINGS.longest_exposure)
    assert FrameClock("max", simulated=True).depth_due(single, 8.0, 8.0)
    assert clock.depth_due(SETTINGS, 8.0, None), "rate max"


@pytest.mark.parametrize(
    ("second", "third"), [(110_000_000, 200_000_000), (200_000_000, 200_000_000), (200_000_001, 300_000_001)]
)
def test_depth_keeps_its_beat_and_restarts_after_a_gap(second: int, third: int, source: FixedTime) -> None:
    clock = clock_at()
    clock.schedule_next_depth(DEPTH_AT_10_HZ, 0)
    clock.schedule_next_depth(DEPTH_AT_10_HZ, second)
    assert not depth_due_at(clock, source, third - PERIOD // 2 - 1)
    assert depth_due_at(clock, source, third - PERIOD // 2)
    clock.stop_schedule()
    assert depth_due_at(clock, source, third - PERIOD // 2 - 1)


def test_simulated_time_advances_with_frames() -> None:
    clock, begin = FrameClock("device", simulated=True), NANOSECONDS_PER_SECOND
    assert (clock.current_timestamp(), clock.next_timestamp(SETTINGS, 8.0)) == (begin, begin)
    clock.skip_frame(SETTINGS)
    assert clock.timestamp == begin
    clock.skip_frame(SETTINGS)
    assert clock.timestamp == clock.current_timestamp() == begin + PERIOD
    clock.delay_for_alternate_exposure(SETTINGS)
    assert clock.next_timestamp(SETTINGS, 8.0) == begin + PERIOD + 80_000_000
    assert clock.seconds_until_frame(SETTINGS, 0.0) == pytest.approx(0.04)
    clock.delay_for_alternate_exposure(replace(SETTINGS, fps=12.5))
    assert clock.seconds_until_frame(SETTINGS, 0.0) == pytest.approx(0.04), "slow enough without a delay"


def test_system_time_does_not_advance_with_frames() -> None:
    clock = clock_at()
    clock.timestamp = 3
    clock.skip_frame(SETTINGS)
    clock.delay_for_alternate_exposure(SETTINGS)
    assert clock.timestamp == 3
    assert clock.seconds_until_frame(SETTINGS, 0.0) == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("now", "expected"),
    [
        (PREVIOUS + 1, PREVIOUS + 1),
        (PREVIOUS, PREVIOUS + 1),
        (PREVIOUS - 1, PREVIOUS + 1),
        (PREVIOUS - NANOSECONDS_PER_SECOND + 1, PREVIOUS + 1),
        (PREVIOUS - NANOSECONDS_PER_SECOND, PREVIOUS - NANOSECONDS_PER_SECOND),
        (PREVIOUS + NANOSECONDS_PER_SECOND, PREVIOUS + NANOSECONDS_PER_SECOND),
    ],
)
def test_timestamps_stay_unique_when_the_clock_is_set_back_by_up_to_a_second(
    now: int, expected: int, source: FixedTime
) -> None:
    clock, source.now = clock_at(), now
    assert clock.current_timestamp() == now
    assert clock.next_timestamp(INSTANT, 0.0) == now
    clock.timestamp = PREVIOUS
    assert clock.next_timestamp(INSTANT, 0.0) == expected


@pytest.mark.parametrize("milliseconds", [0.1, 0.4, 1.2, 3.45])
def test_a_wait_is_over_when_it_ends(milliseconds: float) -> None:
    """On uvloop, whose clock and timers count milliseconds, shorter waits ended at once, again and again."""
    uvloop = pytest.importorskip("uvloop")

    async def wait() -> float:
        loop = asyncio.get_running_loop()
        begin = loop.time()
        await frame_scheduler._wait(asyncio.Event(), milliseconds / 1000.0)  # noqa: SLF001 - all that waits
        return (loop.time() - begin) * 1000.0

    assert uvloop.run(wait()) >= milliseconds
