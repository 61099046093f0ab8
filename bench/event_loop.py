"""How long worker threads that render a million triangles block the event loop: ``python -m bench.event_loop``.

A stall is the delay of a 1 ms ticker on the event loop.
"""

import asyncio
import time

import uvloop

from bench.raster import scenes, view
from bench.table import Row, at_most, heading, show
from gateway.runtime.kernels import parts
from gateway.runtime.kernels.parts import ensure_compiled
from gateway.runtime.workers.process_tuning import freeze_gc, tune
from gateway.runtime.workers.worker_pool import WorkerPool
from renderers.drawlist import DrawList
from renderers.interface import Look, Output
from renderers.raster import CpuRenderer

ALL = Output.COLOR | Output.DEPTH | Output.LABEL
SIZE = (640, 480)
TICK = 0.001


def elements(scene: DrawList) -> int:
    """Return the number of triangles of all instances."""
    return sum(len(instance.mesh.elements) for instance in scene.instances)


def draw(renderer: CpuRenderer, scene: DrawList, frame: int) -> None:
    renderer.render(scene, view(*SIZE, frame), ALL, Look())


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
    show(event_loop())


if __name__ == "__main__":
    main()
