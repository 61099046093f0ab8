"""Due times and timestamps of frames."""

from __future__ import annotations

from dataclasses import replace

import pytest

from gateway.stereo.device.camera_config import Rate
from gateway.stereo.device.clock import NANOSECONDS_PER_SECOND, Clock, SimulatedClock, SystemClock
from gateway.stereo.device.parameters import Parameters
from gateway.stereo.device.stream_settings import read_settings
from gateway.stereo.stream.frame_clock import FrameClock
from renderers.stereo.model import Quality

PERIOD = 40_000_000
"""Nanoseconds, 25 Hz."""
SETTINGS = replace(read_settings(Parameters()), quality=Quality.MEDIUM)
"""Depth at 15 Hz."""
PREVIOUS = 1_700_000_000 * NANOSECONDS_PER_SECOND


class FixedClock:
    """A clock whose next timestamp is set by the test."""

    simulated = False
    now = 0

    def next_timestamp(self, previous: int | None, period: int, age: int = 0) -> int:
        return self.now - age


def clock_at(clock: Clock, rate: Rate = "device") -> FrameClock:
    return FrameClock(clock, rate)


def test_frames_keep_their_beat() -> None:
    clock = clock_at(FixedClock())
    assert clock.advance_to_due_frame(10.0, 0.04) == 0
    assert clock.seconds_until_frame(10.0) == pytest.approx(0.04)
    assert clock.advance_to_due_frame(10.045, 0.04) == 0  # 5 ms late
    assert clock.seconds_until_frame(10.045) == pytest.approx(0.035)


@pytest.mark.parametrize(("late", "missed", "wait"), [(0.125, 0, 0.125), (0.25, 1, 0.25), (3.0625, 12, 0.1875)])
def test_missed_frames_are_counted_and_not_made_up_for(late: float, missed: int, wait: float) -> None:
    clock = clock_at(FixedClock())
    clock.advance_to_due_frame(7.75, 0.25)  # next at 8.0
    assert clock.advance_to_due_frame(8.0 + late, 0.25) == missed
    assert clock.seconds_until_frame(8.0 + late) == pytest.approx(wait)


def test_frames_without_depth_are_neither_waited_for_nor_missed_if_only_depth_is_needed() -> None:
    source = FixedClock()
    clock = clock_at(source)
    clock.advance_to_due_frame(8.0, 0.04)
    source.now = 8 * NANOSECONDS_PER_SECOND
    assert clock.seconds_until_frame(8.0, SETTINGS) == pytest.approx(0.04), "the first frame has depth"
    clock.schedule_next_depth(clock.next_timestamp(PERIOD, 8.0, SETTINGS.longest_exposure), 8.0)
    assert clock.seconds_until_frame(8.0) == pytest.approx(0.04)
    assert clock.seconds_until_frame(8.0, replace(SETTINGS, single_frame=True)) == pytest.approx(0.04)
    assert clock.seconds_until_frame(8.0, SETTINGS) == pytest.approx(0.12)
    source.now = round(8.15 * NANOSECONDS_PER_SECOND)
    assert clock.seconds_until_frame(8.15, SETTINGS) == pytest.approx(-0.03)
    assert clock.advance_to_due_frame(8.15, 0.04) == 0
    assert clock.frame_due == pytest.approx(8.12)
    timestamp = clock.next_timestamp(PERIOD, 8.15, SETTINGS.longest_exposure)
    assert clock.depth_due(SETTINGS, timestamp, PERIOD, triggered=False)


