"""Samples of the camera's IMU from its poses. Does no I/O and reads no clock: times and poses in, samples out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.timestamps import NANOSECONDS_PER_SECOND
from renderers.stereo.imu.imu_model import MAX_ACCELERATION, MAX_ANGULAR_VELOCITY, RATE, ImuNoise, measure, saturate
from renderers.stereo.imu.trajectory import SETTLING_TIME, START_UP, pose_vectors

PERIOD: Final = NANOSECONDS_PER_SECOND // RATE
"""Nanoseconds between samples. Timestamps are multiples of it."""
DELAY: Final = round(SETTLING_TIME * NANOSECONDS_PER_SECOND)
"""Age of a sample when it is made, nanoseconds."""
MAX_PAUSE: Final = 5 * NANOSECONDS_PER_SECOND
"""Maximum time between two calls of ``take``, nanoseconds. After a longer one (suspended computer), or if the clock was
set back by more, the IMU restarts: its samples begin again as after the first pose."""

_MIN_SPACING: Final = 2_500_000
"""Minimum time between two poses, nanoseconds. A pose that follows sooner replaces the one before it."""
_MAX_POSE_AGE: Final = NANOSECONDS_PER_SECOND
"""Age of poses relative to the next sample beyond which they are dropped, nanoseconds: more than the smooth path
needs."""


@dataclass(frozen=True, slots=True)
class ImuSamples:
    """Successive samples, in the left optical frame."""

    timestamps: NDArray[np.int64]
    """(N,) int64, nanoseconds since the epoch."""
    linear_acceleration: NDArray[np.float64]
    """(N, 3) float64, specific force in m/s²."""
    angular_velocity: NDArray[np.float64]
    """(N, 3) float64, rad/s."""

    def __len__(self) -> int:
        return len(self.timestamps)


class ImuSampler:
    """Makes the samples of one camera, in order of time."""

    def __init__(self, noise: ImuNoise | None, seed: int) -> None:
        """
        Args:
            noise: errors of the sensors; None: no errors.
            seed: seed of the errors.
        """
        self._noise = noise
        self._seed = seed
        self._bias = np.zeros(6)
        """(6,) float64, bias of the next sample: acceleration in m/s², then angular velocity in rad/s."""
        self._times: list[int] = []
        """Timestamps of the poses, nanoseconds, increasing."""
        self._poses: list[NDArray[np.float64]] = []
        """(4, 4) float64 X_world_left each."""
        self._next_number = 0
        """Number of the next sample: its timestamp divided by ``PERIOD``."""

    def add(self, timestamp: int, X_world_left: NDArray[np.float64]) -> None:
        """Add a pose. One equal to the last is not stored: a long time until the next stored pose counts as rest.

        Args:
            timestamp: nanoseconds since the epoch. A pose earlier than the last one restarts the IMU.
            X_world_left: (4, 4) float64.
        """
        if not self._times or timestamp < self._times[-1]:
            self._restart(timestamp, X_world_left)
        elif timestamp - self._times[-1] < _MIN_SPACING:
            self._poses[-1] = X_world_left
        elif not np.array_equal(X_world_left, self._poses[-1]):
            self._times.append(timestamp)
            self._poses.append(X_world_left)

    def take(self, now: int) -> ImuSamples:
        """Return the samples up to ``now - DELAY`` that were not returned before.

        Args:
            now: nanoseconds since the epoch; all poses up to this time were added.
        """
        end_number = (now - DELAY) // PERIOD + 1
        if self._times and abs(end_number - self._next_number) > MAX_PAUSE // PERIOD:
            self._restart(now, self._poses[-1])
        if not self._times or end_number <= self._next_number:
            return ImuSamples(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)))
        samples = self._noisy_samples(self._next_number, end_number - self._next_number)
        self._next_number = end_number
        self._drop_old_poses()
        return samples

    def _restart(self, timestamp: int, X_world_left: NDArray[np.float64]) -> None:
        """Forget all poses but this one, and begin samples where the smooth path does not depend on earlier ones."""
        self._times, self._poses = [timestamp], [X_world_left]
        first_timestamp = timestamp + round(START_UP * NANOSECONDS_PER_SECOND)
        self._next_number = -(-first_timestamp // PERIOD)  # rounded up
        if self._noise is not None:
            self._bias = self._noise.constant_bias(self._seed)

    def _noisy_samples(self, first: int, count: int) -> ImuSamples:
        """Return ``count`` samples, of which the first has the number ``first``."""
        timestamps = np.arange(first, first + count) * PERIOD
        # Relative to the first sample: in float64, seconds since the epoch have a resolution of 0.2 µs only.
        pose_seconds = (np.array(self._times) - timestamps[0]) / NANOSECONDS_PER_SECOND
        force, angular_velocity = measure(pose_seconds, pose_vectors(np.array(self._poses)), 0.0, count)
        if self._noise is not None:
            errors, self._bias = self._noise.errors(self._seed, first, count, self._bias)
            force, angular_velocity = force + errors[:, :3], angular_velocity + errors[:, 3:]
        return ImuSamples(
            timestamps, saturate(force, MAX_ACCELERATION), saturate(angular_velocity, MAX_ANGULAR_VELOCITY)
        )

    def _drop_old_poses(self) -> None:
        """Drop poses that no later sample needs."""
        oldest = self._next_number * PERIOD - _MAX_POSE_AGE
        # The path before the pose [2] depends on [0] and [1]: its tangent needs the pose before.
        while len(self._times) > 2 and self._times[2] < oldest:
            del self._times[0], self._poses[0]
