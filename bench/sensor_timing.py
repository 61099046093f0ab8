"""Timestamps and period of the stereo camera beside batch renders: ``python -m bench.sensor_timing``.

A body moves along a known path, published 200 times a second. Each left image of a stream at quality Low is compared
with its timestamp: the position of the body in it says at what time the image's content was true. Meanwhile clients of
``GET /scene/render`` (1280x960) request one image after the other.
"""

from __future__ import annotations

import argparse
import http.client
import json
import multiprocessing
import socket
import struct
import threading
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import grpc
import numpy as np

from bench.gateways import gateway
from bench.table import heading
from scenegate.camera import image_interface_pb2 as pb
from scenegate.messages import wire

CAMERA_RATE: Final = 25.0
"""Sets per second at quality Low."""
DISTANCE: Final = 1.5
"""Distance of the body from the camera, metres."""
AMPLITUDE: Final = 0.3
"""Half the length of the path, metres."""
ANGULAR_FREQUENCY: Final = 3.0
"""Angular frequency of the motion along the path, rad/s: up to 0.9 m/s, or 650 pixels/s."""
PUBLISH_SECONDS: Final = 0.005
SPHERES: Final = 60
"""Number of dark spheres behind the body: a scene of medium size for the batch renders."""
SETTLING_SECONDS: Final = 3.0
_SPAWN: Final = multiprocessing.get_context("spawn")
_GREETING: Final = struct.pack(">II", 0x287617FB, 0x0100)
_CHANNEL: Final = b"DIRECTOR_TREE_VIEWER_REQUEST_<timing>"


@dataclass(frozen=True, slots=True)
class Timing:
    """Result of one load."""

    clients: int
    """Number of clients of ``GET /scene/render``."""
    lateness: tuple[float, float, float]
    """Age of the content at the timestamp: median, 95 % and maximum of its absolute value, ms."""
    period: tuple[float, float, float]
    """Time between timestamps: median, 95 % and maximum, ms."""
    share: float
    """Number of sets as a share of those due."""
    skipped: int
    """Number of frames or sets that the server counted as skipped."""
    missing: int
    """Number of frames that were neither received nor counted."""
    age: float
    """Time from timestamp to client, median, ms."""
    renders: float
    """Batch renders per second."""
    renders_alone: float
    """Batch renders per second before the camera streamed."""

    def row(self) -> str:
        late, period = ("/".join(f"{value:.0f}" for value in three) for three in (self.lateness, self.period))
        return (
            f"| {self.clients} | {late} | {period} | {100 * self.share:.0f} % | {self.skipped} | {self.missing} | "
            f"{self.age:.0f} | {self.renders:.1f} | {self.renders_alone:.1f} |"
        )


HEAD: Final = heading(
    "clients",
    "content late ms p50/p95/max",
    "period ms p50/p95/max",
    "frames",
    "skipped",
    "uncounted",
    "age ms",
    "renders/s",
    "renders/s without camera",
)


def position(seconds: float | np.ndarray[Any, Any]) -> Any:
    """Return the body's x at a time, seconds since the epoch, metres."""
    return AMPLITUDE * np.sin(ANGULAR_FREQUENCY * seconds)


def _frame(request: dict[str, Any]) -> bytes:
    message = wire.encode(json.dumps({"utime": 0, **request}).encode())
    head = struct.pack(">II", 1, len(_CHANNEL)) + _CHANNEL
    return head + struct.pack(">I", len(message)) + message


def _pose(x: float, y: float, z: float) -> dict[str, list[float]]:
    return {"translation": [x, y, z], "quaternion": [1.0, 0.0, 0.0, 0.0]}


