"""Drake's visualizer channels against meldis: the time that one draw message takes.

    python -m bench.drakeviewer [--python PYTHON] [--links N] [--seconds S]

PYTHON is an interpreter with pydrake (default: SCENEGATE_DRAKE_PYTHON). Both viewers get the same LCM messages, as
bytes and without a network: a load message of N links with a box each, then draw messages in which every link moves.
Ours ends when the live tree is changed; meldis ends when its handlers have returned. Neither sends to a browser. The
rounds alternate, each S seconds; the figures are medians. Drake's default configuration publishes 64 draw messages a
second and family.
"""

from __future__ import annotations

import argparse
import base64
import math
import os
import statistics
import struct
import subprocess
import time
from pathlib import Path

from bench.table import Row, at_least, show, skipped
from gateway.assets.mesh_files import MeshFiles
from gateway.drakeviewer import wire
from gateway.drakeviewer.viewer import DRAW, LOAD, DrakeViewer
from gateway.scene.live import LiveTree

MESSAGES = 64
"""Number of different draw messages."""
ROUNDS = 3
RATE = 129
"""Draw messages per second of a simulation with illustration and proximity geometry."""
GOAL = 20.0
"""Minimum ratio to meldis."""


def _text(value: str) -> bytes:
    return struct.pack(">I", len(value) + 1) + value.encode() + b"\0"


def load_message(links: int) -> bytes:
    """Return a load message with one box per link."""
    box = struct.pack(">b11f", 1, 0, 0, 0, 1, 0, 0, 0, 0.9, 0.5, 0.1, 1.0) + _text("") + struct.pack(">i3f", 3, 1, 1, 1)
    each = (_text(name(index)) + struct.pack(">ii", 1, 1) + box for index in range(links))
    return wire.LOAD_ROBOT.to_bytes(8, "big") + struct.pack(">i", links) + b"".join(each)


def draw_message(links: int, step: int) -> bytes:
    """Return a draw message in which each link has another pose than in other steps."""
    phases = [0.1 * step + 0.05 * index for index in range(links)]
    return b"".join(
        (
            wire.DRAW.to_bytes(8, "big"),
            struct.pack(">qi", step, links),
            *(_text(name(index)) for index in range(links)),
            struct.pack(f">{links}i", *[1] * links),
            *(struct.pack(">3f", math.sin(phase), index, math.cos(phase)) for index, phase in enumerate(phases)),
            *(struct.pack(">4f", math.cos(phase), 0, 0, math.sin(phase)) for phase in phases),
        )
    )


def name(index: int) -> str:
    """Return the name of a link."""
    return f"plant::robot::link_{index}"


def ours(load: bytes, draws: list[bytes], seconds: float) -> list[float]:
    """Return milliseconds per draw message."""
    viewer = DrakeViewer(LiveTree(), MeshFiles(()))
    viewer.handle(LOAD, load)
    times: list[float] = []
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        message = draws[len(times) % len(draws)]
        begin = time.perf_counter()
        reason = viewer.handle(DRAW, message)
        times.append(1000.0 * (time.perf_counter() - begin))
        assert not reason, reason
    return times[1:]


def meldis(python: str, load: bytes, draws: list[bytes], seconds: float) -> list[float]:
    """Return milliseconds per draw message of meldis, in a process of its own."""
    lines = "\n".join(base64.b64encode(message).decode() for message in (load, *draws))
    script = Path(__file__).with_name("drakeviewer_peer.py")
    done = subprocess.run([python, str(script), str(seconds)], input=lines, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"meldis failed:\n{done.stderr}")
    return [float(value) for value in done.stdout.split()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", default=os.environ.get("SCENEGATE_DRAKE_PYTHON", ""))
    parser.add_argument("--links", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=3.0)
    options = parser.parse_args()
    load, draws = load_message(options.links), [draw_message(options.links, step) for step in range(MESSAGES)]
    our_times: list[float] = []
    their_times: list[float] = []
    for _ in range(ROUNDS):
        our_times += ours(load, draws, options.seconds)
        if options.python:
            their_times += meldis(options.python, load, draws, options.seconds)
    what = f"Drake's draw message of {options.links} links, ms"
    our_time = statistics.median(our_times)
    rows: list[Row] = []
    if their_times:
        their_time = statistics.median(their_times)
        rows.append(at_least(what, f"{our_time:.3f}", f"meldis {their_time:.3f}", their_time / our_time, GOAL))
    else:
        rows.append(skipped(what, "no interpreter with pydrake (--python)"))
    rows.append(Row(f"the same at {RATE} messages/s: share of one core", f"{0.1 * RATE * our_time:.2g} %"))
    show(rows)
    print(f"\n{len(our_times)} messages; p99 {statistics.quantiles(our_times, n=100)[98]:.3f} ms")


if __name__ == "__main__":
    main()
