"""Samples in order from poses that arrive one by one."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.adapters.stereo.imu.imu_sampler import DELAY, MAX_PAUSE, PERIOD, ImuSampler, ImuSamples
from renderers.stereo.imu.imu_model import GRAVITY, MAX_ACCELERATION, MAX_ANGULAR_VELOCITY, ImuNoise
from tests.adapters.stereo.imu_motion import circle, matrices, rest

START = 1_700_000_000_123_456_789
"""Nanoseconds since the epoch."""
FRAME = 33_000_000
POSE = matrices(rest, np.zeros(1))[0]


def run(sampler: ImuSampler, frames: int, takes: int = 1) -> ImuSamples:
    """Move on a circle and return the samples, taken every ``takes`` frames."""
    poses = matrices(circle, 1e-9 * FRAME * np.arange(frames, dtype=np.float64))
    batches = []
    for number, pose in enumerate(poses):
        time = number * FRAME
        sampler.add(START + time, pose)
        if number % takes == 0:
            batches.append(sampler.take(START + time))
    fields = ("timestamps", "linear_acceleration", "angular_velocity")
    return ImuSamples(*(np.concatenate([getattr(batch, field) for batch in batches]) for field in fields))


def test_samples_come_once_and_in_time() -> None:
    samples = run(ImuSampler(None, 0), 100)
    assert set(np.diff(samples.timestamps).tolist()) == {PERIOD}
    assert (samples.timestamps % PERIOD == 0).all()
    assert START < samples.timestamps[0] < START + DELAY
    end = START + 99 * FRAME - DELAY
    assert end - PERIOD < samples.timestamps[-1] <= end
    np.testing.assert_allclose(samples.linear_acceleration[:, 0], -1.2, atol=0.02)


@pytest.mark.parametrize("noise", [None, ImuNoise()])
def test_samples_do_not_depend_on_when_they_are_taken(noise: ImuNoise | None) -> None:
    often, seldom = run(ImuSampler(noise, 1), 100), run(ImuSampler(noise, 1), 100, takes=9)
    np.testing.assert_array_equal(often.timestamps, seldom.timestamps)
    np.testing.assert_allclose(often.linear_acceleration, seldom.linear_acceleration, atol=1e-8)
    np.testing.assert_allclose(often.angular_velocity, seldom.angular_velocity, atol=1e-8)
    other = run(ImuSampler(ImuNoise(), 2), 100)
    assert np.abs(other.linear_acceleration - often.linear_acceleration).max() > 1e-3


def test_nothing_without_poses() -> None:
    sampler = ImuSampler(None, 0)
    assert len(sampler.take(START)) == 0
    sampler.add(START, POSE)
    assert len(sampler.take(START)) == 0
    samples = sampler.take(START + 2 * DELAY)
    np.testing.assert_allclose(samples.linear_acceleration[:, 1], -GRAVITY, atol=1e-9)


def test_values_stay_in_the_sensors_range() -> None:
    sampler = ImuSampler(ImuNoise(), 0)
    sampler.add(START, POSE)
    far = POSE.copy()
    far[0, 3] = 1e9
    far[:3, :3] = far[:3, :3] @ np.diag((-1.0, -1.0, 1.0))
    sampler.add(START + MAX_PAUSE // 2, far)
    samples = sampler.take(START + MAX_PAUSE)
    assert np.abs(samples.linear_acceleration).max() == MAX_ACCELERATION
    assert np.abs(samples.angular_velocity).max() <= MAX_ANGULAR_VELOCITY
    assert np.isfinite(samples.angular_velocity).all()


def test_poses_at_nearly_the_same_time_and_equal_ones() -> None:
    sampler = ImuSampler(None, 0)
    for number in range(2000):
        pose = POSE.copy()
        pose[0, 3] = number * 1e-4
        sampler.add(START + number * 1_000_000, pose)
        sampler.add(START + number * 1_000_000, pose)
    samples = sampler.take(START + 2_000_000_000)
    np.testing.assert_allclose(samples.linear_acceleration[:, 0], 0.0, atol=0.5)


@pytest.mark.parametrize("moves", [True, False])
@pytest.mark.parametrize("change", [-10_000_000_000, 60_000_000_000])
def test_a_clock_that_was_set_starts_anew(change: int, moves: bool) -> None:
    sampler = ImuSampler(ImuNoise(), 0)
    sampler.add(START, POSE)
    assert len(sampler.take(START + 1_000_000_000)) > 0
    now = START + 1_000_000_000 + change
    if moves:
        moved = POSE.copy()
        moved[0, 3] += 1.0
        sampler.add(now, moved)
    assert len(sampler.take(now)) == 0
    samples = sampler.take(now + 1_000_000_000)
    assert len(samples) < 1_000_000_000 // PERIOD
    assert samples.timestamps[0] > now
    assert np.abs(samples.linear_acceleration - (0.0, -GRAVITY, 0.0)).max() < 0.5
