"""A dataset on a Ray cluster of two nodes, one of whose workers is killed in the middle, against one process.

    python -m bench.cluster [--renders 2000] [--ray PYTHON]

PYTHON is an interpreter with ``scenegate[ray]`` (or SCENEGATE_RAY_PYTHON). Both nodes are on this machine and have one
core each. Every file of both datasets is compared, byte by byte.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from bench.gateways import TIMEOUT
from bench.ray_nodes import ENVIRONMENT, job_of
from bench.render_requests import sphere
from bench.running import end
from bench.table import Row, at_least, show, skipped

ROOT = Path(__file__).parents[1]
SCENES = 4


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
    from gateway.runtime.kernels.loading import ensure_compiled

    ensure_compiled()
    from gateway.datasets.local_tasks import run_local
    from gateway.datasets.run import run

    begin = time.monotonic()
    progress = run(job_of(scenes, out, orbit, settings()), lambda tasks: run_local(tasks, 1), lambda _: None)
    assert not progress.failures
    return time.monotonic() - begin


@contextmanager
def cluster(python: str, scenes: Path, out: Path, orbit: int) -> Iterator[dict[str, Any]]:
    """Render a dataset on a local Ray cluster; yield the report that it prints."""
    command = [python, "-m", "bench.ray_nodes", str(scenes), str(out), str(orbit)]
    command.append(msgspec.json.encode(settings()).decode())
    process = subprocess.Popen(
        command, cwd=ROOT, env=_environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        line = next((line for line in process.stdout if line.startswith("{")), "")
        assert line, f"the cluster ended with {process.wait()}"
        yield json.loads(line)
        process.communicate("", timeout=TIMEOUT)
    finally:
        end(process)
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--renders", type=int, default=2000)
    parser.add_argument("--ray", metavar="PYTHON", default=os.environ.get("SCENEGATE_RAY_PYTHON", sys.executable))
    options = parser.parse_args()
    if subprocess.run([options.ray, "-c", "import ray"], capture_output=True).returncode:
        show([skipped("a dataset on two Ray nodes", f"{options.ray} has no Ray")])
        return
    orbit = max(1, options.renders // SCENES)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_scenes(folder / "scenes")
        with cluster(options.ray, folder / "scenes", folder / "ray", orbit) as said:
            seconds = alone(folder / "scenes", folder / "one", orbit)
            rows = list(dataset_rows(said, folder / "one", folder / "ray", seconds, SCENES * orbit))
        cores = os.cpu_count()
        print(f"{SCENES} scenes, {orbit} cameras each; colour, depth and label of 320x240; {cores} cores")
        show(rows)


if __name__ == "__main__":
    main()
