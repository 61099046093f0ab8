"""Drake's visualizer channels against meldis: the CPU time that messages of each kind take.

    python -m bench.drakeviewer [--python PYTHON] [--seconds S] [--rounds N] [--only TEXT]

PYTHON is an interpreter with pydrake (default: SCENEGATE_NEW_DRAKE_PYTHON, else SCENEGATE_DRAKE_PYTHON). Both viewers
get the same LCM logs, without a network: first the messages of the setup, then those of a row again and again, for S
seconds in each round. Rounds of both alternate. The figures are medians of the rounds: milliseconds of the process's
CPU time per message. Ours ends when the live tree is changed; meldis ends when its handlers have returned and its
Meshcat has encoded everything for a browser. Neither has one.
"""

import argparse
import math
import os
import statistics
import subprocess
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.drakeviewer_peer import play, read_log
from bench.table import Row, at_least, show, skipped
from gateway.adapters.drakeviewer.viewer import DrakeViewer
from gateway.files.assets.mesh_files import MeshFiles
from gateway.scene.tree.live import LiveTree
from scenegate.lcm.event_log import pack_event
from tests.adapters.drakeviewer import encoding

LINKS = 100
STEPS = 16
"""Number of different messages of a row."""
SMALL_MS = 0.3
"""Goal for messages that are no clouds and no draws, if meldis is faster."""
LOAD, DRAW = "DRAKE_VIEWER_LOAD_ROBOT", "DRAKE_VIEWER_DRAW"
XYZ = [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)]

Messages = list[tuple[str, bytes]]
"""Channels and messages."""


@dataclass(frozen=True, slots=True)
class Case:
    """A row of the table."""

    what: str
    messages: Messages
    """Messages that are measured."""
    setup: Messages
    """Messages before them."""
    goal: float | None = None
    """Minimum ratio to meldis; None: that, or at most ``SMALL_MS``."""

    def write(self, folder: Path) -> Path:
        """Write the log: the events of the setup are at time 0."""
        path = folder / "bench.lcmlog"
        events = [(0, *message) for message in self.setup] + [(1, *message) for message in self.messages]
        path.write_bytes(b"".join(pack_event(number, *event) for number, event in enumerate(events)))
        return path


def cases() -> Iterable[Case]:
    """Yield all rows."""
    keys = [(1, f"plant::robot::link_{index}") for index in range(LINKS)]
    boxes = [encoding.link(name, 1, encoding.geometry(encoding.BOX, (1, 1, 1))) for _, name in keys]
    loaded = [(LOAD, encoding.load(*boxes)), (DRAW, poses(keys, 0))]
    draws = [(DRAW, poses(keys, step)) for step in range(STEPS)]
    yield Case(f"draw message of {LINKS} links", draws, loaded, 10.0)
    shown = [[(LOAD, encoding.load(*boxes[step:])), (DRAW, poses(keys[step:], 0))] for step in range(2)]
    yield Case(f"load message of {LINKS} boxes with the draw message that shows it, each", shown[0] + shown[1], [])
    for count in (10, 100):
        frames = [("DRAKE_DRAW_FRAMES", poses(keys[:count], step)) for step in range(STEPS)]
        yield Case(f"{count} frames", frames, loaded)
    for count in (10, 1000):
        yield Case(f"{count} point contacts", [contacts(count, step) for step in range(STEPS)], loaded)
    for size in (8, 50):
        yield Case(f"contact surface of {size * size} vertices", [surface(size, step) for step in range(STEPS)], loaded)
        yield Case(f"deformable mesh of {size * size} vertices", [cloth(size, step) for step in range(STEPS)], loaded)
    for count, goal in ((1000, None), (307_200, 1.0), (1_000_000, 1.0)):
        for colored in (False, True):
            clouds = [cloud(count, colored, step) for step in range(2 if count > 1000 else STEPS)]
            yield Case(f"cloud of {count:,} points, {'XYZRGB' if colored else 'XYZ'}", clouds, [], goal)


def poses(keys: list[tuple[int, str]], step: int) -> bytes:
    """Return a draw message in which each link has another pose than in other steps."""
    phases = [0.1 * step + 0.05 * index for index in range(len(keys))]
    rows = [(math.sin(p), index, math.cos(p), math.cos(p), 0, 0, math.sin(p)) for index, p in enumerate(phases)]
    return encoding.draw(dict(zip(keys, rows, strict=True)), step)


