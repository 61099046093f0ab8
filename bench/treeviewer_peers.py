"""The jobs of ``bench.treeviewer`` done by other viewers, each by its own interface.

    python -m bench.treeviewer_peers SECONDS    (by an interpreter that has them)
    python -m bench.treeviewer_peers ask VIEWER (does the jobs that it reads, one a line; prints their milliseconds)

* meshcat (Python): its server in a process of its own; every call waits for the server.
* viser: in process; a call returns when the message is queued for browsers, of which there are none.
* meldis (pydrake): in process over LCM's memq; from publishing to the end of its handlers.

None of them draws or sends to a browser here, so their figures are the least that a user of them sees. Prints one JSON
object a viewer: name, and milliseconds for each job.
"""

import contextlib
import json
import math
import os
import random
import signal
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

BOXES = 1000
SIDE = 316
COUNTS = (1, 100, 1000)
MILLION = 1_000_000
Jobs = dict[str, Callable[[], object]]


def mesh_arrays() -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) float32 and (M, 3) uint32 of the same surface that ours gets."""
    y, x = np.mgrid[0:SIDE, 0:SIDE] / SIDE
    vertices = np.stack((x, y, 0.1 * np.sin(9.1 * x)), axis=-1).reshape(-1, 3).astype(np.float32)
    a = (np.arange(SIDE - 1)[:, None] * SIDE + np.arange(SIDE - 1)).ravel()
    faces = np.concatenate((np.stack((a, a + 1, a + SIDE), 1), np.stack((a + 1, a + SIDE + 1, a + SIDE), 1)))
    return vertices, faces.astype(np.uint32)


def cloud_arrays(count: int = 100_000) -> tuple[np.ndarray, np.ndarray]:
    """Points and colours, (N, 3) float32."""
    chance = np.random.default_rng(1)
    return chance.random((count, 3), np.float32), chance.random((count, 3), np.float32)


@contextlib.contextmanager
def meshcat_jobs() -> Iterator[Jobs]:
    import meshcat
    import meshcat.geometry as g

    viewer = meshcat.Visualizer()
    box = g.Box([0.1, 0.1, 0.1])
    vertices, faces = mesh_arrays()
    points, rgb = cloud_arrays()
    many, colors = cloud_arrays(MILLION)

    def create() -> None:
        for i in range(BOXES):
            viewer["swarm"][f"obj{i}"].set_object(box, g.MeshLambertMaterial(color=0xE0B0D0))

    def move(count: int) -> None:
        pose = np.eye(4)
        for i in range(count):
            pose[0, 3] = random.random()
            viewer["swarm"][f"obj{i}"].set_transform(pose)

    try:
        yield {
            "create 1000 boxes": create,
            **moves(move),
            "mesh 100k": lambda: viewer["mesh"].set_object(g.TriangularMeshGeometry(vertices, faces)),
            "cloud 100k": lambda: viewer["cloud"].set_object(g.PointCloud(points.T, rgb.T)),
            "cloud 1M": lambda: viewer["cloud"].set_object(g.PointCloud(many.T, colors.T)),
        }
    finally:
        # meshcat itself ends its server only when the interpreter exits, which os._exit skips.
        viewer.window.server_proc.kill()
        viewer.window.server_proc.wait()


@contextlib.contextmanager
def viser_jobs() -> Iterator[Jobs]:
    import viser

    server = viser.ViserServer(host="127.0.0.1", port=8999, verbose=False)
    vertices, faces = mesh_arrays()
    points, rgb = cloud_arrays()
    handles: list[Any] = []

    def create() -> None:
        handles[:] = [server.scene.add_box(f"/swarm/obj{i}", dimensions=(0.1, 0.1, 0.1)) for i in range(BOXES)]

    def move(count: int) -> None:
        for handle in handles[:count]:
            handle.position = (random.random(), 0.0, 0.0)
            handle.wxyz = (1.0, 0.0, 0.0, 0.0)

    yield {
        "create 1000 boxes": create,
        **moves(move),
        "mesh 100k": lambda: server.scene.add_mesh_simple("/mesh", vertices, faces),
        "cloud 100k": lambda: server.scene.add_point_cloud("/cloud", points, rgb),
    }
    server.stop()


@contextlib.contextmanager
def meldis_jobs() -> Iterator[Jobs]:
    os.environ["LCM_DEFAULT_URL"] = "memq://"
    from drake import lcmt_viewer_draw, lcmt_viewer_geometry_data, lcmt_viewer_link_data, lcmt_viewer_load_robot
    from pydrake.visualization._meldis import Meldis

    viewer = Meldis()
    lcm = viewer._lcm  # noqa: SLF001 - Meldis has no public way to step it

    def tell(channel: str, message: Any) -> None:
        lcm.Publish(channel, message.encode())
        while lcm.HandleSubscriptions(0):
            pass
        viewer._invoke_subscriptions()  # noqa: SLF001 - Meldis has no public way

    def create() -> None:
        message = lcmt_viewer_load_robot()
        message.num_links = BOXES
        for i in range(BOXES):
            box = lcmt_viewer_geometry_data()
            box.type, box.position, box.quaternion = box.BOX, [0.0] * 3, [1.0, 0.0, 0.0, 0.0]
            box.color, box.num_float_data, box.float_data = [1.0] * 4, 3, [0.1, 0.1, 0.1 + 1e-6 * random.random()]
            link = lcmt_viewer_link_data()
            link.name, link.robot_num, link.num_geom, link.geom = f"obj{i}", 0, 1, [box]
            message.link.append(link)
        tell("DRAKE_VIEWER_LOAD_ROBOT", message)

    def move(count: int) -> None:
        message = lcmt_viewer_draw()
        message.num_links = count
        message.link_name = [f"obj{i}" for i in range(count)]
        message.robot_num = [0] * count
        message.position = [[random.random(), 0.0, 0.0] for _ in range(count)]
        message.quaternion = [[1.0, 0.0, 0.0, 0.0]] * count
        tell("DRAKE_VIEWER_DRAW", message)

    yield {"create 1000 boxes": create, **moves(move)}


def moves(move: Callable[[int], None]) -> Jobs:
    def job(count: int) -> Callable[[], None]:
        return lambda: move(count)

    return {f"{count} transform{'s' if count > 1 else ''}": job(count) for count in COUNTS}


def answer(jobs: Jobs) -> None:
    """Does what it is told until there is no more."""
    print("ready", flush=True)
    for line in sys.stdin:
        job = jobs[line.partition(",")[0].strip()]
        begin = time.perf_counter()
        job()
        print(1000.0 * (time.perf_counter() - begin), flush=True)


def measure(jobs: Jobs, seconds: float) -> dict[str, list[float]]:
    result: dict[str, list[float]] = {}
    for name, job in jobs.items():
        try:
            job()
            times: list[float] = []
            end = time.monotonic() + seconds
            while not times or (time.monotonic() < end and len(times) < 5000):
                begin = time.perf_counter()
                job()
                times.append(1000.0 * (time.perf_counter() - begin))
        except Exception as error:  # noqa: BLE001 - one job that a version cannot do does not end the others
            print(f"{name}: {type(error).__name__}: {error}", file=sys.stderr)
            times = []
        result[name] = [round(value, 4) for value in times if math.isfinite(value)]
    return result


def main() -> None:
    # SIGTERM, too, has to end the servers that viewers start.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    viewers = {"meshcat": meshcat_jobs, "viser": viser_jobs, "meldis": meldis_jobs}
    if sys.argv[1] == "ask":
        with viewers[sys.argv[2]]() as made:
            answer(made)
        os._exit(0)
    seconds = float(sys.argv[1])
    for name, jobs in viewers.items():
        try:
            with jobs() as made:
                made.pop("cloud 1M", None)  # of bench.treeviewer_binary
                figures = measure(made, seconds)
        except ImportError as error:
            print(f"{name} is not installed: {error}", file=sys.stderr)
            continue
        print(json.dumps({"name": name, "jobs": figures}), flush=True)
    os._exit(0)  # their servers' threads would keep the process


if __name__ == "__main__":
    main()
