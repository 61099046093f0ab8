"""Clients of the soak, by bytes where they misbehave: well-behaved, slow, half-open, vanishing."""

import asyncio
import contextlib
import json
import random
import socket
import struct
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Final

import grpc

from scenegate.camera import image_interface_pb2 as pb
from scenegate.lcm.tcpq import CLIENT_HELLO, HUB_HELLO, FrameType, publish_header, subscription_frame
from scenegate.messages import wire

HELD_SECONDS: Final = 2.0
"""Seconds that an idle client stays connected."""
BOUNDARY: Final = "soak"
TRIANGLE: Final = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"
GLTF: Final = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0, 1]}],
    "nodes": [{"mesh": 0}, {"camera": 0, "translation": [0.3, 0.3, 3]}],
    "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.01}}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
    "bufferViews": [{"buffer": 0, "byteLength": 36}],
    "buffers": [{"byteLength": 36, "uri": f"data:application/octet-stream;base64,{TRIANGLE}"}],
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Ports:
    """The gateway's ports on 127.0.0.1."""

    http: int
    grpc: int
    tcpq: int


def render_body(size: int = 160) -> bytes:
    """A form of the render endpoint."""
    values = {"image_type": "color", "width": size, "height": size, "near": 0.01, "far": 10}
    values |= {"focal_x": size, "focal_y": size, "center_x": size / 2, "center_y": size / 2}
    parts = [f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="{n}"\r\n\r\n{v}\r\n' for n, v in values.items()]
    scene = (
        f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="scene"; filename="s.gltf"\r\n\r\n{json.dumps(GLTF)}\r\n'
    )
    return ("".join(parts) + scene + f"--{BOUNDARY}--\r\n").encode()


def http_request(method: str, path: str, body: bytes = b"", *, close: bool = True) -> bytes:
    """The bytes of a request."""
    head = f"{method} {path} HTTP/1.1\r\nHost: localhost\r\nContent-Length: {len(body)}\r\n"
    head += f"Content-Type: multipart/form-data; boundary={BOUNDARY}\r\n" if body else ""
    return (head + ("Connection: close\r\n" if close else "") + "\r\n").encode() + body


UPGRADE: Final = (
    b"GET /view/ws HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
)
HTTP2: Final = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + b"\0\0\0\4\0\0\0\0\0"
"""Preface and empty settings."""


def tree_request(client: str, **lists: Any) -> bytes:
    """A request of the tree viewer as a TCPQ frame."""
    message = wire.encode(json.dumps({"utime": 1, **lists}).encode(), 1)
    return publish_header(f"DIRECTOR_TREE_VIEWER_REQUEST_<{client}>", len(message)) + message


def pose(path: list[str]) -> dict[str, Any]:
    """A settransform command."""
    values = [random.random() for _ in range(7)]
    return {"path": path, "transform": {"translation": values[:3], "quaternion": values[3:]}}


def opening(kind: str) -> bytes:
    """Return the first request of a client of this kind."""
    name = f"churn{random.randrange(50)}"
    return {
        "http": http_request("GET", "/scene", close=False),
        "render": http_request("POST", "/render", render_body(), close=False),
        "websocket": UPGRADE,
        "grpc": HTTP2,
        "tcpq": CLIENT_HELLO
        + subscription_frame(FrameType.SUBSCRIBE, f"DIRECTOR_TREE_VIEWER_RESPONSE_<{name}>")
        + tree_request(name, settransform=[pose(["churn", name])]),
    }[kind]


def port_of(kind: str, ports: Ports) -> int:
    """Return the port of the interface that this kind of client uses."""
    return {"grpc": ports.grpc, "tcpq": ports.tcpq}.get(kind, ports.http)


async def _open(kind: str, ports: Ports) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    return await asyncio.open_connection("127.0.0.1", port_of(kind, ports))


async def _one_set(ports: Ports) -> None:
    """A stream that ends with its first image set, and the connection with it."""
    async with grpc.aio.insecure_channel(f"127.0.0.1:{ports.grpc}", options=_OPTIONS) as channel:
        call = _stream(channel, 30.0)
        await call.read()
        call.cancel()


async def well_behaved(kind: str, ports: Ports) -> None:
    """Asks, reads an answer, leaves."""
    if kind == "grpc":
        await _one_set(ports)
        return
    reader, writer = await _open(kind, ports)
    writer.write(opening(kind))
    if kind == "tcpq":
        await reader.readexactly(len(HUB_HELLO))
    await reader.read(1 << 16)
    writer.close()


async def slow(kind: str, ports: Ports) -> None:
    """Says it a few bytes at a time, and reads as slowly."""
    reader, writer = await _open(kind, ports)
    data = opening(kind)
    for at in range(0, min(len(data), 200), 20):
        writer.write(data[at : at + 20])
        await asyncio.sleep(HELD_SECONDS / 20)
    writer.write(data[200:])
    for _ in range(10):
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(HELD_SECONDS / 20):
                await reader.read(10)
    writer.close()


async def half_open(kind: str, ports: Ports) -> None:
    """Stops in the middle, and closes its own side only."""
    reader, writer = await _open(kind, ports)
    data = opening(kind)
    writer.write(data[: len(data) // 2])
    if writer.can_write_eof():
        writer.write_eof()
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(HELD_SECONDS):
            await reader.read()
    writer.close()


async def vanishing(kind: str, ports: Ports) -> None:
    """Is gone without a word (RST) as soon as it has asked."""
    if kind == "grpc" and random.random() < 0.5:
        await _one_set(ports)
        return
    _, writer = await _open(kind, ports)
    writer.write(opening(kind))
    await asyncio.sleep(0.05 * random.random())
    sock = writer.get_extra_info("socket")
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    writer.transport.abort()


_OPTIONS: Final = [("grpc.max_receive_message_length", -1), ("grpc.use_local_subchannel_pool", 1)]


def _stream(channel: grpc.aio.Channel, seconds: float | None, **wanted: Any) -> Any:
    call = channel.unary_stream(
        "/ImageInterface/StreamImageSets",
        request_serializer=pb.ImageSetRequest.SerializeToString,
        response_deserializer=lambda data: len(data),
    )
    return call(pb.ImageSetRequest(**(wanted or {"left_enabled": True})), timeout=seconds)


BEHAVIOURS: Final[dict[str, Callable[[str, Ports], Awaitable[None]]]] = {
    "well-behaved": well_behaved,
    "slow": slow,
    "half-open": half_open,
    "vanishing": vanishing,
}
KINDS: Final = ("http", "render", "websocket", "grpc", "tcpq")


# --- mixed load: each until cancelled; ``count`` is told about every answer


async def publisher(ports: Ports, count: Callable[[str], None], name: str) -> None:
    """Moves a hundred frames fifty times a second; makes and deletes boxes and clouds."""
    reader, writer = await _open("tcpq", ports)
    writer.write(CLIENT_HELLO + subscription_frame(FrameType.SUBSCRIBE, f"DIRECTOR_TREE_VIEWER_RESPONSE_<{name}>"))
    await reader.readexactly(len(HUB_HELLO))
    asked = 0
    while True:
        lists: dict[str, Any] = {"settransform": [pose([name, f"frame {i}"]) for i in range(100)]}
        if asked % 50 == 0:
            points = [[random.random() for _ in range(3)] for _ in range(2000)]
            cloud = {"type": "pointcloud", "points": points, "channels": {"rgb": points}}
            box = {"type": "box", "lengths": [0.1, 0.1, 0.1 + random.random()]}
            lists["delete"] = [{"path": [name, f"box {asked // 50 % 20}"]}]
            lists["setgeometry"] = [
                {"path": [name, "cloud"], "geometry": cloud},
                {"path": [name, f"box {(asked // 50 + 1) % 20}"], "geometry": box},
            ]
        writer.write(tree_request(name, **lists))
        _, length = struct.unpack(">II", await reader.readexactly(8))
        await reader.readexactly(length)
        (size,) = struct.unpack(">I", await reader.readexactly(4))
        await reader.readexactly(size)
        count("tree requests")
        asked += 1
        await asyncio.sleep(0.02)


async def browser(ports: Ports, count: Callable[[str], None]) -> None:
    """Takes updates in as the page does."""
    from websockets.asyncio.client import connect

    async with connect(f"ws://127.0.0.1:{ports.http}/view/ws", max_size=None) as page:
        async for _ in page:
            count("view updates")
            await page.send("k")


async def camera(ports: Ports, count: Callable[[str], None]) -> None:
    """Streams images and disparity."""
    async with grpc.aio.insecure_channel(f"127.0.0.1:{ports.grpc}", options=_OPTIONS) as channel:
        async for _ in _stream(channel, None, left_enabled=True, right_enabled=True, disparity_enabled=True):
            count("image sets")


async def asker(ports: Ports, count: Callable[[str], None], pause: float) -> None:
    """Renders, lists, sets parameters; a new connection every time."""
    value = 0
    while True:
        value += 1
        parameter = "/api/v2/pipelines/0/nodes/rc_camera/parameters/exp_max?value=0.01" + str(value % 8)
        for method, path, body in (
            ("POST", "/render", render_body(320)),
            ("GET", "/scene", b""),
            ("PUT", parameter, b""),
            ("GET", "/scene/render?width=320&height=240&camera=fit", b""),
        ):
            reader, writer = await _open("http", ports)
            writer.write(http_request(method, path, body))
            answer = await reader.read()
            writer.close()
            count("HTTP answers" if b" 200 " in answer[:20] else "HTTP refusals")
            await asyncio.sleep(pause)
