"""Lines of JSON for the clients of the camera's IMU."""

from __future__ import annotations

import msgspec
import numpy as np

from gateway.stereo.device.timestamps import NANOSECONDS_PER_SECOND
from gateway.stereo.imu.imu_sampler import ImuSamples
from gateway.stereo.stream.client_queues import ClientQueue

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


async def next_lines(queue: ClientQueue) -> bytes:
    """Wait for samples and return all of them, after a line with the number of samples lost before them, if any.

    Raises:
        StreamError: the stream has ended, and the queue is empty.
    """
    lost, batches = await queue.get()
    return b"".join([_encoder.encode_lines([{"lost": lost}]) if lost else b"", *batches])
