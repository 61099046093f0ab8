"""Binary clouds and meshes: the user's call with numpy arrays until the viewer has them, ours against meshcat.

    python -m bench.treeviewer_binary [--peers PYTHON] [--seconds S]

Ours is ``scenegate.TreeViewer`` over TCPQ and over UDP multicast, to the gateway's service, in a process
of its own; the call ends with the viewer's answer, when the geometry is in the scene. The peer is the fastest of the
others that speaks binary over a socket: meshcat (MessagePack over ZeroMQ to its server's process; viser queues in
process, meldis takes messages in process). PYTHON is an interpreter that has it. All are asked in turn, so that
whatever else the machine does meets all alike; figures are medians (p99 after the slash) in ms, ratios are of medians.
Beside them is the processors' time of client and server for one call (Linux), which says the same on a busy machine.
Meshes with an image, height maps, images and 1000 poses in one message are measured for ours only. A million points
over UDP need a larger receive buffer than most systems allow, and are not measured. S bounds each job.
"""

import argparse
import contextlib
import math
import os
import random
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.running import tree_of
from bench.table import Row, at_least, at_most, show, skipped
from bench.treeviewer_clients import Figures, process, started
from bench.treeviewer_peers import MILLION, cloud_arrays, mesh_arrays
from scenegate import Box, Geometry, Heightmap, ImagePlane, MeshGeometry, PointCloud, TreeViewer

OURS = ("ours, tcpq", "ours, udp")
PEER = "meshcat"
POINTS = {"cloud 100k": 100_000, "cloud 100k, colours of bytes": 100_000, "cloud 1M": MILLION}
OWN_JOBS = ("mesh 100k, image", "heightmap 300 x 300", "image 1 megapixel", "1000 poses")
"""Jobs for which the peer has no single call."""
POSES = 1000
JOBS = ("mesh 100k", *POINTS, *OWN_JOBS)
CPU = "CPU, "
FEW_MS = 10.0
"""Limit in ms for "a few milliseconds"."""

Ask = Callable[[str], float]
"""Performs the named job; returns milliseconds, or infinity if the peer cannot do it."""


@dataclass
class Contestant:
    """Somebody who is asked."""

    ask: Ask
    processes: Callable[[], list[int]]
    """Numbers of all processes that work for it."""


def computed(process_ids: list[int]) -> float:
    """Milliseconds that they had a processor, all threads; NaN where the system does not tell."""
    total = 0
    for number in process_ids:
        for task in Path(f"/proc/{number}/task").glob("*/schedstat"):
            with contextlib.suppress(OSError):  # a thread that has just ended
                total += int(task.read_text().split()[0])
    return 1e-6 * total or math.nan


def asking(url: str) -> Ask:
    """Ours by its own client."""
    viewer = TreeViewer(url, timeout=30.0, binary=True)
    vertices, faces = mesh_arrays()
    pixels = np.random.default_rng(1).integers(0, 256, (1000, 1000, 3), np.uint8)
    geometries: dict[str, Geometry] = {
        "mesh 100k": MeshGeometry(vertices, faces),
        "mesh 100k, image": MeshGeometry(vertices, faces, uv=vertices[:, :2], image=pixels[:256, :256]),
        "heightmap 300 x 300": Heightmap(pixels[:300, :300, 0] / 255.0, (1.0, 1.0)),
        "image 1 megapixel": ImagePlane(pixels, width=1.0),
    }
    for name, count in POINTS.items():
        points, rgb = cloud_arrays(count)
        geometries[name] = PointCloud(points, colors=(255.0 * rgb).astype("u1") if "bytes" in name else rgb)

    paths = [f"swarm/{index}" for index in range(POSES)]
    with viewer.batch() as batch:
        for path in paths:
            batch[path].set(Box((0.1, 0.1, 0.1)))
    poses = np.random.default_rng(2).normal(size=(POSES, 7))

    def ask(job: str) -> float:
        if url.startswith("udpm") and job == "cloud 1M":
            return math.inf
        begin = time.perf_counter()
        if job == "1000 poses":
            viewer.set_transforms(paths, poses + begin)  # different poses in each call
            return 1000.0 * (time.perf_counter() - begin)
        viewer[job.partition(" ")[0]].set(geometries[job])
        return 1000.0 * (time.perf_counter() - begin)

    return ask