def contacts(count: int, step: int) -> tuple[str, bytes]:
    """Return point contacts of as many pairs of bodies."""
    points = [
        encoding.point_contact(f"link_{i}(2)", "world(0)", (0.01 * i, math.sin(step), 0), (math.cos(step), 1, 20 + i))
        for i in range(count)
    ]
    return "CONTACT_RESULTS", encoding.contacts(points)


def grid(size: int, step: int) -> np.ndarray:
    """Return the vertices of a moving square, (size², 3)."""
    x, y = np.meshgrid(np.linspace(0, 1, size), np.linspace(0, 1, size))
    return np.stack((x, y, 0.1 * np.sin(6 * x + step)), axis=-1).reshape(-1, 3)


def quads(size: int) -> np.ndarray:
    """Return the corners of its squares, (M, 4)."""
    first = (np.arange(size - 1)[:, None] * size + np.arange(size - 1)).ravel()
    return np.stack((first, first + 1, first + size + 1, first + size), axis=1)


def surface(size: int, step: int) -> tuple[str, bytes]:
    """Return a hydroelastic contact of quadrilaterals."""
    polygons = np.insert(quads(size), 0, 4, axis=1).ravel().tolist()
    pressure = np.linspace(0, 1e4, size * size).tolist()
    contact = encoding.surface_contact(vertices=grid(size, step), pressure=pressure, polygons=polygons)
    return "CONTACT_RESULTS", encoding.contacts((), [contact])


def cloth(size: int, step: int) -> tuple[str, bytes]:
    """Return a deformable body of triangles."""
    triangles = quads(size)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    numbers = [size * size, len(triangles), *grid(size, step).ravel(), *triangles.ravel()]
    return "DRAKE_VIEWER_DEFORMABLE", encoding.deformables(encoding.geometry(encoding.MESH, numbers, string="cloth"))


def cloud(count: int, colored: bool, step: int) -> tuple[str, bytes]:
    """Return a point cloud as Drake sends it."""
    fields = [*XYZ, ("rgb", 12, 6, 1)] if colored else XYZ
    points = np.random.default_rng(step).random((count, len(fields)), np.float32)
    points.view(np.uint32)[:, 3:] = np.arange(count)[:, None]
    return "DRAKE_POINT_CLOUD", encoding.cloud(points.tobytes(), count, fields, 4 * len(fields))


def ours(log: Path, seconds: float) -> float:
    """Return milliseconds of CPU time per message."""
    viewer = DrakeViewer(LiveTree(), MeshFiles(()))

    def handle(channel: str, message: bytes) -> None:
        reason = viewer.handle(channel, message)
        assert not reason, reason

    return play(handle, lambda: None, read_log(log), seconds)


def meldis(python: str, log: Path, seconds: float) -> float:
    """Return milliseconds of CPU time per message of meldis, in a process of its own."""
    script = Path(__file__).with_name("drakeviewer_peer.py")
    done = subprocess.run([python, script, log, str(seconds)], capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"meldis failed:\n{done.stderr}")
    return float(done.stdout.split()[-1])


def row(case: Case, folder: Path, python: str, seconds: float, rounds: int) -> Row:
    """Measure one row."""
    log = case.write(folder)
    our_times, their_times = [], []
    for _ in range(rounds):
        our_times.append(ours(log, seconds))
        their_times += [meldis(python, log, seconds)] if python else []
    our_time = statistics.median(our_times)
    if not their_times:
        return skipped(f"{case.what}: {our_time:.3f} ms", "no interpreter with pydrake (--python)")
    their_time = statistics.median(their_times)
    ratio, peer = their_time / our_time, f"meldis {their_time:.3f} ms"
    if case.goal is not None:
        return at_least(case.what, f"{our_time:.3f} ms", peer, ratio, case.goal)
    is_met = our_time <= SMALL_MS or ratio >= 1.0
    return Row(case.what, f"{our_time:.3f} ms", peer, f"{ratio:.1f}×", f"≥ 1×, or ≤ {SMALL_MS:g} ms", is_met)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    python = os.environ.get("SCENEGATE_NEW_DRAKE_PYTHON") or os.environ.get("SCENEGATE_DRAKE_PYTHON", "")
    parser.add_argument("--python", default=python)
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", default="", help="text in the names of the rows to measure")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        chosen = (case for case in cases() if options.only in case.what)
        show([row(case, Path(folder), options.python, options.seconds, options.rounds) for case in chosen])


if __name__ == "__main__":
    main()
