"""The camera's IMU: publishes samples while clients are connected.

With the system clock, each change of the live tree gives a pose at that time (``PoseLog``), and samples are published
every ``PUBLISH_SECONDS``. With the simulated clock, each captured frame gives a pose, and samples are published at each
frame.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable
from typing import Final

import msgspec
import numpy as np
import structlog
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.timestamps import NANOSECONDS_PER_SECOND
from gateway.adapters.stereo.imu.imu_sampler import ImuSampler, ImuSamples
from gateway.adapters.stereo.stream.client_queues import ClientQueue, MessageHub
from gateway.scene.tree.live import LiveTree, Snapshot
from renderers.stereo.imu.imu_model import ImuNoise

PUBLISH_SECONDS: Final = 0.05
"""Interval between batches with the system clock, seconds: ten samples each."""
_DECIMALS: Final = 9
"""Decimals of the numbers: the last one is far below the noise, and above rounding that differs between CPUs."""
_encoder: Final = msgspec.json.Encoder()

_log = structlog.get_logger("stereo")


class PoseLog:
    """Poses of the camera, with the times of the changes of the scene."""

    def __init__(
        self,
        tree: LiveTree,
        pose_in: Callable[[Snapshot], NDArray[np.float64]],
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        """
        Args:
            tree: scene whose changes are recorded.
            pose_in: returns X_world_left, (4, 4) float64, in a snapshot.
            clock: returns the time, nanoseconds since the epoch.
        """
        self.clock = clock
        self._pose_in = pose_in
        self._tree = tree
        self._entries: deque[tuple[int, Snapshot]] = deque()
        """Times, nanoseconds since the epoch, and snapshots. The threads that change the tree append them."""
        self._stop_listening: Callable[[], None] = lambda: None

    def start(self) -> None:
        """Record the current pose, and every change from now on."""
        tree = self._tree
        begin = max(self.clock(), tree.snapshot.timestamp)
        self._entries.append((begin, tree.snapshot))
        # A change whose message arrived before ``begin`` counts from then on.
        self._stop_listening = self._tree.listen(
            lambda: self._entries.append((max(tree.snapshot.timestamp, begin), tree.snapshot))
        )

    def stop(self) -> None:
        """Stop recording, and discard the poses that were not taken."""
        self._stop_listening()
        self._entries.clear()

    def take(self) -> list[tuple[int, NDArray[np.float64]]]:
        """Return the poses since the last call: time, nanoseconds since the epoch, and (4, 4) float64 X_world_left."""
        poses = []
        while self._entries:
            timestamp, snapshot = self._entries.popleft()
            poses.append((timestamp, self._pose_in(snapshot)))
        return poses


class Imu:
    """IMU of one camera."""

    def __init__(self, config: StereoConfig, poses: PoseLog | None) -> None:
        """
        Args:
            config: fixed configuration.
            poses: source of poses; None: those of the captured frames (``frame_captured``).
        """
        self.hub = MessageHub("IMU", config.max_clients, config.max_imu_samples)
        """Lines of JSON, with their number of samples."""
        self._config = config
        self._poses = poses
        self._sampler: ImuSampler | None = None
        """Sampler of the captured frames' poses; None while there is no client."""

    async def run(self) -> None:
        """Publish samples until cancelled."""
        if self._poses is None:
            return
        while True:
            await self.hub.has_clients.wait()
            try:
                await self._publish_while_connected(self._poses)
            except Exception:  # noqa: BLE001 - the image streams continue
                _log.exception("the IMU has ended")
                self.hub.close("the IMU has ended by an internal error")
                return

    async def _publish_while_connected(self, poses: PoseLog) -> None:
        """Publish samples of the recorded poses until the last client disconnects."""
        sampler = self._new_sampler()
        poses.start()
        try:
            while self.hub.has_clients.is_set():
                await asyncio.sleep(PUBLISH_SECONDS)
                now = poses.clock()
                for timestamp, pose in poses.take():
                    sampler.add(timestamp, pose)
                self._publish(sampler.take(now))
        finally:
            poses.stop()

    def frame_captured(self, timestamp: int, pose: NDArray[np.float64]) -> None:
        """Publish samples up to a captured frame. For an IMU without a ``PoseLog``.

        Args:
            timestamp: nanoseconds since the epoch.
            pose: (4, 4) float64 X_world_left.
        """
        if not self.hub.has_clients.is_set():
            self._sampler = None
            return
        if self._sampler is None:
            self._sampler = self._new_sampler()
        self._sampler.add(timestamp, pose)
        self._publish(self._sampler.take(timestamp))

    def _publish(self, samples: ImuSamples) -> None:
        if len(samples) and len(self.hub):
            self.hub.put(json_lines(samples), len(samples))

    def _new_sampler(self) -> ImuSampler:
        return ImuSampler(ImuNoise() if self._config.noise else None, self._config.seed)


def json_lines(samples: ImuSamples) -> bytes:
    """Return the samples as lines of JSON, with the fields of the device's message ``Imu``."""
    seconds, nanoseconds = np.divmod(samples.timestamps, NANOSECONDS_PER_SECOND)
    vectors = (samples.linear_acceleration, samples.angular_velocity)
    # Adding 0.0 makes 0.0 of -0.0.
    forces, rates = (np.round(array, _DECIMALS) + 0.0 for array in vectors)
    return _encoder.encode_lines(
        [
            {
                "timestamp": {"sec": sec, "nsec": nsec},
                "linear_acceleration": dict(zip("xyz", force, strict=True)),
                "angular_velocity": dict(zip("xyz", rate, strict=True)),
            }
            for sec, nsec, force, rate in zip(
                seconds.tolist(), nanoseconds.tolist(), forces.tolist(), rates.tolist(), strict=True
            )
        ]
    )


async def next_lines(queue: ClientQueue) -> bytes:
    """Wait for samples and return all of them, after a line with the number of samples lost before them, if any.

    Raises:
        StreamError: the stream has ended, and the queue is empty.
    """
    lost, batches = await queue.get()
    return b"".join([_encoder.encode_lines([{"lost": lost}]) if lost else b"", *batches])
