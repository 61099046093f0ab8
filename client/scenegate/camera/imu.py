"""Record the samples of a camera's IMU from a gateway, for ``scenegate stream --imu``."""

from __future__ import annotations

import http.client
import json
import socket
import threading
from pathlib import Path
from types import TracebackType
from typing import Any, Final
from urllib.parse import urlencode, urlsplit

from scenegate.camera.credentials import Credentials

_CONNECT_SECONDS: Final = 10.0
"""Timeout of the connection and of the response's headers."""
_HEADER: Final = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n"
)
"""First line of the file, as in the data sets EuRoC and TUM VI."""


class ImuFailure(RuntimeError):  # noqa: N818 - public name
    """The samples cannot be recorded; the message is one sentence."""


class ImuRecorder:
    """Writes samples to a file in EuRoC's format until it is closed. A thread reads the stream."""

    def __init__(self, address: str, path: Path, credentials: Credentials, pipeline: int = 0) -> None:
        """Connect and start recording.

        Args:
            address: address of the gateway's HTTP port, ``http://HOST:PORT``.
            path: file to write.
            credentials: token and TLS certificates.
            pipeline: number of the camera.

        Raises:
            ImuFailure: the gateway does not respond, or the camera has no IMU.
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
        self._socket, self._response = open_imu_stream(address, credentials, pipeline)
        self._path.write_text(_HEADER, "ascii")
        self._thread = threading.Thread(target=self._read, name="IMU recorder", daemon=True)
        self._thread.start()

    def __enter__(self) -> ImuRecorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def wait_for_sample(self, timestamp: int, seconds: float) -> bool:
        """Wait for a sample at or after a time; return True if there is one.

        Args:
            timestamp: nanoseconds since the epoch.
            seconds: maximum time to wait.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._newest >= timestamp or self._ended, seconds)
            return self._newest >= timestamp

    def check(self) -> None:
        """Raise ImuFailure if the gateway has ended the stream."""
        with self._changed:
            if self._ended and not self._closing:
                raise ImuFailure(f"{self._address} ended the IMU stream")

    def close(self) -> None:
        """Disconnect, and wait until all samples received are in the file."""
        with self._changed:
            self._closing = True
        try:
            self._socket.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass  # disconnected already
        self._thread.join()
        self._response.close()
        self._socket.close()

    def _read(self) -> None:
        """Write the lines of the response to the file until the connection ends."""
        try:
            with self._path.open("a", encoding="ascii") as file:
                for line in self._response:
                    self._write(file, json.loads(line))
        except (OSError, ValueError, http.client.HTTPException):
            pass  # the connection has ended, perhaps in the middle of a line
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()

    def _write(self, file: Any, message: dict[str, Any]) -> None:
        """Write a sample to the file, or count the lost samples that a message reports."""
        if "lost" in message:
            with self._changed:
                self.lost += message["lost"]
            return
        time, force, rate = message["timestamp"], message["linear_acceleration"], message["angular_velocity"]
        timestamp = time["sec"] * 10**9 + time["nsec"]
        numbers = (rate["x"], rate["y"], rate["z"], force["x"], force["y"], force["z"])
        file.write(f"{timestamp},{','.join(f'{number:.9g}' for number in numbers)}\n")
        with self._changed:
            self.samples += 1
            self._newest = timestamp
            self._changed.notify_all()


def open_imu_stream(
    address: str, credentials: Credentials, pipeline: int
) -> tuple[socket.socket, http.client.HTTPResponse]:
    """Return the connection and the response of ``GET /stereo/imu``, of which only the headers have been read.

    Raises:
        ImuFailure: the gateway does not respond, or the camera has no IMU.
        OSError: a certificate cannot be read.
    """
    url = urlsplit(address)
    if url.scheme not in ("http", "https") or not url.hostname:
        raise ImuFailure(f"the address for IMU samples is {address!r}; it must be like http://HOST:PORT")
    try:
        context = credentials.context(url.scheme)
    except ValueError as error:
        raise ImuFailure(f"{address}: {error}") from None
    connection: http.client.HTTPConnection
    if context is not None:
        connection = http.client.HTTPSConnection(url.hostname, _port(url), timeout=_CONNECT_SECONDS, context=context)
    else:
        connection = http.client.HTTPConnection(url.hostname, _port(url), timeout=_CONNECT_SECONDS)
    target = f"{url.path.rstrip('/')}/stereo/imu?{urlencode({'pipeline': pipeline})}"
    try:
        connection.connect()
        connected = connection.sock
        connection.request("GET", target, headers=dict(credentials.metadata))
        response = connection.getresponse()
    except TimeoutError:
        connection.close()
        reason = (
            f"no answer within {_CONNECT_SECONDS:g} s; a gateway that starts answers after its kernels are compiled"
        )
        raise ImuFailure(f"{address} gives no IMU samples: {reason}") from None
    except (OSError, http.client.HTTPException) as error:
        connection.close()
        raise ImuFailure(f"{address} gives no IMU samples: {error or type(error).__name__}") from None
    if response.status != 200:
        text = response.read(10_000).decode("utf-8", "replace")
        connection.close()
        raise ImuFailure(f"{address} gives no IMU samples: {response.status}: {_message(text)}")
    connected.settimeout(None)  # with the simulated clock there are no samples between frames
    return connected, response


def _port(url: Any) -> int | None:
    """Return the port of a URL, None if it has none; raise ImuFailure if it is not valid."""
    try:
        port: int | None = url.port
    except ValueError as error:
        raise ImuFailure(f"the address for IMU samples has no valid port: {error}") from None
    return port


def _message(text: str) -> str:
    """Return the message of an error response, or its first line."""
    try:
        return str(json.loads(text)["message"])
    except (ValueError, KeyError, TypeError):
        return text.partition("\n")[0]
