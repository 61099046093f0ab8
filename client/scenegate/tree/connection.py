"""Connection of the tree viewer client to an LCM network. The event loop of a thread of its own sends and receives."""

import asyncio
import contextlib
import threading
from collections.abc import Callable, Iterable, Mapping
from typing import Final

from scenegate.lcm.network import WHOLE_NAME, open_transport, resolve_url
from scenegate.lcm.transport import LcmMessage, TransportLimits

CLOSE_SECONDS = 2.0
"""Maximum time for messages to be sent when the connection is closed."""

OnFailure = Callable[[ConnectionError], None]
_LIMITS: Final = TransportLimits(receive_buffer_bytes=128 << 10)
"""Only responses are received, so that no more than the system's default is needed."""


class LcmConnection:
    """LCM connection that any thread may publish on. It connects again when it loses a TCPQ hub."""

    def __init__(self, url: str | None, handlers: Mapping[str, Callable[[bytes], None]], timeout: float) -> None:
        """Connect, and start the receiving thread, which calls the handler of a channel with each message.

        Raises ConnectionError without hub or route, ValueError if the URL is no text, or the timeout not positive.
        """
        if url is not None and not isinstance(url, str):
            raise ValueError(f"url must be an LCM URL such as 'tcpq://127.0.0.1:7700', not {url!r}")
        if not isinstance(timeout, (int, float)) or not timeout > 0.0:
            raise ValueError(f"timeout is {timeout!r}, it must be a positive number of seconds")
        self.url = resolve_url(url)
        self._handlers = handlers
        self._timeout = timeout
        self._transport = open_transport(self.url, tuple(name + WHOLE_NAME for name in handlers), _LIMITS)
        self._changed = threading.Condition()
        """Notified when the connection is made, lost or closed."""
        self._closed = False
        self._publishing: asyncio.Task[None] | None = None
        """Task of ``run_in_turn``."""
        self._loop = asyncio.SelectorEventLoop()  # on Windows, the default one cannot watch UDP sockets
        self._loop.call_soon(self._transport.start, self._on_message, self._on_connect)
        self._thread = threading.Thread(target=self._run, name="treeviewer-receive", daemon=True)
        self._thread.start()
        with self._changed:
            connected = self._changed.wait_for(lambda: self.is_connected, timeout)
        if not connected:
            problem = self.problem or "no connection in time"
            self.close()
            raise ConnectionError(f"LCM cannot join {self.url}: {problem}")

    def publish(self, channel: str, message: bytes | bytearray, failed: OnFailure = lambda error: None) -> None:
        """Send a message. Waits up to the timeout while there is no connection, but not until the message is sent.

        The receiving thread calls ``failed`` if it cannot be sent. Raises ConnectionError after the timeout.
        """
        if threading.current_thread() is self._thread:
            self._send(channel, message, failed)
            return
        with self._changed:
            if not self._changed.wait_for(lambda: self.is_connected or self._closed, self._timeout):
                raise ConnectionError(f"no connection to the LCM hub {self.url}: {self.problem}")
            if self._closed:
                raise ConnectionError("this viewer was closed")
            if not self._thread.is_alive():
                raise ConnectionError("connections do not survive a fork: connect in the child process")
            self._loop.call_soon_threadsafe(self._send, channel, message, failed)

    def run_in_turn(self, calls: Iterable[Callable[[], None]]) -> None:
        """Run calls that publish, each when what was published before is sent. Ends those of an earlier call.

        Must be called by the receiving thread, which runs them. They end when the connection is lost.
        """
        if self._publishing is not None:
            self._publishing.cancel()
        self._publishing = self._loop.create_task(self._run_in_turn(calls))

    async def _run_in_turn(self, calls: Iterable[Callable[[], None]]) -> None:
        with contextlib.suppress(OSError):
            for call in calls:
                await self._transport.drain(0)
                call()

    def close(self) -> None:
        """Stop the receiving thread. Further calls do nothing."""
        with self._changed:
            first, self._closed = not self._closed, True
            self._changed.notify_all()
        if first:
            self._loop.call_soon_threadsafe(self._loop.stop)
        if threading.current_thread() is not self._thread:
            self._thread.join()

    @property
    def is_connected(self) -> bool:
        """False while the connection to a hub is lost."""
        return self._transport.is_connected

    @property
    def problem(self) -> str:
        """Reason why the connection to a hub is lost; empty while there is one."""
        return str(self._transport.status().get("warning", ""))

    def _run(self) -> None:
        """Send and receive until the connection is closed: the body of the thread."""
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_forever()
            self._loop.run_until_complete(self._end())
        finally:
            self._loop.close()

    async def _end(self) -> None:
        if self._publishing is not None:
            self._publishing.cancel()
            await asyncio.wait({self._publishing})
        try:
            await asyncio.wait_for(self._transport.drain(0), CLOSE_SECONDS)
        except (OSError, asyncio.TimeoutError):
            pass
        await self._transport.close()

    def _on_connect(self) -> None:
        with self._changed:
            self._changed.notify_all()

    def _on_message(self, message: LcmMessage) -> None:
        handler = self._handlers.get(message.channel)
        if handler is not None:
            handler(bytes(message.data))

    def _send(self, channel: str, message: bytes | bytearray, failed: OnFailure) -> None:
        try:
            self._transport.publish(channel, message)
        except (OSError, ValueError) as error:
            failed(ConnectionError(f"LCM could not send {len(message)} bytes to {self.url}: {error}"))
