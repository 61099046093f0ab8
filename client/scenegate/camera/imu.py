"""Record the samples of a camera's IMU from a gateway, for ``scenegate stream --imu``."""

from __future__ import annotations

import http.client
import json
import socket
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TextIO

from scenegate.closing import Closing
from scenegate.credentials import Credentials
from scenegate.gateway_http import GatewayError, Stream, open_stream

_HEADER: Final = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n"
)
"""First line of the file, as in the data sets EuRoC and TUM VI."""


@dataclass(frozen=True, slots=True)
class ImuSample:
    """A sample of an IMU, in the frame of the left camera."""

    time_ns: int
    """Nanoseconds since the epoch."""
    acceleration: tuple[float, float, float]
    """Specific force, m/s²."""
    angular_velocity: tuple[float, float, float]
    """rad/s."""


class ImuRecorder(Closing):
    """Writes samples to a file in EuRoC's format until it is closed. A thread reads the stream."""

    def __init__(self, address: str, path: Path, credentials: Credentials, pipeline: int = 0) -> None:
        """Connect and start recording.

        Args:
            address: address of the gateway's HTTP port, ``http://HOST:PORT``.
            path: file to write.
            credentials: token and TLS certificates.
            pipeline: number of the camera.

        Raises:
            GatewayError: the gateway does not respond, or the camera has no IMU.
            OSError: a certificate cannot be read, or the file cannot be written.
        """
        self.samples = 0
        """Number of samples written."""
        self.lost = 0
        """Number of samples that the gateway dropped because they were read too slowly."""
        self._address = address
        self._path = path
        self._newest = -1
        """Timestamp of the newest sample, nanoseconds since the epoch."""
        self._changed = threading.Condition()
        """Guards ``samples``, ``lost``, ``_newest``, ``_ended`` and ``_closing``; notified of samples and the end."""
        self._ended = False
        self._closing = False
        self._stream = open_imu_stream(address, credentials, pipeline)
        self._path.write_text(_HEADER, "ascii")
        self._thread = threading.Thread(target=self._read, name="IMU recorder", daemon=True)
        self._thread.start()

    def wait_for_sample(self, time_ns: int, seconds: float) -> bool:
        """Wait for a sample at or after a time; return True if there is one.

        Args:
            time_ns: nanoseconds since the epoch.
            seconds: maximum time to wait.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._newest >= time_ns or self._ended, seconds)
            return self._newest >= time_ns

    def check(self) -> None:
        """Raise GatewayError if the gateway has ended the stream."""
        with self._changed:
            if self._ended and not self._closing:
                raise GatewayError(f"{self._address} ended the IMU stream")

    def close(self) -> None:
        """Disconnect, and wait until all samples received are in the file."""
        with self._changed:
            self._closing = True
        try:
            self._stream.socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass  # disconnected already
        self._thread.join()
        self._stream.close()

    def _read(self) -> None:
        """Write the samples to the file until the connection ends."""
        try:
            with self._path.open("a", encoding="ascii") as file:
                for sample in read_samples(self._stream):
                    self._write(file, sample)
        except OSError:
            pass  # the disk is full: the stream counts as ended
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()

    def _write(self, file: TextIO, sample: ImuSample | int) -> None:
        if isinstance(sample, int):
            with self._changed:
                self.lost += sample
            return
        numbers = (*sample.angular_velocity, *sample.acceleration)
        file.write(f"{sample.time_ns},{','.join(f'{number:.9g}' for number in numbers)}\n")
        with self._changed:
            self.samples += 1
            self._newest = sample.time_ns
            self._changed.notify_all()


def open_imu_stream(address: str, credentials: Credentials, pipeline: int) -> Stream:
    """Return the response of ``GET /stereo/imu``; see ``open_stream`` for its errors."""
    stream = open_stream(address, "stereo/imu", credentials, "IMU samples", pipeline=pipeline)
    stream.socket.settimeout(None)  # with the simulated clock there are no samples between frames
    return stream


def read_samples(stream: Stream) -> Iterator[ImuSample | int]:
    """Yield samples, and the number of samples that were lost in between, until the connection ends."""
    try:
        for line in stream.body:
            message = json.loads(line)
            if "lost" in message:
                yield int(message["lost"])
                continue
            stamp, force, rate = message["timestamp"], message["linear_acceleration"], message["angular_velocity"]
            yield ImuSample(
                stamp["sec"] * 10**9 + stamp["nsec"],
                (force["x"], force["y"], force["z"]),
                (rate["x"], rate["y"], rate["z"]),
            )
    except (OSError, ValueError, http.client.HTTPException):
        return  # the connection has ended, perhaps in the middle of a line
