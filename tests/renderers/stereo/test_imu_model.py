"""What the IMU measures on known motions, and the statistics of its errors."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.stereo.imu.imu_model import GRAVITY, MAX_ACCELERATION, RATE, ImuNoise, measure, saturate
from renderers.stereo.imu.trajectory import (
    GRID_RATE,
    MAX_STEP,
    SETTLING_TIME,
    START_UP,
    interpolate,
    pose_vectors,
    smooth_path,
)
from renderers.stereo.sensor.camera_image import NoiseStream as Stream
from renderers.stereo.sensor.camera_image import frame_key
from renderers.stereo.sensor.noise import NORMAL_TABLE, normals
from tests.adapters.stereo.imu_motion import Motion, circle, matrices, rest, rotations, spin, wave

SECONDS = 4.0


def poses_of(motion: Motion, rate: float, jitter: float = 0.0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times and poses of a motion; ``jitter`` is the standard deviation of the times' errors in seconds."""
    times = np.arange(-0.5, SECONDS + 1.0, 1.0 / rate)
    late = np.abs(np.random.default_rng(0).normal(0.0, jitter, len(times)))
    return times + late, pose_vectors(matrices(motion, times))


def measured(motion: Motion, rate: float = 30.0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    times, poses = poses_of(motion, rate)
    return measure(times, poses, 0.0, int(SECONDS * RATE))


def test_a_camera_at_rest_measures_gravity_upwards() -> None:
    force, rate = measured(rest)
    np.testing.assert_allclose(force, np.tile((0.0, -GRAVITY, 0.0), (len(force), 1)), atol=1e-9)
    np.testing.assert_allclose(rate, 0.0, atol=1e-9)
    one_pose = measure(np.array([5.0]), pose_vectors(matrices(rest, np.zeros(1))), 0.0, 10)
    np.testing.assert_allclose(one_pose[0], force[:10], atol=1e-9)


def test_rotation_about_an_axis() -> None:
    force, rate = measured(spin)
    np.testing.assert_allclose(rate, np.tile((0.0, 0.0, 1.5), (len(rate), 1)), atol=1e-5)
    np.testing.assert_allclose(force, np.tile((0.0, 0.0, GRAVITY), (len(force), 1)), atol=1e-9)


@pytest.mark.parametrize("pose_rate", [25.0, 30.0, 100.0])
def test_a_circle_has_centripetal_acceleration(pose_rate: float) -> None:
    force, rate = measured(circle, pose_rate)
    np.testing.assert_allclose(force, np.tile((-0.3 * 2.0**2, 0.0, GRAVITY), (len(force), 1)), atol=0.02)
    np.testing.assert_allclose(rate, np.tile((0.0, 0.0, 2.0), (len(rate), 1)), atol=1e-4)


@pytest.mark.parametrize("pose_rate", [30.0, 100.0])
def test_integration_gives_the_path(pose_rate: float) -> None:
    times, poses = poses_of(wave, pose_rate)
    count, period = int(SECONDS * RATE), 1.0 / RATE
    force, rate = measure(times, poses, 0.0, count)
    positions, quaternions = smooth_path(times, poses, -period, 2 * (count + 1) + 1)
    R = matrices(wave, np.array([-0.5 * period]))[0, :3, :3]
    position, velocity = positions[2], (positions[2] - positions[0]) / period
    path, turns = [], []
    for a, w in zip(force, rate, strict=True):
        middle = R @ rotations(0.5 * period * w[None])[0]
        velocity = velocity + period * (middle @ a - np.array((0.0, 0.0, GRAVITY)))
        path.append(position)
        position = position + period * velocity
        R = R @ rotations(period * w[None])[0]
        turns.append(R)
    at = period * np.arange(count, dtype=np.float64)
    true_positions, _ = wave(at)
    true_rotations = matrices(wave, at + 0.5 * period)[:, :3, :3]
    angles = np.arccos(np.clip((np.einsum("nij,nij->n", np.array(turns), true_rotations) - 1.0) / 2.0, -1.0, 1.0))
    assert np.abs(positions[2:-2:2] - true_positions).max() < 0.001
    assert np.abs(np.array(path) - true_positions).max() < 0.01
    assert angles.max() < 0.002
    assert quaternions.shape == (2 * (count + 1) + 1, 4)


def test_late_poses_disturb_little() -> None:
    times, poses = poses_of(circle, 30.0, jitter=0.001)
    force, rate = measure(times, poses, 0.0, int(SECONDS * RATE))
    assert np.std(force[:, 0]) < 0.1
    assert np.std(rate[:, 2]) < 0.02


def test_a_teleport_stays_finite_and_ends() -> None:
    times = np.arange(0.0, 3.0, 1.0 / 30.0)
    poses = pose_vectors(matrices(rest, times))
    poses[45:, 0] += 50.0
    poses[45:, 3:] = (0.0, 1.0, 0.0, 0.0)
    force, rate = measure(times, poses, 0.5, 2 * RATE)
    assert np.isfinite(force).all()
    assert np.isfinite(rate).all()
    assert np.abs(force).max() > MAX_ACCELERATION
    assert np.abs(saturate(force, MAX_ACCELERATION)).max() == MAX_ACCELERATION
    at = 0.5 + np.arange(2 * RATE) / RATE
    still = np.abs(at - times[45]) > SETTLING_TIME
    np.testing.assert_allclose(np.linalg.norm(force[still], axis=1), GRAVITY, atol=1e-6)
    np.testing.assert_allclose(rate[still], 0.0, atol=1e-6)


def test_a_pose_is_kept_until_shortly_before_the_next() -> None:
    poses = np.zeros((2, 7))
    poses[1, 0] = 1.0
    poses[:, 3] = 1.0
    at = np.array((-1.0, 0.0, 5.0, 10.0 - MAX_STEP, 10.0 - 0.5 * MAX_STEP, 10.0, 11.0))
    path = interpolate(np.array((0.0, 10.0)), poses, at)
    np.testing.assert_allclose(path[:, 0], (0, 0, 0, 0, 0.5, 1, 1), atol=1e-9)


def test_settled_samples_do_not_depend_on_poses_to_come() -> None:
    times, poses = poses_of(wave, 30.0)
    count, end = 100, 100 / RATE + SETTLING_TIME
    known = times <= end
    all_poses = measure(times, poses, 0.0, count)
    known_poses = measure(times[known], poses[known], 0.0, count)
    np.testing.assert_allclose(all_poses, known_poses, atol=1e-9)
    late = times >= -START_UP
    late_poses = measure(times[late], poses[late], 0.1, count)
    np.testing.assert_allclose(late_poses, measure(times, poses, 0.1, count), atol=1e-9)


def test_quaternions_of_any_rotation() -> None:
    generator = np.random.default_rng(1)
    vectors = np.concatenate((generator.normal(0, 2, (200, 3)), np.pi * np.eye(3), np.zeros((1, 3))))
    poses = np.zeros((len(vectors), 4, 4))
    poses[:, :3, :3], poses[:, :3, 3] = rotations(vectors), vectors
    w, x, y, z = pose_vectors(poses)[:, 3:].T
    np.testing.assert_allclose(w * w + x * x + y * y + z * z, 1.0)
    np.testing.assert_allclose(1 - 2 * (y * y + z * z), poses[:, 0, 0], atol=1e-12)
    np.testing.assert_allclose(2 * (x * y + w * z), poses[:, 1, 0], atol=1e-12)
    np.testing.assert_allclose(2 * (y * z + w * x), poses[:, 2, 1], atol=1e-12)
    np.testing.assert_allclose(2 * (x * z + w * y), poses[:, 0, 2], atol=1e-12)


def test_noise_has_the_stated_densities() -> None:
    noise, count = ImuNoise(), 200_000
    errors, bias = noise.errors(3, 0, count, np.zeros(6))
    # Allan variance at an averaging time tau: density² / tau for white noise, walk² tau / 3 for the random walk.
    for axes, density, walk in (
        (slice(0, 3), noise.acceleration_density, noise.acceleration_walk),
        (slice(3, 6), noise.angular_velocity_density, noise.angular_velocity_walk),
    ):
        for samples in (1, 10, 100):
            tau = samples / RATE
            means = errors[: count // samples * samples, axes].reshape(-1, samples, 3).mean(axis=1)
            allan = 0.5 * (np.diff(means, axis=0) ** 2).mean()
            assert allan == pytest.approx(density**2 / tau + walk**2 * tau / 3.0, rel=0.1)
        ends = np.array([noise.errors(seed, 0, 2000, np.zeros(6))[1][axes] for seed in range(100)])
        assert np.std(ends) == pytest.approx(walk * (2000 / RATE) ** 0.5, rel=0.15)
    biases = np.array([noise.constant_bias(seed) for seed in range(300)])
    assert np.std(biases[:, :3]) == pytest.approx(noise.acceleration_bias, rel=0.1)
    assert np.std(biases[:, 3:]) == pytest.approx(noise.angular_velocity_bias, rel=0.1)
    assert bias.shape == (6,)


def test_noise_depends_on_seed_and_number_only() -> None:
    noise, start = ImuNoise(), np.zeros(6)
    errors, _ = noise.errors(5, 340_000_000_000, 30, start)
    first, bias = noise.errors(5, 340_000_000_000, 10, start)
    rest_of_them, _ = noise.errors(5, 340_000_000_010, 20, bias)
    np.testing.assert_array_equal(np.concatenate((first, rest_of_them)), errors)
    assert not np.array_equal(noise.errors(6, 340_000_000_000, 30, start)[0], errors)
    key = frame_key(1, 2, Stream.LEFT)
    numbers = normals(key, np.arange(10_000))
    assert set(numbers.tolist()) <= set(NORMAL_TABLE.astype(np.float64).tolist())
    assert abs(numbers.mean()) < 0.05
    assert np.std(numbers) == pytest.approx(1.0, rel=0.03)
    assert GRID_RATE == 2 * RATE