@pytest.mark.parametrize(("late", "missed"), [(0.0, 0), (0.02, 0), (0.1, 2)])
@pytest.mark.parametrize("then", ["camera images", "faster depth"])
def test_frames_before_the_end_of_a_wait_for_depth_are_not_missed(then: str, late: float, missed: int) -> None:
    """The wait for depth ends early, because a client requests camera images or depth gets a higher rate."""
    source, slow = FixedClock(), replace(SETTINGS, quality=Quality.FULL)
    clock = clock_at(source)
    clock.advance_to_due_frame(8.0, 0.04)
    source.now = 8 * NANOSECONDS_PER_SECOND
    clock.schedule_next_depth(clock.next_timestamp(PERIOD, 8.0, slow.longest_exposure), slow.depth_rate)
    assert clock.seconds_until_frame(8.0, slow) > 0.55
    source.now = round(8.5 * NANOSECONDS_PER_SECOND)
    depth_only = None if then == "camera images" else replace(slow, quality=Quality.LOW)
    assert clock.seconds_until_frame(8.5, depth_only) < 0.0
    clock.seconds_until_frame(8.5 + late, depth_only)
    assert clock.advance_to_due_frame(8.5 + late, 0.04) == missed


def test_the_rate_of_camera_images_may_change_during_a_wait_for_depth() -> None:
    parameters = Parameters()
    parameters.set("rc_camera", [("fps", 5.0)])
    source, slow = FixedClock(), replace(read_settings(parameters), quality=Quality.FULL)
    clock = clock_at(source)
    clock.advance_to_due_frame(8.0, 0.2)
    source.now = 8 * NANOSECONDS_PER_SECOND
    clock.schedule_next_depth(clock.next_timestamp(PERIOD, 8.0, slow.longest_exposure), slow.depth_rate)
    assert clock.seconds_until_frame(8.0, slow) > 0.55
    assert clock.seconds_until_frame(8.5) < 0.0
    assert clock.advance_to_due_frame(8.5, 0.04) == 0


@pytest.mark.parametrize("late", [0.0, 0.0625, 0.1875, 0.5, 0.75])
def test_timestamps_do_not_depend_on_lateness(late: float) -> None:
    source = FixedClock()
    clock = clock_at(source)
    clock.advance_to_due_frame(8.0, 0.25)
    clock.advance_to_due_frame(8.25 + late, 0.25)
    for delay in (0.0, 0.03125):  # until the timestamp is needed
        now = 8.25 + late + delay
        source.now = round(now * NANOSECONDS_PER_SECOND)
        timestamp = clock.next_timestamp(PERIOD, now, exposure=0.015625)
        assert (timestamp / NANOSECONDS_PER_SECOND + 0.0078125) % 0.25 == 0.0, "the exposure ends when it is due"


def test_no_frames_are_missed_while_no_client_streams() -> None:
    clock = clock_at(FixedClock())
    assert clock.advance_to_due_frame(100.0, 0.25) == 0
    assert clock.seconds_until_frame(100.0) == pytest.approx(0.25)
    clock.stop_schedule()
    assert clock.seconds_until_frame(100.125) == pytest.approx(0.125), "not faster by disconnecting"
    assert clock.advance_to_due_frame(150.125, 0.25) == 0
    assert clock.seconds_until_frame(150.125) == pytest.approx(0.25)


def test_simulated_frames_are_never_missed() -> None:
    clock = clock_at(SimulatedClock())
    clock.advance_to_due_frame(1.0, 0.25)
    assert clock.advance_to_due_frame(9.0, 0.25) == 0


def test_depth_is_due_within_half_a_period() -> None:
    source = FixedClock()
    clock = clock_at(source)
    assert clock.depth_due(SETTINGS, source.now, PERIOD, triggered=False), "the first frame has depth"
    clock.schedule_next_depth(0, 10.0)  # next at 0.1 s
    for now, due in ((79_999_999, False), (80_000_000, True), (100_000_000, True), (300_000_000, True)):
        source.now = now
        assert clock.depth_due(SETTINGS, source.now, PERIOD, triggered=False) == due, now


def test_depth_is_due_when_the_system_clock_was_set_back() -> None:
    source = FixedClock()
    clock = clock_at(source)
    clock.schedule_next_depth(10 * NANOSECONDS_PER_SECOND, 10.0)
    far = round(10.1 * NANOSECONDS_PER_SECOND - 2e9 / SETTINGS.depth_rate)
    for now, due in ((far + 1, False), (far - 1, True)):
        source.now = now
        assert clock.depth_due(SETTINGS, source.now, PERIOD, triggered=False) == due, now


