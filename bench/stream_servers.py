"""The servers that ``bench.stream`` compares, each in a process of its own: ``python -m bench.stream_servers KIND …``.

Prints its port, serves until its standard input is closed, then prints its figures as JSON.
"""

from __future__ import annotations

import asyncio
import json
import os
import resource
import sys
import time
from contextlib import AsyncExitStack
from functools import partial
from pathlib import Path
from typing import Any

import grpc
import numpy as np
import uvloop

from gateway.adapters.stereo.device.camera_config import Rate, StereoConfig
from gateway.adapters.stereo.device.profile import read_profile
from gateway.adapters.stereo.imaging.scene_view import SceneSource, SceneState
from gateway.adapters.stereo.service import StereoService
from gateway.adapters.stereo.stream import image_messages as messages
from gateway.adapters.stereo.stream.client_queues import MessageHub
from gateway.adapters.stereo.stream.grpc_server import serving
from gateway.adapters.stereo.stream.image_messages import ImageMetadata
from gateway.adapters.stereo.stream.subscriptions import ImageSetHub, MailboxState
from gateway.runtime.workers.process_tuning import tune
from gateway.runtime.workers.worker_pool import WorkerPool
from renderers.interface import LookName
from renderers.stereo.realism import parse_realism
from renderers.stereo.sensor.exposure import Exposure
from scenegate.camera import image_interface_pb2 as pb

PAYLOADS = {
    "A": "left mono",
    "B": "left+right mono, disparity High",
    "C": "rgb8, all High",
    "D": "rgb8, all Full, mesh",
}


def payload(name: str) -> list[messages.Chunk]:
    """Return the chunks of a set of 1.2, 3.1, 8.6 or 15 MB; its images are noise."""
    random = np.random.default_rng(0)
    model = read_profile("rc_visard_160c").model
    full, k = model.intrinsics(), model.intrinsics(1 if name == "D" else 2)
    metadata = ImageMetadata(time.time_ns(), Exposure(), noise=0.3, brightness=0.5, gpio=0)
    size = (full.height, full.width, 3) if name in "CD" else (full.height, full.width)

    def noise(shape: tuple[int, ...], dtype: type) -> Any:
        return random.integers(0, 255, shape, dtype)

    chunks: list[messages.Chunk] = [messages.timestamp_field(metadata.timestamp)]
    for number in (2,) if name == "A" else (2, 3):
        chunks += messages.field(number, messages.image(noise(size, np.uint8), full, metadata))
    if name != "A":
        d = messages.image(noise((k.height, k.width), np.uint16), k, metadata)
        chunks += messages.field(4, messages.disparity(d, metadata.timestamp, model.baseline))
    if name in "CD":
        for number in (5, 6):
            chunks += messages.field(number, messages.image(noise((k.height, k.width), np.uint8), k, metadata))
    if name == "D":
        chunks += messages.field(7, messages.mesh((bytes(2_800_000),), metadata.timestamp))
    return chunks


async def shared(name: str, *, again: bool = False) -> tuple[int, Any]:
    """Our way: joined once per set, the same bytes to every client, newest set only.

    Args:
        again: the set is joined once for all: what is left is sending, which is all that the raw TCP server does.
    """
    hub = ImageSetHub(64, 16)
    stack = AsyncExitStack()
    port = await stack.enter_async_context(serving(hub, MessageHub("event", 64, 64), None, StereoConfig(port=0)))
    chunks = payload(name)
    ready = messages.join(chunks)

    async def produce() -> None:
        number = 0
        while True:
            hub.scheduler_wakeup.clear()
            # As a camera does, not faster than its clients take: a new set when all have the last.
            if len(hub) and not hub.kinds_with_mailbox(MailboxState.FULL):
                kinds = hub.kinds
                number += 1
                data = ready if again else await asyncio.to_thread(messages.join, chunks)
                for kind in kinds:
                    hub.publish(kind, number, data)
            else:
                await hub.scheduler_wakeup.wait()

    return port, (stack, asyncio.create_task(produce()))


async def proto(name: str) -> tuple[int, Any]:
    """Protobuf's way: a message object that gRPC serialises for every client."""
    message = pb.ImageSet.FromString(messages.join(payload(name)))

    async def stream(request: pb.ImageSetRequest, context: Any) -> None:
        while True:
            await context.write(message)

    handler = grpc.unary_stream_rpc_method_handler(stream, pb.ImageSetRequest.FromString, pb.ImageSet.SerializeToString)
    running = grpc.aio.server(options=[("grpc.max_send_message_length", -1)])
    running.add_generic_rpc_handlers(
        (grpc.method_handlers_generic_handler("ImageInterface", {"StreamImageSets": handler}),)
    )
    port = running.add_insecure_port("127.0.0.1:0")
    await running.start()
    return port, running


