"""Threads that receive the scene and images, and put them into a queue. A full queue makes them wait.

Their servers skip what a slow client has no time for, so nothing else is bounded.
"""

import asyncio
import logging
import queue
import threading
import time
from collections.abc import Callable, Iterator
from typing import Final, Literal, NamedTuple

from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosedOK, InvalidStatus, WebSocketException

from scenegate.camera import image_interface_pb2 as pb
from scenegate.camera.stream import StreamOptions, receive
from scenegate.credentials import Credentials
from scenegate.gateway_http import CONNECT_SECONDS, GatewayError, parse_address, reason_of
from scenegate.recording.view_frames import ViewFrame

_log = logging.getLogger(__name__)

QUEUED_ITEMS: Final = 32
"""Maximum number of received items that wait: image sets have megabytes."""
WAIT_SECONDS: Final = 10.0
"""Maximum time until the first message of a source."""
RETRY_SECONDS: Final = 1.0
"""Time between two attempts to reach a gateway or camera that has gone."""
ACKNOWLEDGEMENTS: Final = {"update": "k", "controls": "c"}
"""Responses that the gateway waits for, by the kind of the frame."""


SourceName = Literal["scene", "images", "depth"]
"""``images`` are left and right at the camera's rate; ``depth`` comes at its own, with the left image for colours."""


class Unreachable(GatewayError):  # noqa: N818 - a condition
    """The gateway does not respond, or has closed the connection."""


class Received(NamedTuple):
    """Something that a source has received."""

    source: SourceName
    value: ViewFrame | pb.ImageSet
    time_ns: int
    """Time of reception, nanoseconds since the epoch."""
    is_first: bool
    """True for the first value of a connection."""


Receive = Callable[[], Iterator[ViewFrame | pb.ImageSet]]


def start_receiving(source: SourceName, receive: Receive, received: queue.Queue[Received | Exception]) -> None:
    """Start a thread that puts what the iterator of ``receive`` yields into a queue, until it ends.

    After an error it begins again if the iterator has yielded before, or the gateway was unreachable, at first for
    ``WAIT_SECONDS``.
    """
    threading.Thread(target=_receive, args=(source, receive, received), name=source, daemon=True).start()


def _receive(source: SourceName, receive: Receive, received: queue.Queue[Received | Exception]) -> None:
    has_begun = is_lost = False
    deadline = time.monotonic() + WAIT_SECONDS
    while True:
        try:
            for number, value in enumerate(receive()):
                has_begun = True
                is_lost = False
                received.put(Received(source, value, time.time_ns(), is_first=number == 0))
            return
        except Exception as error:  # noqa: BLE001 - the recorder raises the first one
            is_waiting = isinstance(error, Unreachable) and time.monotonic() < deadline
            if not has_begun and not is_waiting:
                received.put(error)
                return
            if has_begun and not is_lost:
                _log.warning("%s; the recording goes on when it is back", error)
            is_lost = True
            time.sleep(RETRY_SECONDS)


def scene_frames(address: str, credentials: Credentials) -> Iterator[ViewFrame]:
    """Yield the frames of a gateway's view; ``address`` is that of its HTTP port, ``http://HOST:PORT``.

    Raises GatewayError if the gateway does not respond (``Unreachable``), or refuses the connection; ViewFrameError if
    it has sent something invalid; OSError if a certificate cannot be read.
    """
    host, port, path, context = parse_address(address, credentials)
    host = f"[{host}]" if ":" in host else host
    authority = host if port is None else f"{host}:{port}"
    # Not websockets' synchronous client: a thread of it reads while this one writes, which OpenSSL forbids.
    loop = asyncio.new_event_loop()
    connecting = connect(
        f"{'ws' if context is None else 'wss'}://{authority}{path}/view/ws",
        additional_headers=dict(credentials.metadata),
        ssl=context,
        open_timeout=CONNECT_SECONDS,
        max_size=None,  # meshes
        compression=None,
        proxy=None,
    )
    try:
        socket = loop.run_until_complete(connecting)
        try:
            while True:
                data = loop.run_until_complete(socket.recv())
                if isinstance(data, str):
                    continue
                frame = ViewFrame(data)
                yield frame
                if acknowledgement := ACKNOWLEDGEMENTS.get(frame.header.get("kind", "")):
                    loop.run_until_complete(socket.send(acknowledgement))
        finally:
            loop.run_until_complete(socket.close())
    except ConnectionClosedOK:
        raise Unreachable(f"{address} has closed the connection") from None
    except InvalidStatus as error:
        status = error.response.status_code
        hint = "; it may want another --token" if status in (401, 403) else ""
        raise GatewayError(f"{address} gives no scene: it has refused the connection ({status}){hint}") from None
    except (OSError, WebSocketException) as error:
        raise Unreachable(f"{address} gives no scene: {reason_of(error)}") from None
    finally:
        loop.close()


def camera_sets(options: StreamOptions) -> Iterator[pb.ImageSet]:
    """Yield the image sets of a camera; see ``receive`` for its errors."""
    for image_set, _ in receive(options):
        yield image_set
