"""Measure the cost of ``--state``: tree viewer jobs over TCPQ with and without it, and a flood.

    python -m bench.state [--seconds S] [--folder FOLDER]

Two services run in processes of their own and get requests in turns. Each figure is a median (p99 after the slash) in
ms from the client's call to the response, which with a state comes after the commit. FOLDER holds the state file; its
disk is measured.
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import math
import statistics
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import uvloop

from bench.treeviewer_clients import Client, Figures, measure, process, started
from bench.treeviewer_requests import boxes, cloud, transforms
from gateway.adapters.treeviewer.config import TreeViewerConfig
from gateway.adapters.treeviewer.protocol import TreeViewerProtocol
from gateway.adapters.treeviewer.service import TreeViewerService
from gateway.runtime.lcm.config import LcmConfig
from gateway.runtime.state.config import StateConfig
from gateway.runtime.state.database import Database
from gateway.runtime.state.service import PersistentState
from gateway.runtime.state.tree_store import TreeStore
from gateway.runtime.workers.process_tuning import tune
from gateway.scene.tree.live import LiveTree

JOBS = {
    "1 transform": lambda: transforms(1),
    "100 transforms": lambda: transforms(100),
    "1000 transforms": lambda: transforms(1000),
    "create 1000 boxes": boxes,
    "cloud 100k": cloud,
}
COMMITS = 21
FLOODS = {"flood of 3000 single transforms": (1, 3000), "flood of 200 x 1000 transforms": (1000, 200)}


async def serve(port: int, path: Path | None) -> None:
    """Serve until the process is killed."""
    tune()
    live = LiveTree()
    state = PersistentState(StateConfig(path)) if path is not None else None
    if state is not None:
        state.restore_tree(live)
        state.start()
        state.store_idle_edits(live)
    service = TreeViewerService(
        TreeViewerConfig(lcm=LcmConfig(url="off", tcpq_port=port)),
        live,
        store=state.commits if state is not None else None,
    )
    running = asyncio.create_task(service.run())
    await service.wait_ready()
    gc.collect()
    gc.freeze()
    print("ready", flush=True)
    await running


def commits(folder: Path) -> None:
    """Print the CPU time of commits."""
    live = LiveTree()
    database, store, protocol = Database(folder / "bench.commits"), TreeStore(live), TreeViewerProtocol(live)
    connection = database.connection
    print("processor's time of a commit in ms, and of the first one")
    for job, make in JOBS.items():
        message, times = make(), []
        for _ in range(COMMITS):
            protocol.handle(message)
            begin = time.thread_time()
            connection.execute("BEGIN IMMEDIATE")
            captured = store.capture()
            store.write(connection, captured)
            connection.execute("COMMIT")
            store.committed(captured)
            times.append(1e3 * (time.thread_time() - begin))
        print(f"{job:32}{statistics.median(times[1:]):>14.3g}{times[0]:>14.3g}")
    database.close()


def compare(seconds: float, folder: Path) -> None:
    """Print times with and without a state file."""
    ports = {"without": 7811, "with": 7812}
    with ExitStack() as stack:
        for name, port in ports.items():
            path = folder / "bench.state" if name == "with" else ""
            child = stack.enter_context(
                process("-m", "bench.state", "--part", "serve", "--port", str(port), "--state", str(path))
            )
            started(child)
        urls = {name: f"tcpq://127.0.0.1:{port}" for name, port in ports.items()}
        table = measure(urls, {name: make() for name, make in JOBS.items()}, seconds)
        print(f"{'':32}{'without':>14}{'with':>14}   more, ms")
        for job in JOBS:
            print(f"{job:32}{table[0].cell(job):>14}{table[1].cell(job):>14}{_more(table, job):>11.3g}")
        for name, (size, count) in FLOODS.items():
            row = []
            for url in urls.values():
                answered, took = Client(url, "flood").flood(transforms(size), count)
                row.append(f"{answered / took:.0f}/s" if answered == count else f"{count - answered} lost")
            print(f"{name:32}{row[0]:>14}{row[1]:>14}")


def _more(table: list[Figures], job: str) -> float:
    before, after = table[0].median(job), table[1].median(job)
    return after - before if math.isfinite(before) else math.nan


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=3.0, help="bound of each job")
    parser.add_argument("--folder", type=Path, help="where the state lies (default: the system's temporary folder)")
    parser.add_argument("--part", default="", help=argparse.SUPPRESS)
    parser.add_argument("--port", type=int, default=0, help=argparse.SUPPRESS)
    parser.add_argument("--state", default="", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.part == "serve":
        uvloop.run(serve(given.port, Path(given.state) if given.state else None))
        return
    with tempfile.TemporaryDirectory(dir=given.folder) as folder:
        compare(given.seconds, Path(folder))
        commits(Path(folder))


if __name__ == "__main__":
    main()
