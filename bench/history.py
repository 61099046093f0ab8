"""Memory and CPU time of the live tree's history: ``python -m bench.history [--nodes 1000] [--hz 60] [--seconds 60]``.

All nodes move in each edit. The clock is simulated, so the run takes only the time of the edits and of recording them.
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import random
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median, quantiles
from typing import Final

import numpy as np

from gateway.runtime.settings import MIB, Settings
from gateway.scene.tree.history import TreeHistory
from gateway.scene.tree.live import LiveTree

SEEKS: Final = 200
NANOSECONDS: Final = 1_000_000_000


def resident_bytes() -> int:
    """Return the resident memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


def cpu(call: Callable[[], object]) -> float:
    """Return the CPU seconds of this thread for a call."""
    start = time.thread_time()
    call()
    return time.thread_time() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--nodes", type=int, default=1000)
    parser.add_argument("--hz", type=int, default=60)
    parser.add_argument("--seconds", type=int, default=60)
    arguments = parser.parse_args()
    now = NANOSECONDS
    tree = LiveTree(lambda: now)
    settings = Settings()
    max_bytes = settings.history_mb * MIB
    history = TreeHistory(tree, settings.history_seconds, max_bytes, asyncio.to_thread, lambda: now)
    paths = [("world", f"body {number}") for number in range(arguments.nodes)]
    generator = np.random.default_rng(0)
    edit_seconds: list[float] = []
    record_seconds: list[float] = []

    def move() -> None:
        with tree.edit() as edit:
            edit.set_poses(paths, map(tuple, poses))

    gc.collect()
    before = resident_bytes()
    for _ in range(arguments.hz * arguments.seconds):
        now += NANOSECONDS // arguments.hz
        poses = generator.random((arguments.nodes, 7)).tolist()
        edit_seconds.append(cpu(move))
        record_seconds.append(cpu(history.record))
    grown = resident_bytes() - before
    first, last = history.span
    seeks = []
    times = random.Random(0)
    for _ in range(SEEKS):
        start = time.perf_counter()
        asyncio.run(history.snapshot_at(times.randrange(first, last)))
        seeks.append(time.perf_counter() - start)
    share = sum(record_seconds) / arguments.seconds
    print(f"{arguments.nodes} nodes, {arguments.hz} Hz, {arguments.seconds} s: {(last - first) / 1e9:.1f} s are kept")
    print(
        f"memory {grown / 1e6:.0f} MB resident, {history.nbytes / 1e6:.0f} MB estimated, limit {max_bytes / 1e6:.0f} MB"
    )
    print(f"an edit {1e3 * median(edit_seconds):.2f} ms, recording it {1e3 * median(record_seconds):.2f} ms: ", end="")
    print(f"{100 * share:.1f} % of a core")
    print(f"a seek {1e3 * median(seeks):.1f} ms, 95 % below {1e3 * quantiles(seeks, n=20)[-1]:.1f} ms")


if __name__ == "__main__":
    main()
