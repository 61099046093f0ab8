"""Model of an inertial measurement unit (IMU): measurements of an accelerometer and a gyroscope along a path.

Frame: the left optical frame (+Z forward, +X right, +Y down), with the origin in the left optical centre. The
accelerometer measures specific force: at rest, 9.81 m/s² away from the ground. The world is Z-up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.stereo.imu.trajectory import GRID_RATE, smooth_path
from renderers.stereo.sensor.camera_image import NoiseStream, frame_key
from renderers.stereo.sensor.noise import normals

RATE: Final = 200
"""Samples per second."""
GRAVITY: Final = 9.81
"""Acceleration of free fall, m/s²."""
MAX_ACCELERATION: Final = 16.0 * GRAVITY
"""Range of the accelerometer on each axis, m/s²; the widest of the BMI160."""
MAX_ANGULAR_VELOCITY: Final = math.radians(2000.0)
"""Range of the gyroscope on each axis, rad/s; the widest of the BMI160."""

_NOISE_FRAME: Final = 0
"""Frame number of the random keys, which no image has: theirs start at 1."""
_NUMBERS_PER_SAMPLE: Final = 12
"""Random numbers per sample: white noise and a step of the random walk for six axes."""


@dataclass(frozen=True, slots=True)
class ImuNoise:
    """Errors of the sensors.

    Noise densities and random walks are those that TUM measured with an Allan plot on a BMI160, the IMU of the TUM VI
    data set, at 200 Hz (Schubert et al. 2018). The constant biases are our choice, of the order of what a
    calibration at the factory leaves.
    """

    acceleration_density: float = 1.4e-3
    """White noise, m/s²/√Hz."""
    acceleration_walk: float = 8.6e-5
    """Random walk of the bias, m/s³/√Hz."""
    acceleration_bias: float = 0.04
    """Standard deviation of the constant bias, m/s²."""
    angular_velocity_density: float = 8.0e-5
    """White noise, rad/s/√Hz."""
    angular_velocity_walk: float = 2.2e-6
    """Random walk of the bias, rad/s²/√Hz."""
    angular_velocity_bias: float = 0.005
    """Standard deviation of the constant bias, rad/s."""

    def _per_axis(self, acceleration: float, angular_velocity: float) -> NDArray[np.float64]:
        """Return a value for each of the six axes, (6,) float64: three times each argument."""
        return np.repeat((acceleration, angular_velocity), 3)

    def constant_bias(self, seed: int) -> NDArray[np.float64]:
        """Return the constant biases: (6,) float64, acceleration in m/s², then angular velocity in rad/s."""
        key = frame_key(seed, _NOISE_FRAME, NoiseStream.RIGHT)  # LEFT is for the errors of samples
        return normals(key, np.arange(6)) * self._per_axis(self.acceleration_bias, self.angular_velocity_bias)

    def errors(
        self, seed: int, first: int, count: int, bias: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the errors of successive samples (noise and bias), and the bias of the sample after them.

        Args:
            seed: equal seeds and sample numbers give equal noise.
            first: number of the first sample.
            count: number of samples.
            bias: (6,) float64, bias of the first sample.

        Returns:
            (count, 6) float64 errors and (6,) float64 bias, each acceleration in m/s², then angular velocity in rad/s.
        """
        key = frame_key(seed, _NOISE_FRAME, NoiseStream.LEFT)
        counters = np.arange(_NUMBERS_PER_SAMPLE * first, _NUMBERS_PER_SAMPLE * (first + count))
        random = normals(key, counters).reshape(count, 2, 6)
        white = random[:, 0] * self._per_axis(self.acceleration_density, self.angular_velocity_density) * RATE**0.5
        steps = random[:, 1] * self._per_axis(self.acceleration_walk, self.angular_velocity_walk) / RATE**0.5
        biases = bias + np.concatenate((np.zeros((1, 6)), np.cumsum(steps, axis=0)))
        return white + biases[:-1], biases[-1]


def measure(
    times: NDArray[np.float64], poses: NDArray[np.float64], start: float, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the measurements of sensors without errors along the smooth path (``trajectory``).

    Acceleration is the second difference of the positions. Angular velocity is the rotation from half a period before
    the sample to half a period after it. Their sums therefore lead back to the smooth path.

    Args:
        times: (K,) float64, seconds, increasing.
        poses: (K, 7) float64, poses of the left optical frame in the world: x, y, z, qw, qx, qy, qz.
        start: time of the first sample, seconds.
        count: number of samples.

    Returns:
        (count, 3) float64 specific force, m/s², and (count, 3) float64 angular velocity, rad/s, both in the left
        optical frame.
    """
    grid_step = GRID_RATE // RATE
    positions, quaternions = smooth_path(times, poses, start - 1.0 / RATE, grid_step * (count + 1) + 1)
    at_samples = positions[::grid_step]
    acceleration = (at_samples[2:] - 2.0 * at_samples[1:-1] + at_samples[:-2]) * RATE**2
    acceleration[:, 2] += GRAVITY
    force = _to_body(quaternions[grid_step:-grid_step:grid_step], acceleration)
    half_periods = quaternions[1::grid_step]
    return force, _rotation_vector(half_periods[:-1], half_periods[1:]) * RATE


def saturate(values: NDArray[np.float64], limit: float) -> NDArray[np.float64]:
    """Return values of any shape, clipped to a sensor's range of -limit to limit."""
    return np.clip(values, -limit, limit)


def _to_body(quaternions: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors of the world's frame in the body's frame, (N, 3) float64.

    Args:
        quaternions: (N, 4) float64, body to world, [w, x, y, z].
        vectors: (N, 3) float64, in the world's frame.
    """
    w, axis = quaternions[:, :1], -quaternions[:, 1:]
    twice = 2.0 * np.cross(axis, vectors)
    rotated: NDArray[np.float64] = vectors + w * twice + np.cross(axis, twice)
    return rotated


def _rotation_vector(before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotations from one orientation to another in the body's frame.

    Args:
        before, after: (N, 4) float64 unit quaternions, [w, x, y, z].

    Returns:
        (N, 3) float64: axis times angle, radians.
    """
    w0, v0, w1, v1 = before[:, :1], before[:, 1:], after[:, :1], after[:, 1:]
    vector = w0 * v1 - w1 * v0 - np.cross(v0, v1)
    scalar = w0 * w1 + (v0 * v1).sum(axis=1, keepdims=True)
    vector = np.where(scalar < 0.0, -vector, vector)
    sine = np.linalg.norm(vector, axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, np.abs(scalar))
    rotations: NDArray[np.float64] = vector * np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 1e-12)
    return rotations
