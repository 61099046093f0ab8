"""A Ray cluster of two nodes on this machine makes a dataset while one of its workers is killed.

    python -m tests.batch.ray_cluster SCENES OUT ORBIT

Run by ``test_ray.py`` with an interpreter that has Ray and Scenegate. Prints a line of JSON: what was drawn, how many
workers were killed, and the cluster's address, which lives until standard input ends.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

KILL_AFTER = 0.4
"""Part of the tasks that must be done before a worker is killed."""


def parent_of(pid: int) -> int:
    """The parent's process id; 0 when the process is gone."""
    try:
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    except (OSError, IndexError):
        return 0


def drawing_workers() -> list[int]:
    """Worker processes of this process's own cluster that draw at this moment."""
    found: list[int] = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            title = (folder / "cmdline").read_bytes()
        except OSError:
            continue
        if not title.startswith(b"ray::draw"):
            continue
        ancestor = int(folder.name)
        while ancestor not in (0, 1, os.getpid()):
            ancestor = parent_of(ancestor)
        if ancestor == os.getpid():
            found.append(int(folder.name))
    return found


def main(scenes: Path, out: Path, orbit: int) -> None:
    from gateway import warmup
    from gateway.ops import kernels

    kernels.ensure_cached(warmup.PARTS)
    from ray.cluster_utils import Cluster

    from gateway.batch.plan import Result, Task
    from gateway.batch.raytasks import run_ray
    from gateway.batch.run import run
    from tests.batch.conftest import order_of

    store = 100 << 20
    cluster = Cluster(True, head_node_args={"num_cpus": 1, "include_dashboard": False, "object_store_memory": store})
    cluster.add_node(num_cpus=1, object_store_memory=store)
    killed: list[int] = []
    begin = time.monotonic()

    def kill_one() -> None:
        while not killed:
            for pid in drawing_workers():
                os.kill(pid, signal.SIGKILL)
                killed.append(pid)
                return
            time.sleep(0.005)

    def execute(tasks: list[Task]) -> Iterator[Result]:
        killer = threading.Thread(target=kill_one)
        started = False
        for number, result in enumerate(run_ray(tasks, cluster.address)):
            yield result
            if not started and number >= KILL_AFTER * len(tasks):
                killer.start()
                started = True
        killer.join()

    try:
        progress = run(order_of(scenes, out, orbit=orbit), execute, lambda _: None)
        said = {
            "drawn": progress.drawn,
            "failures": [failure.reason for failure in progress.failures],
            "killed": len(killed),
            "nodes": len(cluster.list_all_nodes()),
            "seconds": round(time.monotonic() - begin, 1),
            "address": cluster.address,
        }
        print(json.dumps(said), flush=True)
        sys.stdin.read()
    finally:
        cluster.shutdown()


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