def test_depth_in_single_frame_mode_needs_the_trigger() -> None:
    clock, single = clock_at(FixedClock(), "max"), replace(SETTINGS, single_frame=True)
    assert not clock.depth_due(single, 0, PERIOD, triggered=False)
    assert clock.depth_due(single, 0, PERIOD, triggered=True)
    assert clock.depth_due(SETTINGS, 0, PERIOD, triggered=False), "rate max"


@pytest.mark.parametrize(("second", "third"), [(110_000_000, 200_000_000), (200_000_000, 200_000_000)])
def test_depth_keeps_its_beat(second: int, third: int) -> None:
    source = FixedClock()
    clock = clock_at(source)
    clock.schedule_next_depth(0, 10.0)
    clock.schedule_next_depth(second, 10.0)
    source.now = third - PERIOD // 2 - 1
    assert not clock.depth_due(SETTINGS, source.now, PERIOD, triggered=False)
    source.now += 1
    assert clock.depth_due(SETTINGS, source.now, PERIOD, triggered=False)


def test_depth_restarts_after_a_gap() -> None:
    source = FixedClock()
    clock = clock_at(source)
    clock.schedule_next_depth(0, 10.0)
    clock.schedule_next_depth(200_000_001, 10.0)
    source.now = 300_000_000 - PERIOD // 2
    assert not clock.depth_due(SETTINGS, source.now, PERIOD, triggered=False)
    clock.stop_schedule()
    assert clock.depth_due(SETTINGS, source.now, PERIOD, triggered=False)


def test_simulated_time_advances_with_frames() -> None:
    clock = clock_at(SimulatedClock(5))
    assert clock.next_timestamp(PERIOD) == 5
    clock.skip_frame(PERIOD)
    assert clock.timestamp == 5
    clock.skip_frame(PERIOD)
    assert clock.timestamp == 5 + PERIOD
    clock.delay_for_alternate_exposure(PERIOD)
    assert clock.next_timestamp(PERIOD) == 5 + PERIOD + 80_000_000
    assert clock.seconds_until_frame(0.0) == pytest.approx(0.04)
    clock.delay_for_alternate_exposure(80_000_000)
    assert clock.seconds_until_frame(0.0) == pytest.approx(0.04), "slow enough without a delay"


def test_system_timestamps_are_unique(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, now = SystemClock(), 50 * NANOSECONDS_PER_SECOND
    monkeypatch.setattr("gateway.stereo.device.clock.time.time_ns", lambda: now)
    assert clock.next_timestamp(None, PERIOD) == now
    assert clock.next_timestamp(now - 1, PERIOD) == now
    assert clock.next_timestamp(now, PERIOD) == now + 1
    assert clock.next_timestamp(now + NANOSECONDS_PER_SECOND - 1, PERIOD) == now + NANOSECONDS_PER_SECOND
    assert clock.next_timestamp(now + NANOSECONDS_PER_SECOND, PERIOD) == now, "set back by a second"


def test_simulated_timestamps_are_one_period_apart() -> None:
    clock = SimulatedClock(7)
    assert [clock.next_timestamp(None, PERIOD), clock.next_timestamp(7, PERIOD)] == [7, 7 + PERIOD]
    assert SimulatedClock().next_timestamp(None, PERIOD) == NANOSECONDS_PER_SECOND


def test_system_time_does_not_advance_with_frames() -> None:
    source = FixedClock()
    clock = clock_at(source)
    clock.timestamp = 3
    clock.skip_frame(PERIOD)
    clock.delay_for_alternate_exposure(PERIOD)
    assert clock.timestamp == 3
    assert clock.seconds_until_frame(0.0) == pytest.approx(0.04)


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
    now: int, expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("time.time_ns", lambda: now)
    assert SystemClock().next_timestamp(PREVIOUS, 0) == expected
    assert SystemClock().next_timestamp(None, 0) == now
