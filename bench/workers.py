"""Throughput of `scenegate serve --only render --workers N` for several N, as a table.

    python -m bench.workers --workers 1,2,4,8,16 [--clients N] [--threads N] [--turns N]

All servers run at once and get the same requests in turns, so that other programs on the machine affect them
equally. The clients are processes on the same machine and use some of its cores. Columns:

- renders/s: median over the turns, with quartiles; ratio: relative to the first number of workers;
- efficiency: ratio divided by the ratio of the numbers of workers;
- CPU ms: CPU time of server + client per render, which depends little on other programs;
- at most: renders/s if all cores worked for server and clients only;
- busy, others: number of cores that server and clients used, and that other programs used.

Without SCENEGATE_CORPUS the scene has 1.6 MB and 40,000 triangles.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack

from bench import render_requests
from bench.concurrency import percentile
from bench.gateways import Gateway, gateway
from bench.load_clients import LoadResult, run_clients
from bench.table import heading
from gateway.runtime.workers.scheduling import usable_cpus

SIZE = (640, 480)
"""Width and height of the images, pixels."""
SCENES = ("001", "010")
"""Recorded scenes, by the number at the start of their folder's name: boxes, and a robot arm with meshes."""
KINDS = ("color", "depth")
"""Image types to render."""
POLL_SECONDS = 0.1
"""Interval between two checks whether a server is ready."""


def scenes() -> list[render_requests.RenderScene]:
    """Return the requests to measure: each scene with each image type."""
    if (folder := render_requests.corpus()) is None:
        return [render_requests.textured(kind, copies=2, unique=2, side=256) for kind in KINDS]
    return [render_requests.recorded(folder, number, kind) for number in SCENES for kind in KINDS]


def wait_until_ready(running: Gateway, workers: int) -> None:
    """Wait until all processes of a server are ready."""
    while True:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{running.port}/readyz") as response:
                ready = json.load(response)
                processes = len(ready["workers"]["states"]) if "workers" in ready else 1
                if ready["status"] == "ready" and processes == workers:
                    return
        except urllib.error.HTTPError:
            pass
        time.sleep(POLL_SECONDS)


def measure(
    servers: Mapping[int, Gateway], scene: render_requests.RenderScene, clients: int, requests: int, turns: int
) -> dict[int, list[LoadResult]]:
    """Return the results of each turn, by number of workers. A first turn fills the caches and is left out.

    Args:
        servers: servers by number of workers.
        scene: scene of the requests. Each request has other poses, so that no response comes from a cache.
        clients: number of concurrent clients.
        requests: number of requests to each server in each turn.
        turns: number of turns.
    """
    results: dict[int, list[LoadResult]] = {workers: [] for workers in servers}
    for turn in range(turns + 1):
        for workers, running in servers.items():
            result = run_clients(
                running.port, running.process.pid, [scene.next_body(*SIZE) for _ in range(requests)], clients
            )
            if turn:
                results[workers].append(result)
    return results


def median(results: Sequence[LoadResult], figure: Callable[[LoadResult], float]) -> float:
    """Return the median of a figure over all turns."""
    return statistics.median(map(figure, results))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", default="1,2", help="numbers of processes, separated by commas")
    parser.add_argument("--clients", type=int, default=0, help="default: twice the most workers, at least 4")
    parser.add_argument("--threads", type=int, default=0, help="threads of each process; default: cores / workers")
    parser.add_argument("--requests", type=int, default=96, help="number of requests to each server in each turn")
    parser.add_argument("--turns", type=int, default=5)
    options = parser.parse_args()
    counts = [int(text) for text in options.workers.split(",")]
    clients = options.clients or max(4, 2 * max(counts))
    rates: dict[str, dict[int, float]] = {}
    with ExitStack() as stack:
        servers = {}
        for workers in counts:
            flags = ("--only", "render", "--workers", str(workers), "--threads", str(options.threads))
            servers[workers] = stack.enter_context(gateway(*flags))
            wait_until_ready(servers[workers], workers)
        print(f"{clients} clients, {usable_cpus()} cores, load {os.getloadavg()[0]:.1f}\n")
        print(heading("scene", "workers", "renders/s", "ratio", "efficiency", "CPU ms", "at most", "busy", "others"))
        for scene in scenes():
            results = measure(servers, scene, clients, options.requests, options.turns)
            name = f"{scene.name} {scene.fields['image_type']}"
            rates[name] = {workers: median(turns, lambda turn: turn.rate) for workers, turns in results.items()}
            for workers, turns in results.items():
                ratio = rates[name][workers] / rates[name][counts[0]]
                low, high = (percentile([turn.rate for turn in turns], fraction) for fraction in (0.25, 0.75))
                server, client = median(turns, lambda turn: turn.server_ms), median(turns, lambda turn: turn.client_ms)
                busy, others = median(turns, lambda turn: turn.busy), median(turns, lambda turn: turn.others)
                cells = f"{rates[name][workers]:.0f} ({low:.0f} - {high:.0f}) | {ratio:.2f}× "
                cells += f"| {ratio * counts[0] / workers:.0%} | {server:.1f} + {client:.1f} "
                cells += f"| {1e3 * usable_cpus() / (server + client):.0f} | {busy:.2f} | {others:.2f}"
                print(f"| {name} | {workers} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