def _scene() -> dict[str, Any]:
    """Return the request that adds the body and the spheres. The camera is at the origin and looks along +Z."""
    body = {"type": "box", "lengths": [0.1, 0.4, 0.001], "color": [1.0, 1.0, 1.0, 1.0]}
    sphere = {"type": "sphere", "radius": 0.1, "color": [0.02, 0.02, 0.02, 1.0]}
    paths = [["spheres", number] for number in range(SPHERES)]
    return {
        "setgeometry": [
            {"path": ["body"], "geometry": body},
            *({"path": path, "geometry": sphere} for path in paths),
        ],
        "settransform": [
            {"path": path, "transform": _pose(0.4 * (i % 10 - 4.5), 0.4 * (i // 10 - 2.5), 3.0)}
            for i, path in enumerate(paths)
        ],
    }


def _publish(port: int, stop: Any) -> None:
    """Publish the body's poses until ``stop`` is set, without waiting for responses."""
    with socket.create_connection(("127.0.0.1", port)) as hub:
        hub.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        hub.sendall(_GREETING + _frame(_scene()))
        threading.Thread(target=_discard, args=(hub,), daemon=True).start()
        due = time.time()
        while not stop.is_set():
            x = float(position(time.time()))
            hub.sendall(_frame({"settransform": [{"path": ["body"], "transform": _pose(x, 0.0, DISTANCE)}]}))
            due += PUBLISH_SECONDS
            time.sleep(max(0.0, due - time.time()))


def _discard(hub: socket.socket) -> None:
    try:
        while hub.recv(1 << 16):
            pass
    except OSError:
        pass


def _render(port: int, number: int, stop: Any, count: Any) -> None:
    """Request images one after the other until ``stop`` is set."""
    path = f"/scene/render?width=1280&height=960&camera=eye=0,{0.1 * number},-1;target=0,0,3;up=0,-1,0"
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
    while not stop.is_set():
        connection.request("GET", path)
        response = connection.getresponse()
        response.read()
        if response.status != 200:
            raise SystemExit(f"GET /scene/render: {response.status}")
        with count.get_lock():
            count.value += 1


def _sets(port: int) -> Iterator[tuple[float, pb.ImageSet]]:
    """Yield the times of arrival and the sets of a stream."""
    channel = grpc.insecure_channel(f"127.0.0.1:{port}", [("grpc.max_receive_message_length", -1)])
    method = channel.unary_stream(
        "/ImageInterface/StreamImageSets", pb.ImageSetRequest.SerializeToString, pb.ImageSet.FromString
    )
    for image_set in method(pb.ImageSetRequest(left_enabled=True, disparity_enabled=True)):
        yield time.time(), image_set


def _content_age(image: pb.Image, timestamp: float) -> float:
    """Return how old the content of an image is at its timestamp, seconds; NaN near the ends of the path."""
    pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width)
    columns = np.clip(pixels.astype(np.float64) - 110.0, 0.0, None).sum(axis=0)
    center = (columns * (np.arange(image.width) + 0.5)).sum() / max(columns.sum(), 1.0)
    measured = (center - image.principal_point_u) * DISTANCE / image.focal_length
    velocity = AMPLITUDE * ANGULAR_FREQUENCY * np.cos(ANGULAR_FREQUENCY * timestamp)
    if columns.sum() < 1000.0 or abs(velocity) < 0.5 * AMPLITUDE * ANGULAR_FREQUENCY:
        return float("nan")
    return float((position(timestamp) - measured) / velocity)


def _stereo_status(port: int) -> dict[str, Any]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    connection.request("GET", "/healthz")
    status: dict[str, Any] = json.loads(connection.getresponse().read())
    return next(value for value in _walk(status) if "depth_frames" in value)


def _walk(value: Any) -> Iterator[dict[str, Any]]:
    if isinstance(value, dict):
        yield value
        for child in value.values():
            yield from _walk(child)


def measure(clients: int, seconds: float, *flags: str) -> Timing:
    """Stream for some seconds beside ``clients`` clients of ``GET /scene/render``."""
    ports = [_free_port(), _free_port()]
    with gateway(
        "--lcm-url", "off", "--tcpq-port", str(ports[0]), "--grpc-port", str(ports[1]),
        "--stereo-pose", "0,0,0,1,0,0,0", "--background", "0,0,0", *flags,
    ) as running:  # fmt: skip
        stop, count = _SPAWN.Event(), _SPAWN.Value("q", 0)
        publisher = _SPAWN.Process(target=_publish, args=(ports[0], stop), daemon=True)
        loads = [
            _SPAWN.Process(target=_render, args=(running.port, number, stop, count), daemon=True)
            for number in range(clients)
        ]
        _set_quality(running.port, "Low")
        publisher.start()
        for process in loads:
            process.start()
        time.sleep(SETTLING_SECONDS)
        renders_before, begin = count.value, time.time()
        time.sleep(0.5 * seconds)
        renders_alone = (count.value - renders_before) / (time.time() - begin)
        sets = _sets(ports[1])
        until = time.monotonic() + SETTLING_SECONDS
        while time.monotonic() < until:  # exposure, first frames
            next(sets)
        before, renders_before, begin = _stereo_status(running.port), count.value, time.time()
        samples = []
        for arrival, image_set in sets:
            timestamp = image_set.timestamp.sec + image_set.timestamp.nsec * 1e-9
            samples.append((timestamp, arrival, image_set.left))
            if arrival - begin > seconds:
                break
        elapsed, after, renders = time.time() - begin, _stereo_status(running.port), count.value - renders_before
        stop.set()
        for process in (publisher, *loads):
            process.join(60)
    return _timing(clients, samples, before, after, (renders / elapsed, renders_alone))


def _timing(
    clients: int,
    samples: list[tuple[float, float, pb.Image]],
    before: dict[str, Any],
    after: dict[str, Any],
    renders: tuple[float, float],
) -> Timing:
    stamps = np.array([timestamp for timestamp, _, _ in samples])
    ages = np.array([_content_age(image, timestamp) for timestamp, _, image in samples]) * 1e3
    ages = ages[np.isfinite(ages)] if np.isfinite(ages).any() else np.array([np.nan])
    period = np.diff(stamps) * 1e3
    due = (stamps[-1] - stamps[0]) * CAMERA_RATE
    skipped = sum(after[key] - before[key] for key in ("skipped", "busy", "sets_skipped"))
    return Timing(
        clients,
        (float(np.median(ages)), float(np.percentile(ages, 95)), float(np.abs(ages).max())),
        (float(np.median(period)), float(np.percentile(period, 95)), float(period.max())),
        len(period) / due,
        skipped,
        round(due) - len(period) - skipped,
        float(np.median([1e3 * (arrival - timestamp) for timestamp, arrival, _ in samples])),
        *renders,
    )


def _set_quality(port: int, quality: str) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    body = json.dumps({"value": quality})
    path = "/api/v2/pipelines/0/nodes/rc_stereomatching/parameters/quality"
    connection.request("PUT", path, body, {"Content-Type": "application/json"})
    if (status := connection.getresponse().status) != 200:
        raise SystemExit(f"PUT {path}: {status}")


def _free_port() -> int:
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


def report(clients: Iterable[int] = (0, 2, 4, 12), seconds: float = 12.0, *flags: str) -> None:
    """Print the table."""
    print(f"\ntimestamp and period under load\n\n{HEAD}")
    for number in clients:
        print(measure(number, seconds, *flags).row(), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=12.0, help="length of each measurement")
    parser.add_argument("--clients", type=int, nargs="+", default=[0, 2, 4, 12], help="numbers of batch clients")
    parser.add_argument("--flags", default="", help="more flags of the gateway, in one text")
    options = parser.parse_args()
    report(options.clients, options.seconds, *options.flags.split())


if __name__ == "__main__":
    main()
