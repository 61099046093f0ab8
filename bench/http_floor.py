"""The least that a server can do with a render request: receive it, hash it, send a stored response.

``python bench/http_floor.py < RESPONSE`` prints its port. Without limits, routes or logs.
"""

import asyncio
import hashlib
import sys

import httptools
import uvloop


class Floor(asyncio.Protocol):
    """A connection for one request."""

    response = b""
    transport: asyncio.Transport

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # uvloop: no subclass
        self.transport = transport
        self.parser = httptools.HttpRequestParser(self)
        self.sha256 = hashlib.sha256()

    def data_received(self, data: bytes) -> None:
        self.parser.feed_data(data)

    def on_body(self, body: bytes) -> None:
        self.sha256.update(body)

    def on_message_complete(self) -> None:
        self.sha256.digest()
        self.transport.write(self.response)
        self.transport.close()


async def serve() -> None:
    server = await asyncio.get_running_loop().create_server(Floor, "127.0.0.1", 0)
    print(server.sockets[0].getsockname()[1], flush=True)
    await server.serve_forever()


if __name__ == "__main__":
    Floor.response = sys.stdin.buffer.read()
    uvloop.run(serve())