async def tcp(name: str) -> tuple[int, Any]:
    """The floor: length and bytes over a socket, by threads."""
    import socket
    import threading

    data = messages.join(payload(name))
    framed = len(data).to_bytes(8, "little") + data
    listening = socket.create_server(("127.0.0.1", 0))

    def serve(connection: socket.socket) -> None:
        try:
            while True:
                connection.sendall(framed)
        except OSError:
            connection.close()

    def accept() -> None:
        while True:
            threading.Thread(target=serve, args=(listening.accept()[0],), daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    return listening.getsockname()[1], listening


async def live(rate: Rate, look: LookName, quality: str, scene: str, realism: str) -> tuple[int, Any]:
    """The whole camera: rendered, with noise, at the device's rate or as fast as it goes."""
    from gateway.runtime.kernels.parts import PARTS
    from renderers.raster import CpuRenderer
    from renderers.raster.warmup import warmup

    warmup()
    PARTS["stereo"].compile_or_load()
    config = StereoConfig(port=0, rate=rate, look=look, realism=frozenset(parse_realism(realism)))
    source, mover = {"table": _table, "demo": _demo}[scene]()
    service = StereoService(config, source, CpuRenderer(2), WorkerPool(2))
    service.parameters.set("rc_stereomatching", [("quality", quality)])
    task = asyncio.create_task(service.run())
    while not service.ready:  # noqa: ASYNC110 - nobody tells when
        await asyncio.sleep(0.01)
    return service.port, (task, service, mover)


def _table() -> tuple[SceneSource, None]:
    """Six solids that stand still."""
    from tests.adapters.stereo.scenes import pose, table

    state = SceneState(0, table(), pose(), 1)
    return lambda timestamp: state, None


def _demo() -> tuple[SceneSource, Any]:
    """Return the moving scene of ``serve --demo``, seen by its camera, and the task that moves it."""
    from gateway.adapters.stereo.imaging.scene_view import SceneView
    from gateway.runtime.settings import Settings
    from gateway.scene.draw.flatten import Flattener
    from gateway.scene.draw.mount import Mount, parse_mount_pose
    from gateway.scene.tree.labels import LabelTable
    from gateway.scene.tree.live import LiveTree
    from gateway.wiring.demo import DemoService

    tree = LiveTree()
    mount = Mount(parse_mount_pose(Settings.model_fields["stereo_pose"].default))
    view = SceneView(tree, Flattener(LabelTable()), mount)
    return view.state, asyncio.create_task(DemoService(tree).run())


def watch_steps() -> dict[str, list[float]]:
    """Thread CPU seconds of every callback of the loop, by what ran: ours, or the stream's writer (gRPC's send too)."""
    import asyncio.events as events

    seen: dict[str, list[float]] = {"ours": [], "writer": []}
    handles: Any = events.Handle  # a method of it is another one from here on
    run = handles._run  # noqa: SLF001 - the loop has no hook around callbacks

    def timed(handle: Any) -> None:
        task = getattr(handle._callback, "__self__", None)  # noqa: SLF001
        code = getattr(getattr(task, "get_coro", lambda: None)(), "cr_code", None)
        file = code.co_filename if code is not None else ""
        before = time.thread_time()
        run(handle)
        if "gateway/adapters/stereo" in file:
            seen["ours"].append(time.thread_time() - before)
        elif "grpc" in file:
            seen["writer"].append(time.thread_time() - before)

    handles._run = timed  # noqa: SLF001
    return seen


async def main(kind: str, *arguments: str) -> None:
    tune()
    servers: dict[str, Any] = {
        "shared": shared,
        "again": partial(shared, again=True),
        "proto": proto,
        "tcp": tcp,
        "live": live,
    }
    port, keep = await servers[kind](*arguments)
    print(port, flush=True)
    lateness = [0] * 10_000  # in steps of 0.1 ms: a list of all would grow, which is what is being measured
    # A line says that every client has its first set: what was before does not count.
    await asyncio.to_thread(sys.stdin.readline)
    begin, cpu = time.monotonic(), time.process_time()

    async def tick() -> None:
        while True:
            before = time.monotonic()
            await asyncio.sleep(0.001)
            late = int((time.monotonic() - before - 0.001) * 1e4)  # the loop's clock ticks in whole ms: may be early
            lateness[min(max(late, 0), 9_999)] += 1

    memory: list[float] = []

    async def weigh() -> None:
        while True:
            pages = int(Path("/proc/self/statm").read_text().split()[1])  # noqa: ASYNC240 - no disk behind it
            memory.append(pages * resource.getpagesize() / 1e6)
            await asyncio.sleep(2.0)

    tasks = [asyncio.create_task(tick()), asyncio.create_task(weigh())]
    await asyncio.to_thread(sys.stdin.read)
    for task in tasks:
        task.cancel()
    late = np.cumsum(lateness)
    seconds = time.monotonic() - begin
    figures = {
        "cpu": (time.process_time() - cpu) / seconds,
        "stall_p99": float(np.searchsorted(late, late[-1] * 0.99)) / 10,
        "stall_max": float(np.searchsorted(late, late[-1])) / 10,
        "memory": memory,
        "rss": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    for name, steps in STEPS.items():
        if steps:
            figures[f"{name}_p99"], figures[f"{name}_max"] = np.percentile(steps, (99, 100)).tolist()
    if kind == "live":
        figures["skipped"] = keep[1].counts.skipped
    print(json.dumps(figures), flush=True)
    os._exit(0)  # streams may still be open; the figures are out


STEPS: dict[str, list[float]] = {}

if __name__ == "__main__":
    if sys.argv[1] == "--steps":  # uvloop's callbacks cannot be watched
        STEPS = watch_steps()
        asyncio.run(main(*sys.argv[2:]))
    else:
        uvloop.run(main(*sys.argv[1:]))
