"""Measure concurrent renders, one frame on two cores, and event loop stalls.

    python -m bench.concurrency

Two threads that hash a block each show the largest speed-up that the machine allows.

A stall is the delay of a 1 ms ticker on the event loop while worker threads render a million triangles.
"""

from __future__ import annotations

import asyncio
import hashlib
import statistics
import threading
import time
from collections.abc import Callable
from functools import partial

import uvloop

from bench.raster import scenes, view
from bench.table import Row, at_least, at_most, heading, show
from gateway.runtime.kernels import parts
from gateway.runtime.kernels.loading import ensure_compiled
from gateway.runtime.workers.process_tuning import freeze_gc, tune
from gateway.runtime.workers.worker_pool import WorkerPool
from renderers.drawlist import DrawList
from renderers.interface import Look, Output
from renderers.raster import CpuRenderer

ALL = Output.COLOR | Output.DEPTH | Output.LABEL
SIZE = (640, 480)
FRAMES = 96
"""Frames per run; with fewer, starting and ending the threads takes more than 1 % of the time."""
TICK = 0.001
BLOCK = bytes(1 << 20)


def elements(scene: DrawList) -> int:
    """Return the number of triangles of all instances."""
    return sum(len(instance.mesh.elements) for instance in scene.instances)


def draw(renderer: CpuRenderer, scene: DrawList, frame: int) -> None:
    renderer.render(scene, view(*SIZE, frame), ALL, Look())


def hash_alone(_: int) -> None:
    """Hash one block with the GIL released: work that only needs a core."""
    hashlib.sha256(BLOCK).digest()


def seconds_for(threads: int, work: Callable[[int], None]) -> float:
    """Return the wall time of ``FRAMES`` calls shared by this many threads."""
    numbers = iter(range(FRAMES))
    lock = threading.Lock()

    def run() -> None:
        while True:
            with lock:
                number = next(numbers, None)
            if number is None:
                return
            work(number)

    workers = [threading.Thread(target=run) for _ in range(threads)]
    begin = time.perf_counter()
    for each in workers:
        each.start()
    for each in workers:
        each.join()
    return time.perf_counter() - begin


def scaling() -> list[Row]:
    """Measure two concurrent renders, and one render on two threads, against one render on one thread."""
    print("\n" + heading("640×480, all outputs", "two renders at once", "one frame on two threads"))
    alone, pair = CpuRenderer(1), CpuRenderer(2)
    callers: dict[str, float] = {}
    within: dict[str, float] = {}
    hashes: list[float] = []
    for name, scene in scenes().items():
        for renderer in (alone, pair):
            draw(renderer, scene, 0)
        runs: list[tuple[float, float, float]] = []
        for _ in range(5):
            one = seconds_for(1, partial(draw, alone, scene))
            two = seconds_for(2, partial(draw, alone, scene))
            split = seconds_for(1, partial(draw, pair, scene))
            runs.append((one / two, one / split, one / FRAMES))
            hashes.append(seconds_for(1, hash_alone) / seconds_for(2, hash_alone))
        callers[name], within[name], took = (statistics.median(column) for column in zip(*runs, strict=True))
        print(f"| {name} ({1e3 * took:.1f} ms alone) | {callers[name]:.2f}× | {within[name]:.2f}× |", flush=True)
    most = statistics.median(hashes)
    print(f"| two hashes, in turns with these | {most:.2f}× (quartiles {at(hashes, 0.25)} - {at(hashes, 0.75)}) | |")
    slowest = max(within, key=lambda name: elements(scenes()[name]))
    return [
        at_least("two renders at once against one after the other (least)", "", "one", min(callers.values()), 1.8),
        Row("… the most that the machine gives two threads: a hash each", "", "one", f"{most:.2f}×"),
        at_least(f"one frame on two threads, {slowest}", "", "one thread", within[slowest], 1.7),
    ]


def at(values: list[float], part: float) -> str:
    return f"{percentile(values, part):.2f}"


def percentile(values: list[float], part: float) -> float:
    return sorted(values)[min(len(values) - 1, int(part * len(values)))]


async def stalls(seconds: float, renderer: CpuRenderer, scene: DrawList | None) -> list[float]:
    """Return the delays of a 1 ms ticker on the event loop, ms."""
    workers = WorkerPool()
    ended = False

    async def keep_drawing() -> None:
        frame = 0
        while not ended and scene is not None:
            await workers.run(draw, renderer, scene, frame)
            frame += 1

    busy = asyncio.create_task(keep_drawing())
    late: list[float] = []
    end = time.perf_counter() + seconds
    while (begin := time.perf_counter()) < end:
        await asyncio.sleep(TICK)
        late.append(1e3 * (time.perf_counter() - begin - TICK))
    ended = True
    await busy
    await workers.close()
    return late


def event_loop() -> list[Row]:
    """Measure event loop stalls, idle and while frames are rendered."""
    scene = max(scenes().values(), key=elements)
    draw(CpuRenderer(1), scene, 0)
    renderer = CpuRenderer()  # its helper is started by a worker, whose priority it takes over, as in the gateway
    freeze_gc()
    print("\n" + heading("event loop, 1 ms ticker, ms late", "p50", "p99", "max"))
    worst = 0.0
    for name, drawn in (("idle", None), ("a million triangles are drawn", scene)):
        late = uvloop.run(stalls(5.0, renderer, drawn))
        worst = percentile(late, 0.99)
        print(f"| {name} | {percentile(late, 0.5):.2f} | {worst:.2f} | {max(late):.2f} |", flush=True)
    return [at_most("event loop, p99 stall while a million triangles are drawn", worst, 2.0, "ms")]


def main() -> None:
    tune()
    ensure_compiled()
    parts.load_needed()
    show([*scaling(), *event_loop()])


if __name__ == "__main__":
    main()
