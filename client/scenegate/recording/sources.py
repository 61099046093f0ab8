"""Threads that receive the scene, images and IMU samples, and put them into a queue. A full queue makes them wait.

Their servers skip what a slow client has no time for, so nothing else is bounded.
"""

from __future__ import annotations

import http.client
import json
import logging
import queue
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Final, NamedTuple
from urllib.parse import urlsplit, urlunsplit

from websockets.exceptions import InvalidStatus, WebSocketException
from websockets.sync.client import connect

from scenegate.camera.credentials import Credentials
from scenegate.camera.imu import open_imu_stream
from scenegate.camera.stream import StreamFailure, StreamOptions, receive
from scenegate.recording.values import ImuSample

_log = logging.getLogger(__name__)

QUEUED_ITEMS: Final = 32
"""Maximum number of received items that wait: image sets have megabytes."""
CONNECT_SECONDS: Final = 10.0
"""Timeout of the connection to the gateway's view."""
RETRY_SECONDS: Final = 1.0
"""Time between two attempts to reach a gateway or camera that has gone."""


class RecordingError(RuntimeError):
    """A source cannot be reached, or has ended; the message is one sentence."""


class Received(NamedTuple):
    """Something that a source has received, or the error that has ended it."""

    value: Any
    """A frame of the view (bytes), an image set, an ``ImuSample`` or an exception."""
    time: int
    """Time of reception, nanoseconds since the epoch."""


class Source:
    """A thread that puts what an iterator yields into a queue. After an error it begins again, if it has yielded."""

    def __init__(self, name: str, receive: Callable[[], Iterator[Any]], received: queue.Queue[Received]) -> None:
        self._receive = receive
        self._received = received
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        has_begun = is_lost = False
        while True:
            try:
                for value in self._receive():
                    has_begun, is_lost = True, False
                    self._received.put(Received(value, time.time_ns()))
            except Exception as error:  # noqa: BLE001 - the recorder raises the first one
                if not has_begun:
                    self._received.put(Received(error, time.time_ns()))
                    return
                if not is_lost:
                    _log.warning("%s; the recording goes on when it is back", error)
                is_lost = True
                time.sleep(RETRY_SECONDS)


def scene_frames(address: str, credentials: Credentials) -> Iterator[bytes]:
    """Yield the frames of a gateway's view.

    Args:
        address: of the gateway's HTTP port, ``http://HOST:PORT``.

    Raises:
        RecordingError: the gateway does not respond, or has closed the connection.
        OSError: a certificate cannot be read.
    """
    url = urlsplit(address)
    if url.scheme not in ("http", "https") or not url.hostname:
        raise RecordingError(f"the address of the gateway is {address!r}; it must be like http://HOST:PORT")
    try:
        context = credentials.context(url.scheme)
    except ValueError as error:
        raise RecordingError(f"{address}: {error}") from None
    target = urlunsplit(("ws" if context is None else "wss", url.netloc, f"{url.path.rstrip('/')}/view/ws", "", ""))
    headers = dict(credentials.metadata)
    try:
        with connect(
            target,
            additional_headers=headers,
            ssl=context,
            open_timeout=CONNECT_SECONDS,
            max_size=None,  # meshes
            compression=None,
            proxy=None,
        ) as socket:
            for frame in socket:
                if isinstance(frame, str):
                    continue
                yield frame
                kind = _kind(frame)
                if kind in ("update", "controls"):
                    socket.send("k" if kind == "update" else "c")
    except (OSError, WebSocketException) as error:
        refused = isinstance(error, InvalidStatus) and error.response.status_code in (401, 403)
        hint = "; it may want another --token" if refused else ""
        raise RecordingError(f"{address} gives no scene: {error or type(error).__name__}{hint}") from None
    raise RecordingError(f"{address} has closed the connection")


def camera_sets(options: StreamOptions) -> Iterator[Any]:
    """Yield the image sets of a camera.

    Raises:
        RecordingError: the camera cannot be reached, refuses the request, or ends the stream.
        OSError: a certificate cannot be read.
    """
    try:
        for image_set, _ in receive(options):
            yield image_set
    except StreamFailure as error:
        raise RecordingError(str(error)) from None


def imu_samples(address: str, credentials: Credentials, pipeline: int) -> Iterator[ImuSample]:
    """Yield the samples of a camera's IMU.

    Raises:
        ImuFailure: the gateway does not respond, or the camera has no IMU.
        RecordingError: the gateway has ended the stream.
        OSError: a certificate cannot be read.
    """
    connection, response = open_imu_stream(address, credentials, pipeline)
    try:
        for line in response:
            message = json.loads(line)
            if "lost" in message:
                continue
            stamp, force, rate = message["timestamp"], message["linear_acceleration"], message["angular_velocity"]
            yield ImuSample(
                stamp["sec"] * 10**9 + stamp["nsec"],
                (force["x"], force["y"], force["z"]),
                (rate["x"], rate["y"], rate["z"]),
            )
    except (OSError, ValueError, http.client.HTTPException):
        pass  # the connection has ended, perhaps in the middle of a line
    finally:
        response.close()
        connection.close()
    raise RecordingError(f"{address} has ended the stream of IMU samples")


def _kind(frame: bytes) -> str:
    """Return ``update`` or ``controls`` for the frames that the gateway wants acknowledged; else an empty text.

    The gateway writes ``kind`` first: parsing the header takes longer than this search.
    """
    start = frame[8:40]
    return next((kind for kind in ("update", "controls") if f'"kind":"{kind}"'.encode() in start), "")
