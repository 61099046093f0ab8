"""Measure the opening of large logs, and seeks in them.

    python -m bench.logs [--gb GB] [--kind robots|drake|clouds] [--log LOG]

Makes a log and opens it: ``robots`` has a robot of 30 links at 60 Hz from a tree viewer client, camera images at 10 Hz
on a channel that is not shown, and a cloud of 20,000 points at 5 Hz; ``drake`` is Drake's recorded traffic from
SCENEGATE_CORPUS, repeated; ``clouds`` has clouds of 300,000 points only. LOG is an existing log to measure instead.
"""

from __future__ import annotations

import argparse
import asyncio
import io
import itertools
import os
import random
import resource
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gateway.replay.timeline import LogTimeline, open_log
from gateway.runtime.kernels.cache import configure
from gateway.runtime.workers.process_tuning import return_memory, tune
from scenegate.lcm.event_log import pack_event, read_events
from tests.adapters.drakeviewer.encoding import cloud
from tests.adapters.treeviewer.conversation import BOX, message

REQUEST = "DIRECTOR_TREE_VIEWER_REQUEST_<bench>"
FIELDS = [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1), ("rgb", 12, 6, 1)]
LINKS = 30
SEEKS = 300
Message = tuple[int, str, bytes]


def robots() -> Iterator[Message]:
    """Yield time in microseconds, channel and data."""
    paths = [["robot", f"link {k}"] for k in range(LINKS)]
    yield 0, REQUEST, message({"setgeometry": [{"path": path, "geometry": BOX} for path in paths]})
    image = random.Random(1).randbytes(100_000)
    for frame in itertools.count():
        seconds = frame / 60
        poses = [
            {
                "path": path,
                "transform": {"translation": [float(np.sin(seconds + k)), k / 10, 0.5], "quaternion": [1, 0, 0, 0]},
            }
            for k, path in enumerate(paths)
        ]
        yield frame * 1_000_000 // 60, REQUEST, message({"settransform": poses})
        if frame % 6 == 0:
            yield frame * 1_000_000 // 60, "CAMERA_LEFT", image
        if frame % 12 == 0:
            yield frame * 1_000_000 // 60, "DRAKE_POINT_CLOUD_lidar", _cloud(20_000, seconds)


def clouds() -> Iterator[Message]:
    """Yield clouds of 300,000 points at 10 Hz."""
    for frame in itertools.count():
        yield frame * 100_000, "DRAKE_POINT_CLOUD_lidar", _cloud(300_000, frame / 10)


def drake() -> Iterator[Message]:
    """Yield a recorded simulation again and again, each time with later times of the simulation."""
    path = Path(os.environ["SCENEGATE_CORPUS"]) / "drakeviewer" / "drake_default.lcmlog"
    with path.open("rb") as file:
        recorded = file.read().replace(b"LABDIR", b"/lab")  # a folder of the recording, as the lengths say
    events = [e for e in read_events(io.BytesIO(recorded)) if e.channel.startswith(("DRAKE", "CONTACT"))]
    begin = events[0].time_us
    for repeat in itertools.count():
        for event in events:
            data = event.data
            if event.channel.startswith("DRAKE_VIEWER_DRAW"):
                milliseconds = int.from_bytes(data[8:16], "big") + 2000 * repeat
                data = data[:8] + struct.pack(">q", milliseconds) + data[16:]
            if repeat == 0 or "LOAD" not in event.channel:
                yield (event.time_us - begin) * 2 // 7 + 2_000_000 * repeat, event.channel, data


def _cloud(count: int, seconds: float) -> bytes:
    points = np.zeros((count, 4), "<f4")
    angles = np.arange(count, dtype=np.float32) * 0.01 + seconds
    points[:, 0], points[:, 1], points[:, 2] = np.cos(angles) * 5, np.sin(angles) * 5, angles % 3
    return cloud(points.tobytes(), count, FIELDS, 16)


def write_log(path: Path, messages: Iterator[Message], size: int) -> None:
    """Write messages until the file has ``size`` bytes."""
    written = 0
    with path.open("wb") as file:
        for number, (time_us, channel, data) in enumerate(messages):
            written += file.write(pack_event(number, 1_700_000_000_000_000 + time_us, channel, data))
            if written >= size:
                return


async def measure(timeline: LogTimeline, begin: float) -> None:
    """Index a log that was opened at a time, and seek."""
    summary = timeline.summary
    length = (summary.span[1] - summary.span[0]) / 1e9
    print(f"{summary.file_bytes / 1e9:.2f} GB, {length:.0f} s, {summary.events} messages, {summary.shown} shown")
    snapshot = await timeline.snapshot_at(timeline.span[0])
    print(f"first state after {time.perf_counter() - begin:.2f} s")
    begin, cpu = time.perf_counter(), time.process_time()
    await timeline.build_index()
    checkpoints = timeline._checkpoints  # noqa: SLF001 - for its figures
    print(
        f"index built in {time.perf_counter() - begin:.1f} s ({time.process_time() - cpu:.1f} s of CPU): "
        f"{len(checkpoints)} checkpoints, "
        f"{checkpoints.nbytes / 1e6:.0f} MB"
    )
    await _seek(timeline)
    begin, count = time.perf_counter(), 600
    for k in range(count):
        snapshot = await timeline.snapshot_at(timeline.span[1] // 2 + timeline.span[0] // 2 + k * 1_000_000_000 // 60)
    print(f"played forward at 60 Hz: {1e3 * (time.perf_counter() - begin) / count:.1f} ms a frame")
    print(f"{snapshot.root.node_count} nodes, {timeline.incomplete.count} messages not shown completely")
    timeline.close()


async def _seek(timeline: LogTimeline) -> None:
    numbers, seconds = random.Random(1), []
    for _ in range(SEEKS):
        begin = time.perf_counter()
        await timeline.snapshot_at(numbers.randint(*timeline.span))
        seconds.append(time.perf_counter() - begin)
    seconds.sort()
    print(f"seek to a random time: median {1e3 * statistics.median(seconds):.0f} ms, worst {1e3 * seconds[-1]:.0f} ms")


def main() -> None:
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gb", type=float, default=2.0)
    parser.add_argument("--kind", choices=("robots", "drake", "clouds"), default="robots")
    parser.add_argument("--log", type=Path)
    options = parser.parse_args()
    if options.log is None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "bench.lcmlog"
            write_log(path, {"robots": robots, "drake": drake, "clouds": clouds}[options.kind](), int(options.gb * 1e9))
            subprocess.run([sys.executable, "-m", "bench.logs", "--log", path], check=True)  # its memory is measured
        return
    configure()
    tune()
    begin, cpu = time.perf_counter(), time.process_time()
    timeline = open_log(options.log)
    print(f"headers read in {time.perf_counter() - begin:.2f} s ({time.process_time() - cpu:.2f} s of CPU)")
    asyncio.run(measure(timeline, begin))
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return_memory()
    now = int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()
    print(f"memory: {now / 1e6:.0f} MB, at most {most / 1e3:.0f} MB")


if __name__ == "__main__":
    main()
