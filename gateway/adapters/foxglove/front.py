"""The port of Foxglove's clients: checks where a client comes from, and passes its bytes to foxglove-sdk's server.

The SDK has no check of its own, and any page can connect to a port of the browser's machine (decision record 0029).
"""

import asyncio
import secrets
import sys
from collections.abc import Collection
from contextlib import suppress
from typing import Final

import structlog
from starlette.datastructures import Headers

from gateway.runtime.http.protection import Protection

APP_ORIGINS: Final = ("https://app.foxglove.dev", "https://studio.foxglove.dev")
"""Origins of the app in a browser."""
MAX_HEAD_BYTES: Final = 8192
"""Maximum size of a handshake. Those of browsers have less than 1 kB, without cookies."""
HEAD_SECONDS: Final = 10.0
"""Maximum time for a handshake."""
MAX_SOCKETS: Final = 64
"""Maximum number of sockets, two for each client. Only ``channels.MAX_CLIENTS`` clients get messages."""
_CHUNK_BYTES: Final = 65536

_log = structlog.get_logger("foxglove")


def inner_host() -> str:
    """Return one of 16 million addresses of this machine, which pages do not find. macOS has 127.0.0.1 alone."""
    if sys.platform == "darwin":
        return "127.0.0.1"
    return ".".join(["127", *(str(1 + secrets.randbelow(254)) for _ in range(3))])


class Front:
    """Listens on the port that clients use."""

    def __init__(self, hosts: Collection[str], origins: Collection[str]) -> None:
        """``hosts``, ``origins``: as for ``Protection``; the app's origins need not be there."""
        self._protection = Protection(hosts=hosts)
        self._origins = {*origins, *APP_ORIGINS}
        self.sockets: set[asyncio.StreamWriter] = set()
        """Open connections of clients, and those to the SDK's server."""
        self._inner = ("", 0)

    async def start(self, host: str, port: int, inner: tuple[str, int]) -> asyncio.Server:
        """Listen for clients, whose bytes go to ``inner``. Raises OSError if the port is taken."""
        self._inner = inner
        try:
            return await asyncio.start_server(self._serve, host, port, limit=MAX_HEAD_BYTES)
        except OSError as error:
            raise OSError(f"Foxglove's server cannot listen on {host} port {port}: {error.strerror}") from None

    def stop(self) -> None:
        """Disconnect all clients."""
        for writer in self.sockets:
            writer.transport.abort()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(self.sockets) >= MAX_SOCKETS:
            writer.close()
            return
        self.sockets.add(writer)
        try:
            async with asyncio.timeout(HEAD_SECONDS):
                head = await reader.readuntil(b"\r\n\r\n")
            if refusal := self.refusal(head, writer.get_extra_info("sockname")[0]):
                _log.info("A client of Foxglove's WebSocket was refused", reason=refusal)
                body = f"{refusal}\n".encode()
                size = f"Content-Length: {len(body)}\r\nContent-Type: text/plain; charset=utf-8"
                writer.write(f"HTTP/1.1 403 Forbidden\r\n{size}\r\nConnection: close\r\n\r\n".encode() + body)
                return
            inner_reader, inner_writer = await asyncio.open_connection(*self._inner)
            self.sockets.add(inner_writer)
            try:
                inner_writer.write(head)
                copies = [
                    asyncio.create_task(_copy(*each)) for each in ((reader, inner_writer), (inner_reader, writer))
                ]
                await asyncio.wait(copies, return_when=asyncio.FIRST_COMPLETED)
                for each in copies:
                    each.cancel()
            finally:
                self.sockets.discard(inner_writer)
                inner_writer.close()
        except (TimeoutError, OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError) as error:
            _log.debug("no handshake of a client of Foxglove's WebSocket", reason=repr(error))
        finally:
            self.sockets.discard(writer)
            writer.close()

    def refusal(self, head: bytes, address: str) -> str:
        """Return why a client with this handshake, connected to an address, is refused; empty if it is not."""
        request, *lines = head.decode("latin-1").rstrip("\r\n").split("\r\n")
        pairs = [line.partition(":") for line in lines]
        if not request.startswith("GET ") or any(not colon or name != name.strip() for name, colon, _ in pairs):
            return "not a WebSocket handshake"
        headers = Headers(raw=[(name.lower().encode(), value.strip().encode("latin-1")) for name, _, value in pairs])
        if headers.get("upgrade", "").lower() != "websocket":
            return "not a WebSocket handshake"
        if self._protection.refusal({"type": "websocket", "headers": headers.raw, "server": (address, None)}):
            return f"{headers['host'][:100]!a} is not this host; --trusted-hosts adds names"
        for origin in headers.getlist("origin"):  # programs have none
            # Desktop apps have file:// or a scheme of their own, which pages of the web never have.
            is_page = origin == "null" or origin.lower().startswith(("http:", "https:"))
            if is_page and not {origin, "*"} & self._origins:
                return f"page of {origin[:100]!a}; --cors-origins adds origins"
        return ""


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Pass bytes on until the end, no faster than they are taken."""
    with suppress(OSError):
        while data := await reader.read(_CHUNK_BYTES):
            writer.write(data)
            await writer.drain()