@contextlib.contextmanager
def peer(python: str) -> Iterator[Contestant]:
    """Meshcat in a process of that interpreter, which does jobs as it is told."""
    with process("-m", "bench.treeviewer_peers", "ask", PEER, python=python, stdin=subprocess.PIPE) as child:
        assert child.stdout is not None
        if "ready\n" not in iter(child.stdout.readline, ""):  # the viewer itself says things before
            raise SystemExit(f"{PEER} does not run in {python}")

        def ask(job: str) -> float:
            assert child.stdin is not None
            assert child.stdout is not None
            child.stdin.write(f"{job}\n")
            child.stdin.flush()
            return float(child.stdout.readline())

        yield Contestant(ask, lambda: tree_of(child.pid))


def measure(contestants: dict[str, Contestant], seconds: float) -> dict[str, Figures]:
    """All jobs of all, in turn; the processors' time as jobs of their own, named with ``CPU``."""
    table = {name: Figures(name, {name: [] for job in JOBS for name in (job, CPU + job)}) for name in contestants}
    for job in JOBS:
        able = {name: each for name, each in contestants.items() if name in OURS or job not in OWN_JOBS}
        for contestant in able.values():
            contestant.ask(job)
        end = time.monotonic() + seconds * len(able)
        while time.monotonic() < end:
            for name, contestant in able.items():
                processes = contestant.processes()
                before = computed(processes)
                table[name].jobs[job].append(contestant.ask(job))
                table[name].jobs[CPU + job].append(computed(processes) - before)
    for figures in table.values():
        done = {job for job in JOBS if figures.jobs[job] and figures.jobs[job][0] < math.inf}
        figures.jobs = {job: times for job, times in figures.jobs.items() if job.removeprefix(CPU) in done}
    return table


def rows(table: dict[str, Figures]) -> list[Row]:
    found = []
    for job in JOBS:
        for name in OURS:
            mine, other = table[name].median(job), table[PEER].median(job) if PEER in table else math.nan
            what = f"tree viewer, binary, {name.partition(', ')[2]}: {job}"
            if math.isnan(mine):
                continue
            if job in OWN_JOBS:
                found.append(Row(what, f"{mine:.2f} ms"))
                continue
            if math.isnan(other):
                found.append(skipped(what, "no interpreter with meshcat (--peers)"))
                continue
            found.append(at_least(what, f"{mine:.2f} ms", f"{PEER} {other:.2f} ms", other / mine, 1.0))
            work, theirs = table[name].median(CPU + job), table[PEER].median(CPU + job)
            found.append(
                Row(f"… processors' time, {job}", f"{work:.2f} ms", f"{theirs:.2f} ms", f"{theirs / work:.1f}×")
            )
    for name in OURS:
        what = f"100,000 coloured points, {name.partition(', ')[2]}"
        found.append(at_most(what, table[name].median("cloud 100k, colours of bytes"), FEW_MS, "ms"))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers", help="an interpreter with meshcat")
    parser.add_argument("--seconds", type=float, default=3.0)
    given = parser.parse_args()
    number = random.randrange(20000, 50000)
    udp, tcpq = f"udpm://239.255.76.67:{number}?ttl=0", f"tcpq://127.0.0.1:{number}"
    with contextlib.ExitStack() as stack:
        server = process("-m", "bench.treeviewer_servers", "serve", "--url", udp, "--port", str(number))
        child = stack.enter_context(server)
        started(child)
        ours = [os.getpid(), child.pid]
        contestants = {name: Contestant(asking(url), lambda: ours) for name, url in zip(OURS, (tcpq, udp), strict=True)}
        if given.peers:
            contestants[PEER] = stack.enter_context(peer(given.peers))
        table = measure(contestants, given.seconds)
    print(f"{'ms, median/p99':<36}" + "".join(f"{name:>16}" for name in table))
    for job in [line for name in JOBS for line in (name, CPU + name)]:
        print(f"{job:<36}" + "".join(f"{figures.cell(job):>16}" for figures in table.values()))
    show(rows(table))


if __name__ == "__main__":
    main()
