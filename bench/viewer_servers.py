"""One moving scene in one viewer: ``viewer_servers.py ours|viser|meshcat``, a process that ``viewer.py`` starts.

Prints where it listens as a line of JSON, moves 1000 nodes at 60 Hz, and for every line on its input prints how often
it has moved them so far. It ends when its input does, as it does when ``viewer.py`` has ended. Needs nothing of the
repository for the peers, so that it runs in their own environment.
"""

import asyncio
import json
import signal
import sys
import threading
import time
from collections.abc import Callable

import numpy as np

ARMS, LINKS, POINTS, RATE = 10, 100, 100_000, 60.0


def cloud() -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) positions and colours."""
    random = np.random.default_rng(1)
    return random.normal(size=(POINTS, 3)).astype(np.float32), random.random((POINTS, 3)).astype(np.float32)


def poses(tick: int) -> np.ndarray:
    """(1000, 7): x, y, z, qw, qx, qy, qz of every node; all new with every tick."""
    number = np.arange(ARMS * LINKS)
    angle = 0.02 * tick + 0.05 * (number % LINKS)
    half = 0.5 * angle
    columns = (np.cos(angle), np.sin(angle), 0.02 * (number % LINKS), np.cos(half), 0 * half, 0 * half, np.sin(half))
    return np.stack(columns, axis=1)


class Counter:
    """Ticks so far, told to the parent when it asks."""

    def __init__(self) -> None:
        self.ticks = 0
        self.wanted = True
        """Return whether the parent process is alive."""

    def answer(self) -> None:
        """Until the parent closes the pipe."""
        for _ in sys.stdin:
            print(self.ticks, flush=True)
        self.wanted = False


def pace(counter: Counter, move: Callable[[int], None]) -> None:
    """Calls ``move(tick)`` 60 times a second, or as often as it can, while the parent is there."""
    begin = time.perf_counter()
    while counter.wanted:
        move(counter.ticks)
        counter.ticks += 1
        due = begin + counter.ticks / RATE
        left = due - time.perf_counter()
        # Who is late makes no burst to catch up, and lets the library's own thread have its turn.
        begin -= min(left, 0.0)
        time.sleep(max(left, 0.001))


def ours(counter: Counter) -> None:
    """The live tree and the viewer as the gateway runs them, publisher in the same event loop."""
    import uvloop
    from fastapi import FastAPI

    from gateway.adapters.viewer.config import ViewerConfig
    from gateway.adapters.viewer.hub import ViewHub
    from gateway.adapters.viewer.routes import router
    from gateway.runtime.http import http_server
    from gateway.runtime.workers import process_tuning
    from gateway.scene.tree.geometry import Part, PointCloud
    from gateway.scene.tree.live import LiveTree
    from gateway.wiring.telemetry import NO_TELEMETRY
    from renderers.drawlist import Material
    from scenegate.messages.geometry import Box

    tree = LiveTree()
    points, colors = cloud()
    box = Part(Box((0.1, 0.1, 0.1)), Material((0.8, 0.3, 0.1, 1.0)))
    paths = [(f"arm{arm}", link) for arm in range(ARMS) for link in range(LINKS)]
    with tree.edit() as edit:
        edit.set_parts(("cloud",), (Part(PointCloud(points, {"rgb": colors}), Material()),))
        for path in paths:
            edit.set_parts(path, (box,))

    async def publish() -> None:
        loop = asyncio.get_running_loop()
        begin = loop.time()
        while counter.wanted:
            with tree.edit() as edit:
                for path, pose in zip(paths, poses(counter.ticks).tolist(), strict=True):
                    edit.set_pose(path, tuple(pose))
            counter.ticks += 1
            await asyncio.sleep(max(0.0, begin + counter.ticks / RATE - loop.time()))

    async def serve() -> None:
        process_tuning.tune()
        hub = ViewHub(ViewerConfig(max_browsers=1000), tree)
        app = FastAPI(telemetry=NO_TELEMETRY)
        app.include_router(router(hub))
        listener = process_tuning.listen("127.0.0.1", 0)
        print(json.dumps({"url": f"ws://127.0.0.1:{listener.getsockname()[1]}/view/ws"}), flush=True)
        server = http_server.MainServer(http_server.server_config(app, 1.0, lifespan=False))
        tasks = [asyncio.create_task(work) for work in (hub.run(), publish())]
        tasks[1].add_done_callback(lambda _: setattr(server, "should_exit", True))
        await server.serve(sockets=[listener])
        for task in tasks:
            task.cancel()

    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        runner.run(serve())


def viser(counter: Counter) -> None:
    """One node a box, as its users write it: position and wxyz of each handle, all in one atomic block."""
    import viser as library

    server = library.ViserServer(host="127.0.0.1", port=0, verbose=False)
    points, colors = cloud()
    server.scene.add_point_cloud("/cloud", points, colors)
    boxes = [
        server.scene.add_box(f"/arm{arm}/link{link}", color=(200, 80, 30), dimensions=(0.1, 0.1, 0.1))
        for arm in range(ARMS)
        for link in range(LINKS)
    ]
    subprotocol = f"viser-v{library.__version__}"
    print(json.dumps({"url": f"ws://127.0.0.1:{server.get_port()}", "subprotocol": subprotocol}), flush=True)

    def move(tick: int) -> None:
        values = poses(tick)
        with server.atomic():
            for handle, row in zip(boxes, values, strict=True):
                handle.position = row[:3]
                handle.wxyz = row[3:]

    pace(counter, move)
    server.stop()


def meshcat(counter: Counter) -> None:
    """One node a box, one ``set_transform`` each; the server is a process of its own."""
    import meshcat as library
    import meshcat.geometry as shapes

    viewer = library.Visualizer()
    points, colors = cloud()
    viewer["cloud"].set_object(shapes.PointCloud(points.T, colors.T))
    nodes = [viewer[f"arm{arm}"][f"link{link}"] for arm in range(ARMS) for link in range(LINKS)]
    for node in nodes:
        node.set_object(shapes.Box([0.1, 0.1, 0.1]))
    url = viewer.url().replace("http://", "ws://").replace("/static/", "")
    print(json.dumps({"url": url}), flush=True)

    def move(tick: int) -> None:
        for node, (x, y, z, w, i, j, k) in zip(nodes, poses(tick), strict=True):
            matrix = np.eye(4)
            matrix[:3, :3] = (
                (1 - 2 * (j * j + k * k), 2 * (i * j - k * w), 2 * (i * k + j * w)),
                (2 * (i * j + k * w), 1 - 2 * (i * i + k * k), 2 * (j * k - i * w)),
                (2 * (i * k - j * w), 2 * (j * k + i * w), 1 - 2 * (i * i + j * j)),
            )
            matrix[:3, 3] = x, y, z
            node.set_transform(matrix)

    pace(counter, move)


if __name__ == "__main__":
    # An exit by SIGTERM runs atexit, where meshcat ends its server.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    count = Counter()
    threading.Thread(target=count.answer, daemon=True).start()
    {"ours": ours, "viser": viser, "meshcat": meshcat}[sys.argv[1]](count)
