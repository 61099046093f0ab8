"""A dataset on a Ray cluster of two nodes, one of whose workers is killed in the middle, against one process.

    python -m bench.cluster [--renders 2000] [--serve] [--ray PYTHON]

PYTHON is an interpreter with ``scenegate[ray]`` (or SCENEGATE_RAY_PYTHON). Both nodes are on this machine and have one
core each. Every file of both datasets is compared, byte by byte. With ``--serve``, examples/ray_serve.py runs on the
same cluster afterwards, and requests come in until it has started another replica.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from bench.gateways import TIMEOUT, post
from bench.posted import sphere, textured
from bench.ray_nodes import ENVIRONMENT, order
from bench.table import Row, at_least, show, skipped

ROOT = Path(__file__).parents[1]
SCENES = 4
CLIENTS = 8
SERVE_SECONDS = 240.0
"""For another replica: Ray decides after 5 s of load, and a replica has to load its kernels."""


def settings() -> Any:
    """Colour, depth and labels of 320 x 240."""
    from gateway.client.manifest import Settings

    return Settings(
        types=("color", "depth", "label"), width=320, height=240, fovy=45.0, look="plain", up="auto", antialias="fxaa",
        depth_format="png", background=(204, 229, 255),
    )  # fmt: skip


def write_scenes(folder: Path) -> None:
    """STL files of 5,000 to 20,000 triangles, each another shape."""
    folder.mkdir()
    for number in range(SCENES):
        positions, _, _, triangles = sphere(50 * (number + 1), 50)
        wavy = positions * (1.0 + 0.2 * np.sin((number + 3) * positions[:, :1] * 6.0))
        facets = np.zeros(len(triangles), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        facets["corners"] = wavy[triangles]
        data = bytes(80) + len(facets).to_bytes(4, "little") + facets.tobytes()
        (folder / f"shape{number}.stl").write_bytes(data)


def alone(scenes: Path, out: Path, orbit: int) -> float:
    """The same dataset by one process; seconds."""
    from gateway import warmup
    from gateway.ops import kernels

    kernels.ensure_cached(warmup.PARTS)
    from gateway.batch.local import run_local
    from gateway.batch.run import run

    begin = time.monotonic()
    progress = run(order(scenes, out, orbit, settings()), lambda tasks: run_local(tasks, 1), lambda _: None)
    assert not progress.failures
    return time.monotonic() - begin


@contextmanager
def nodes(python: str, scenes: Path, out: Path, orbit: int) -> Iterator[tuple[subprocess.Popen[str], dict[str, Any]]]:
    """The cluster after it has made the dataset, with what it says of that."""
    command = [python, "-m", "bench.ray_nodes", str(scenes), str(out), str(orbit)]
    command.append(msgspec.json.encode(settings()).decode())
    process = subprocess.Popen(
        command, cwd=ROOT, env=_environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        line = next((line for line in process.stdout if line.startswith("{")), "")
        assert line, f"the cluster ended with {process.wait()}"
        yield process, json.loads(line)
        process.communicate("", timeout=TIMEOUT)
    finally:
        process.kill()
        process.communicate()


def _environment() -> dict[str, str]:
    return {**os.environ, **ENVIRONMENT, "PYTHONPATH": str(ROOT)}


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every file."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def dataset_rows(said: dict[str, Any], ours: Path, theirs: Path, seconds: float, asked: int) -> Iterator[Row]:
    one, many = digests(ours), digests(theirs)
    same = sum(many.get(name) == digest for name, digest in one.items())
    drawn, nodes_used, killed = said["drawn"], said["nodes"], said["killed"]
    what = f"renders done on {nodes_used} Ray nodes, {killed} worker killed (-9) in the middle"
    yield at_least(what, f"{drawn} of {asked}", "", 100 * drawn / asked if killed == 1 else 0.0, 100.0, " %")
    yield Row("failures", f"{len(said['failures'])}", "", "", "0", not said["failures"])
    whole = 100 * same / max(len(one), len(many))
    yield at_least(
        "files equal to those of one process, all bytes", f"{same} of {len(one)}", f"{len(many)}", whole, 100.0, " %"
    )
    yield Row("seconds, start of the workers included", f"{said['seconds']:.1f}", f"one process: {seconds:.1f}")


def served(python: str, cluster: subprocess.Popen[str], address: str, port: int) -> Iterator[Row]:
    """The endpoint on the same cluster, under load until another replica runs."""
    flags = ["--address", address, "--port", str(port), "--most", "2"]
    command = [python, str(ROOT / "examples" / "ray_serve.py"), *flags]
    body = textured("color", copies=2, unique=2, side=256).moved(640, 480)
    enough = threading.Event()
    statuses: list[int] = []

    def client() -> None:
        while not enough.is_set():
            with contextlib.suppress(OSError, IndexError):
                statuses.append(post(port, body).status)

    with subprocess.Popen(command, env=_environment(), stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            assert any(line.startswith("http://") for line in server.stdout), "the endpoint did not start"
            counts = [(0.0, _replicas(cluster))]
            clients = [threading.Thread(target=client) for _ in range(CLIENTS)]
            begin = time.monotonic()
            for thread in clients:
                thread.start()
            while counts[-1][1] < 2 and time.monotonic() - begin < SERVE_SECONDS:
                time.sleep(0.5)
                now = _replicas(cluster)
                if now != counts[-1][1]:
                    counts.append((time.monotonic() - begin, now))
            enough.set()
            for thread in clients:
                thread.join()
        finally:
            enough.set()
            server.terminate()
    shown = ", ".join(f"{count} after {seconds:.0f} s" for seconds, count in counts)
    what = f"Ray Serve: replicas, under load of {CLIENTS} clients"
    yield Row(what, shown, "", f"{counts[-1][1] / max(counts[0][1], 1):.0f}×", "more than at the start",
              counts[-1][1] > counts[0][1] > 0)  # fmt: skip
    good = statuses.count(200)
    yield Row("of the requests meanwhile, answered", f"{good} of {len(statuses)}", "", "", "all", good == len(statuses))


def _replicas(cluster: subprocess.Popen[str]) -> int:
    assert cluster.stdin is not None
    assert cluster.stdout is not None
    cluster.stdin.write("replicas\n")
    cluster.stdin.flush()
    return int(next(line for line in cluster.stdout if line.strip().isdigit()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--renders", type=int, default=2000)
    parser.add_argument("--serve", action="store_true", help="and Ray Serve's autoscaling")
    parser.add_argument("--ray", metavar="PYTHON", default=os.environ.get("SCENEGATE_RAY_PYTHON", sys.executable))
    options = parser.parse_args()
    wanted = "import ray.serve" if options.serve else "import ray"
    if subprocess.run([options.ray, "-c", wanted], capture_output=True).returncode:
        show([skipped("a dataset on two Ray nodes", f"{options.ray} has no Ray")])
        return
    orbit = max(1, options.renders // SCENES)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_scenes(folder / "scenes")
        with nodes(options.ray, folder / "scenes", folder / "ray", orbit) as (cluster, said):
            seconds = alone(folder / "scenes", folder / "one", orbit)
            rows = list(dataset_rows(said, folder / "one", folder / "ray", seconds, SCENES * orbit))
            if options.serve:
                rows += served(options.ray, cluster, said["address"], 20000 + os.getpid() % 20000)
        cores = os.cpu_count()
        print(f"{SCENES} scenes, {orbit} cameras each; colour, depth and label of 320x240; {cores} cores")
        show(rows)


if __name__ == "__main__":
    main()
