"""A reverse proxy that serves a gateway below a path prefix, as JupyterHub, code-server and an ingress do."""

import asyncio
import contextlib
import threading
from collections.abc import Iterator
from contextlib import contextmanager


class _PrefixProxy:
    """Forwards one request per connection, and whatever follows the upgrade to a WebSocket."""

    def __init__(self, port: int, prefix: str, *, strip: bool) -> None:
        self._port, self._prefix, self._strip = port, prefix.encode(), strip

    async def __call__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError, asyncio.IncompleteReadError), contextlib.closing(writer):
            head = await reader.readuntil(b"\r\n\r\n")
            method, target, rest = head.split(b" ", 2)
            if not target.startswith(self._prefix + b"/"):
                writer.write(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
                await writer.drain()
                return
            if self._strip:
                target = target.removeprefix(self._prefix)
            if b"upgrade: websocket" not in rest.lower():
                lines = [line for line in rest.split(b"\r\n") if not line.lower().startswith(b"connection:")]
                rest = b"\r\n".join((lines[0], b"Connection: close", *lines[1:]))
            from_gateway, to_gateway = await asyncio.open_connection("127.0.0.1", self._port)
            with contextlib.closing(to_gateway):
                to_gateway.write(b" ".join((method, target, rest)))
                await asyncio.gather(_copy(reader, to_gateway), _copy(from_gateway, writer))


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(OSError):
        while data := await reader.read(65536):
            writer.write(data)
            await writer.drain()
    writer.close()


@contextmanager
def prefix_proxy(port: int, prefix: str, *, strip: bool) -> Iterator[str]:
    """Yield the URL below which the gateway on ``port`` is served, without a slash at its end.

    Args:
        strip: True: the gateway's requests lack the prefix.
    """
    loop = asyncio.new_event_loop()  # in a thread of its own: Playwright runs one in the test's
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    proxy = _PrefixProxy(port, prefix, strip=strip)
    server = asyncio.run_coroutine_threadsafe(asyncio.start_server(proxy, "127.0.0.1", 0), loop).result()
    try:
        yield f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}{prefix}"
    finally:
        asyncio.run_coroutine_threadsafe(_close(server), loop).result()
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


async def _close(server: asyncio.Server) -> None:
    server.close()
    tasks = asyncio.all_tasks() - {asyncio.current_task()}
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
