"""Clients of the camera's IMU. Each has a queue of lines of JSON: slow clients lose samples and delay no others."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

import msgspec
import numpy as np

from gateway.stereo.device.clock import NANOSECONDS_PER_SECOND
from gateway.stereo.imu.imu_sampler import ImuSamples
from gateway.stereo.stream.subscriptions import LimitError, StreamError

_DECIMALS = 9
"""Decimals of the numbers: the last one is far below the noise, and above rounding that differs between CPUs."""
_encoder = msgspec.json.Encoder()


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


class ImuQueue:
    """Samples that wait for one client."""

    def __init__(self, max_samples: int) -> None:
        """
        Args:
            max_samples: maximum number of samples; beyond it the oldest are dropped.
        """
        self._max_samples = max_samples
        self._batches: deque[tuple[bytes, int]] = deque()
        """Lines of JSON and their number, of each call of ``put``."""
        self._waiting = 0
        """Number of samples in the queue."""
        self._lost = 0
        """Number of samples dropped since the last ``get``."""
        self._close_reason = ""
        """Reason for the end of the stream; empty while it is open."""
        self._changed = asyncio.Event()

    def put(self, lines: bytes, count: int) -> None:
        """Add ``count`` samples as lines of JSON. Drop the oldest batches beyond the limit."""
        self._batches.append((lines, count))
        self._waiting += count
        while self._waiting > self._max_samples:
            dropped = self._batches.popleft()[1]
            self._waiting -= dropped
            self._lost += dropped
        self._changed.set()

    def close(self, reason: str) -> None:
        """End the stream when the queue is empty."""
        self._close_reason = reason
        self._changed.set()

    async def get(self) -> bytes:
        """Wait for samples and return all of them, after a line with the number of samples lost before them, if any.

        Raises:
            StreamError: the stream has ended, and the queue is empty.
        """
        while not self._batches and not self._lost:
            if self._close_reason:
                raise StreamError(self._close_reason)
            self._changed.clear()
            await self._changed.wait()
        lost = _encoder.encode_lines([{"lost": self._lost}]) if self._lost else b""
        lines = b"".join(lines for lines, _ in self._batches)
        self._batches.clear()
        self._waiting = self._lost = 0
        return lost + lines


class ImuHub:
    """All clients of one camera's IMU."""

    def __init__(self, max_clients: int, max_samples: int) -> None:
        """
        Args:
            max_clients: maximum number of clients.
            max_samples: maximum number of samples in a client's queue.
        """
        self.connected = asyncio.Event()
        """Set while there are clients."""
        self._max_clients = max_clients
        self._max_samples = max_samples
        self._queues: set[ImuQueue] = set()
        self._close_reason = ""
        """Reason for refusing new clients; empty while the hub is open."""

    def __len__(self) -> int:
        return len(self._queues)

    @contextmanager
    def subscribe(self) -> Iterator[ImuQueue]:
        """Return a queue for the duration of the block.

        Raises:
            LimitError: too many clients.
            StreamError: the hub is closed.
        """
        if self._close_reason:
            raise StreamError(self._close_reason)
        if len(self._queues) >= self._max_clients:
            raise LimitError(f"{self._max_clients} IMU streams are open already, the limit (max_clients)")
        queue = ImuQueue(self._max_samples)
        self._queues.add(queue)
        self.connected.set()
        try:
            yield queue
        finally:
            self._queues.discard(queue)
            if not self._queues:
                self.connected.clear()

    def publish(self, samples: ImuSamples) -> None:
        """Add samples to every client's queue."""
        if len(samples) and self._queues:
            lines = json_lines(samples)
            for queue in self._queues:
                queue.put(lines, len(samples))

    def close(self, reason: str) -> None:
        """End all streams and refuse new ones."""
        self._close_reason = reason
        for queue in self._queues:
            queue.close(reason)
