"""A Ray cluster of two nodes on this machine makes a dataset while one of its workers is killed.

    python -m tests.datasets.ray_nodes SCENES OUT ORBIT SETTINGS

Run with an interpreter that has Ray and Scenegate. SETTINGS are those of a
dataset as JSON. Prints a line of JSON: what was drawn, how many workers were killed, and the cluster's address, which
lives until standard input ends.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from gateway.datasets.ray_tasks import run_pickled_task

if TYPE_CHECKING:
    from gateway.datasets.job import Job
    from scenegate.datasets.manifest import Settings

KILL_AFTER = 0.5
"""Part of the tasks that must be done before a worker is killed."""
STARTS = 6
ENVIRONMENT = {
    "RAY_USAGE_STATS_ENABLED": "0",  # its report would go out into the world
    "RAY_DEDUP_LOGS": "0",
    "RAY_agent_register_timeout_ms": "300000",  # 30 s are too few on a busy machine
    "RAY_worker_register_timeout_seconds": "300",
    "RAY_SERVE_PROXY_READY_CHECK_TIMEOUT_S": "300",  # 5 s, likewise
    "RAY_SERVE_PROXY_HEALTH_CHECK_TIMEOUT_S": "300",
}
"""Environment variables of Ray's processes."""
STORE_BYTES = 100 << 20
"""Size of a node's object store; tasks only carry file names."""


def job_of(scenes: Path, out: Path, orbit: int, settings: Settings) -> Job:
    """Every scene of a folder from so many cameras around it."""
    from gateway.datasets.job import make_job
    from gateway.datasets.scene_sources import find_sources
    from gateway.datasets.views import CameraFile, View
    from gateway.scene.draw.cameras import OrbitCamera

    views = tuple(View(f"orbit-{index}", OrbitCamera(index, orbit, 30.0)) for index in range(orbit))
    return make_job(find_sources([scenes]), views, CameraFile(), settings, out)


def parent_of(pid: int) -> int:
    """The parent's process id; 0 when the process is gone."""
    try:
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    except (OSError, IndexError):
        return 0


def children() -> list[int]:
    """All processes that this one, or one of its children, has started."""
    found: list[int] = []
    for folder in Path("/proc").glob("[0-9]*"):
        ancestor = parent_of(int(folder.name))
        while ancestor not in (0, 1, os.getpid()):
            ancestor = parent_of(ancestor)
        if ancestor == os.getpid():
            found.append(int(folder.name))
    return found


def drawing_workers() -> list[int]:
    """Worker processes of this process's own cluster that draw at this moment."""
    found: list[int] = []
    for pid in children():
        with contextlib.suppress(OSError):
            if Path(f"/proc/{pid}/cmdline").read_bytes().startswith(f"ray::{run_pickled_task.__name__}".encode()):
                found.append(pid)
    return found


def two_nodes(make: Callable[[], Any]) -> Any:
    """A cluster of two nodes with a core each.

    The parts of a node wait 15 s for each other, with no setting for it: on a busy machine that needs several tries.
    """
    for left in reversed(range(STARTS)):
        cluster = make()
        try:
            cluster.add_node(num_cpus=1, object_store_memory=STORE_BYTES, include_dashboard=False)
            cluster.add_node(num_cpus=1, object_store_memory=STORE_BYTES)
        except Exception:  # Ray has no type of its own for it
            cluster.shutdown()
            for pid in children():  # of the node that did not start, which the cluster does not know
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            if not left:
                raise
        else:
            return cluster
    raise AssertionError


def main(scenes: Path, out: Path, orbit: int, settings: bytes) -> None:
    from gateway.runtime.kernels.parts import ensure_compiled

    ensure_compiled()
    from ray.cluster_utils import Cluster

    from gateway.datasets.job import RenderTask, Result
    from gateway.datasets.ray_tasks import run_ray
    from gateway.datasets.run import run
    from scenegate.datasets.manifest import Settings

    cluster = two_nodes(Cluster)
    killed: list[int] = []
    finished = threading.Event()
    begin = time.monotonic()

    def kill_one() -> None:
        while not finished.is_set():
            for pid in drawing_workers():
                os.kill(pid, signal.SIGKILL)
                killed.append(pid)
                return
            time.sleep(0.005)

    def execute(tasks: list[RenderTask]) -> Iterator[Result]:
        killer = threading.Thread(target=kill_one)
        started = False
        for number, result in enumerate(run_ray(tasks, cluster.address)):
            yield result
            if not started and number >= KILL_AFTER * len(tasks):
                killer.start()
                started = True
        finished.set()  # without a worker to kill, the run reports 0 killed instead of waiting
        killer.join()

    try:
        job = job_of(scenes, out, orbit, msgspec.json.decode(settings, type=Settings))
        progress = run(job, execute, lambda _: None)
        said = {
            "drawn": progress.rendered,
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
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), sys.argv[4].encode())
