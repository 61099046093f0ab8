"""Measure how long each kind of work blocks the gateway's event loop, one kind at a time.

The gateway itself measures (tests/soak/server.py): CPU time of the loop's thread between two ticks 1 ms apart, which
other programs on the machine cannot extend.
"""

from __future__ import annotations

import asyncio
import struct
import time
from collections.abc import Callable, Coroutine
from typing import Any

from scenegate.lcm.tcpq import CLIENT_HELLO, HUB_HELLO, FrameType, subscription_frame
from tests.soak.clients import BOUNDARY, Ports, http_request, pose, render_body, tree_request

SECONDS = 6.0
NODES = 50_000
"""Number of nodes of the big scene."""
BODY_BYTES = 25_000_000
"""Body size of a big render request, as Drake's users send them."""

Work = Callable[[Ports], Coroutine[Any, Any, None]]


async def exchange(port: int, request: bytes) -> bytes:
    """One request on a connection of its own; the whole answer."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1 << 20)
    try:
        writer.write(request)
        size = 0
        first = b""
        while data := await reader.read(1 << 20):
            first = first or data
            size += len(data)
        return first
    except ConnectionError:
        return b""
    finally:
        writer.close()


def get(path: str) -> Work:
    """Asks for a path again and again."""

    async def work(ports: Ports) -> None:
        while True:
            await exchange(ports.http, http_request("GET", path))

    return work


def post(body: bytes) -> Work:
    """Sends a render request again and again."""
    request = http_request("POST", "/render", body)

    async def work(ports: Ports) -> None:
        while True:
            await exchange(ports.http, request)

    return work


def big_body() -> bytes:
    """A render request of 25 MB: a small scene, and a buffer that nothing uses."""
    filler = "A" * (BODY_BYTES // 4 * 4)
    body = render_body(320)
    buffer = (
        f'"buffers": [{{"byteLength": {BODY_BYTES // 4 * 3}, "uri": "data:application/octet-stream;base64,{filler}"}}, '
    )
    return body.replace(b'"buffers": [', buffer.encode()).replace(b'"buffer": 0', b'"buffer": 1')


def refused_body() -> bytes:
    """A body of 25 MB that is no form at all."""
    head = f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="nonsense"\r\n\r\n'
    return head.encode() + b"\r\n--soa" * (BODY_BYTES // 7)


async def told(ports: Ports, *requests: bytes) -> None:
    """Sends requests of the tree viewer, and takes their answers in."""
    reader, writer = await asyncio.open_connection("127.0.0.1", ports.tcpq)
    writer.write(CLIENT_HELLO + subscription_frame(FrameType.SUBSCRIBE, "DIRECTOR_TREE_VIEWER_RESPONSE_<turns>"))
    await reader.readexactly(len(HUB_HELLO))
    for request in requests:
        writer.write(request)
        _, length = struct.unpack(">II", await reader.readexactly(8))
        await reader.readexactly(length)
        (size,) = struct.unpack(">I", await reader.readexactly(4))
        await reader.readexactly(size)
    writer.close()


def scene(count: int) -> list[bytes]:
    """Boxes at so many paths, five thousand a message."""
    box = {"type": "box", "lengths": [0.1, 0.1, 0.1]}
    commands = [{"path": ["big", f"group {i // 500}", f"box {i}"], "geometry": box} for i in range(count)]
    return [tree_request("turns", setgeometry=commands[at : at + 5000]) for at in range(0, count, 5000)]


def moves(count: int) -> Work:
    """Moves so many frames with every message."""

    async def work(ports: Ports) -> None:
        requests = [tree_request("turns", settransform=[pose(["moved", f"{i}"]) for i in range(count)])] * 50
        while True:
            await told(ports, *requests)

    return work


async def hello(ports: Ports) -> None:
    """Pages of the browser view that come, take the whole scene in, and leave."""
    from websockets.asyncio.client import connect

    while True:
        async with connect(f"ws://127.0.0.1:{ports.http}/view/ws", max_size=None) as page:
            await page.recv()
            await page.send("k")


async def turns(running: Any) -> None:
    """Prints a line for each kind of work."""
    works: dict[str, Work] = {
        "nothing": lambda ports: asyncio.sleep(3600),
        "renders of 320x320": post(render_body(320)),
        "renders with bodies of 25 MB": post(big_body()),
        "refused bodies of 25 MB": post(refused_body()),
        "100 moves a message": moves(100),
        "5000 moves a message": moves(5000),
        "GET /metrics": get("/metrics"),
        "GET /view": get("/view"),
        "GET /scene, small": get("/scene"),
        "a big scene is made": lambda ports: told(ports, *scene(NODES)),
        "GET /scene, big": get("/scene"),
        "GET /scene.glb, big": get("/scene.glb"),
        "GET /scene/render, big": get("/scene/render?width=320&height=240&camera=fit"),
        "WebSocket of a big scene": hello,
        "5000 moves a message beside it": moves(5000),
        "GET /openapi.json": get("/openapi.json"),
    }
    print(f"\nturns of the event loop, ms of its CPU time: {SECONDS:g} s of each; the big scene has {NODES} nodes")
    for name, work in works.items():
        await running.next()
        first, begin = len(running.samples), time.monotonic()
        task = asyncio.create_task(work(running.ports))
        await asyncio.wait((task,), timeout=60.0 if "made" in name else SECONDS)
        await running.next()
        task.cancel()
        failed = (await asyncio.gather(task, return_exceptions=True))[0]
        note = f"   ({failed!r})" if isinstance(failed, Exception) else ""
        samples = running.samples[first:]
        longest, p99 = max(s["turn_max_ms"] for s in samples), max(s["turn_p99_ms"] for s in samples)
        print(
            f"  {name:32} longest {longest:7.1f}  p99 of a second {p99:6.1f}  ({time.monotonic() - begin:.0f} s){note}",
            flush=True,
        )
