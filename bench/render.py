"""``/render`` against VTK behind HTTP: scenes with other poses in every request, in one run, interleaved.

    python -m venv .venv-vtk && .venv-vtk/bin/pip install vtk
    python -m bench.render --peers .venv-vtk/bin/python [--full] [--frames 20]

Both servers are processes of their own and get the same bytes; every request has poses that were never sent before.
``to first byte`` is from the last byte of a request to the first of its answer, the body having arrived before; ``over
HTTP`` is from connecting to the last byte of the answer, a new connection for each, as Drake's client has it. Medians.
``CPU`` is what the server's processes spent a request, which a busy machine disturbs less. Without ``--full`` only
640 x 480 is asked for. Then: four clients against one, and the most that the machine allows; a scene of 25 MB of
textured meshes, cold and warm with its stages. ``bench.request_cost`` has the cost of a request against the least.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from bench import render_requests
from bench.gateways import Answer, Gateway, gateway, post
from bench.load_clients import LoadResult, run_clients
from bench.table import Row, at_least, at_most, geometric_mean, show, skipped
from bench.viewer import cpu_of

SCENES = ("001", "003", "009", "010", "015")
SIZES = ((320, 240), (640, 480), (1920, 1080))
SETTLE = 0.02
"""Seconds in which a server deals with the body before its last bytes come."""
WARM = 3
FIRST_BYTE_GOALS = {"color": 8.0, "depth": 10.0, "label": 10.0}
HTTP_GOAL = 5.0
BIG_GOALS = {"color": 120.0, "depth": 60.0, "label": 60.0}
"""Milliseconds."""
CLIENTS_GOAL = 1.8
PROCESSORS = len(os.sched_getaffinity(0))


class PeerError(Exception):
    """A peer did not start."""


@dataclass
class Server:
    """A port, and the process behind it."""

    port: int
    pid: int
    first: list[float] = field(default_factory=list)
    total: list[float] = field(default_factory=list)
    stages: list[dict[str, float]] = field(default_factory=list)
    cpu: float = 0.0

    def forget(self) -> None:
        self.first, self.total, self.stages = [], [], []
        self.cpu = cpu_of(self.pid)

    def ask(self, body: bytes, *, whole: bool) -> Answer:
        """One request; ``whole``: timed over HTTP, else to its first byte."""
        answer = post(self.port, body, pause=0.0 if whole else SETTLE)
        if answer.status != 200:
            raise SystemExit(f"status {answer.status}: {answer.body[:300]!r}")
        if whole:
            self.total.append(answer.total)
        else:
            self.first.append(answer.first)
            self.stages.append(answer.stages)
        return answer

    def spent(self) -> float:
        """CPU ms a request since ``forget``."""
        return 1e3 * (cpu_of(self.pid) - self.cpu) / max(1, len(self.first) + len(self.total))

    def split(self) -> str:
        """Medians of the stages."""
        names = self.stages[0]
        return " + ".join(f"{name} {statistics.median(s[name] for s in self.stages):.1f}" for name in names)


@contextmanager
def vtk_server(python: str) -> Iterator[Server]:
    command = (python, str(Path(__file__).with_name("render_peer.py")))
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        if not line:
            raise PeerError(f"{Path(python).name} cannot run VTK's server (is vtk installed there?)")
        yield Server(int(line), process.pid)
    finally:
        process.kill()
        process.wait()


def differing(ours: bytes, theirs: bytes) -> float:
    """Part of a label picture's pixels that are not the same."""
    a, b = (np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)) for data in (ours, theirs))
    return float((a != b).any(axis=2).mean())


def compare(ours: Server, vtk: Server | None, sizes: tuple[tuple[int, int], ...], frames: int) -> list[Row]:
    """Every scene, size and type."""
    servers = [server for server in (ours, vtk) if server is not None]
    first: dict[str, list[tuple[float, float]]] = {}
    whole: dict[str, list[tuple[float, float]]] = {}
    work: dict[str, list[float]] = {}
    names = " / ".join(("ours", "VTK")[: len(servers)])
    print(f"| ms ({names}) | to first byte | ratio | CPU | over HTTP | ratio | stages of ours | stages of VTK |")
    print("|---|---|---|---|---|---|---|---|")
    for kind in render_requests.KINDS:
        for scene in render_requests.scenes(kind, SCENES):
            for width, height in sizes:
                answers = []
                for frame in range(2 * (frames + WARM)):
                    if frame == 2 * WARM:
                        for server in servers:
                            server.forget()
                    body = scene.next_body(width, height)
                    answers = [server.ask(body, whole=frame % 2 == 1) for server in servers]
                spent = [server.spent() for server in servers]
                to_first = [statistics.median(server.first) for server in servers]
                total = [statistics.median(server.total) for server in servers]
                if vtk is not None and (width, height) == (640, 480):
                    first.setdefault(kind, []).append((to_first[0], to_first[1]))
                    whole.setdefault(kind, []).append((total[0], total[1]))
                    work.setdefault(kind, []).append(spent[1] / max(spent[0], 0.1))
                note = ""
                if kind == "label" and vtk is not None:
                    note = f" ({100 * differing(answers[0].body, answers[1].body):.2g} % of pixels differ)"
                a, b, c = (" / ".join(f"{value:.1f}" for value in values) for values in (to_first, spent, total))
                x, y = (f"{v[1] / v[0]:.1f}" if vtk is not None else "" for v in (to_first, total))
                stages = " | ".join(server.split() for server in servers)
                cells = f"{a} | {x} | {b} | {c} | {y} | {stages}"
                print(f"| {scene.name} {kind} {width}×{height}{note} | {cells} |", flush=True)
    if vtk is None:
        return [skipped("`/render` against VTK", "no --peers")]
    rows = []
    for kind in render_requests.KINDS:
        what = f"`/render` {kind}, 640×480, last byte in to first byte out: geometric mean of {len(first[kind])} scenes"
        by_cpu = f"; by CPU time {geometric_mean(work[kind]):.1f}×"
        rows.append(_against_vtk(what, first[kind], FIRST_BYTE_GOALS[kind], by_cpu))
    for kind in render_requests.KINDS:
        what = f"`/render` {kind}, 640×480, over HTTP, new connection each: geometric mean"
        rows.append(_against_vtk(what, whole[kind], HTTP_GOAL))
    return rows


def _against_vtk(what: str, times: list[tuple[float, float]], goal: float, note: str = "") -> Row:
    """Geometric means of ours and VTK's, ms."""
    ratios = [theirs / ours for ours, theirs in times]
    ours, theirs = (geometric_mean(column) for column in zip(*times, strict=True))
    cell = f"{ours:.1f} ms (least {min(ratios):.1f}×{note})"
    return at_least(what, cell, f"VTK {theirs:.0f} ms", geometric_mean(ratios), goal)


@dataclass
class Turns:
    """One and four clients, in turns."""

    one: list[LoadResult] = field(default_factory=list)
    four: list[LoadResult] = field(default_factory=list)

    @classmethod
    def of(cls, port: int, pid: int, scene: render_requests.RenderScene, requests: int, turns: int = 5) -> Turns:
        """The first turn warms the caches."""
        found = cls()
        for _ in range(turns + 1):
            for clients, seen in ((1, found.one), (4, found.four)):
                seen.append(run_clients(port, pid, [scene.next_body(640, 480) for _ in range(requests)], clients))
        del found.one[0], found.four[0]
        return found

    def medians(self, what: Callable[[LoadResult], float]) -> tuple[float, float]:
        """With one client and with four."""
        return statistics.median(map(what, self.one)), statistics.median(map(what, self.four))

    @property
    def gain(self) -> float:
        """Four clients' throughput against one's."""
        one, four = self.medians(lambda seen: seen.rate)
        return four / one

    @property
    def bound(self) -> float:
        """The most that ``gain`` can be: one client leaves no more of the processors idle."""
        return PROCESSORS / statistics.median(seen.busy for seen in self.one)

    @property
    def others(self) -> float:
        """Processors that other programs used meanwhile."""
        return statistics.median(seen.others for seen in self.one + self.four)

    def cells(self) -> str:
        """For the table."""
        one, four = self.medians(lambda seen: seen.rate)
        busy = " | ".join(f"{value:.2f}" for value in self.medians(lambda seen: seen.busy))
        cpu = [*self.medians(lambda seen: seen.server_ms), *self.medians(lambda seen: seen.loop_ms)]
        cpu += self.medians(lambda seen: seen.client_ms)
        work = " | ".join(f"{ms:.1f}" for ms in cpu)
        return f"{one:.0f} | {four:.0f} | {self.gain:.2f} | {self.bound:.2f} | {busy} | {self.others:.2f} | {work}"


TURNS_HEAD = (
    "one client | four | ratio | at most | processors in use, one | four | by others "
    "| server's CPU ms a request, one | four | of it the event loop's, one | four | clients', one | four |"
)


def four_clients(ours: Server, vtk: Server | None, frames: int) -> list[Row]:
    """Four clients' throughput against one's, in turns."""
    print(f"\n| requests/s, 640×480 | {TURNS_HEAD} VTK, one | four |\n|{'---|' * 16}")
    found: list[Turns] = []
    for kind in render_requests.KINDS:
        for scene in render_requests.scenes(kind, ("001", "010")):
            found.append(Turns.of(ours.port, ours.pid, scene, 2 * frames))
            theirs = ["", ""]
            if vtk is not None:
                bodies = [scene.next_body(640, 480) for _ in range(8)]
                theirs = [f"{run_clients(vtk.port, vtk.pid, bodies, clients).rate:.1f}" for clients in (1, 4)]
            print(f"| {scene.name} {kind} | {found[-1].cells()} | {' | '.join(theirs)} |", flush=True)
    loops = [max(0.001, turns.medians(lambda seen: seen.loop_ms)[1]) for turns in found]
    what = "`/render` with four clients, the event loop's CPU time a request (geometric mean)"
    loop = Row(what, f"{geometric_mean(loops):.2f} ms (most {max(loops):.2f})")
    return [*gained(found), loop]


def gained(found: list[Turns]) -> list[Row]:
    """The ratio, and what the machine allows."""
    ratio = geometric_mean([turns.gain for turns in found])
    bound = geometric_mean([turns.bound for turns in found])
    one, four = (geometric_mean([turns.medians(lambda seen: seen.busy)[which] for turns in found]) for which in (0, 1))
    others = statistics.median(turns.others for turns in found)
    what = f"one client keeps {one:.2f} of {PROCESSORS} processors busy, four {four:.2f}, other programs {others:.2f}"
    least = f"least {min(turns.gain for turns in found):.2f}×"
    return [
        at_least("`/render`, four clients' throughput against one's (geometric mean)", least, "", ratio, CLIENTS_GOAL),
        Row(f"… the most that the machine allows: {what}", "", "one client", f"{bound:.2f}×"),
        Row("… of which is reached", "", "", f"{ratio / bound:.0%}"),
    ]


def big(vtk: Server | None, frames: int) -> list[Row]:
    """The scene of 25 MB, on a gateway that has never seen it."""
    rows: list[Row] = []
    for kind in render_requests.KINDS:
        scene = render_requests.textured(kind)
        if not rows:
            size = len(scene.next_body(640, 480)) / 1e6
            print(f"\n| {size:.1f} MB of textured meshes, 640×480 | to first byte, ms | over HTTP, ms ", end="")
            print("| server's CPU ms a request | stages |\n|---|---|---|---|---|")
        with gateway("--only", "render") as running:
            ours = Server(running.port, running.process.pid)
            for server in [ours, vtk] if vtk is not None else [ours]:
                name = "ours" if server is ours else "VTK"
                server.forget()
                first = post(server.port, scene.next_body(640, 480), pause=0.5)
                stages = " + ".join(f"{stage} {ms:.1f}" for stage, ms in first.stages.items())
                cells = f"{first.first:.0f} | {first.total - 500:.0f} | {server.spent():.0f} | {stages}"
                print(f"| {name}, {kind}, cold | {cells} |", flush=True)
                if server is ours:  # a text is kept when it comes for the second time
                    server.ask(scene.next_body(640, 480), whole=True)
                    server.ask(scene.next_body(640, 480), whole=True)
                server.forget()
                for _ in range(frames if server is ours else 1):  # VTK reads all of it again, for seconds
                    answer = post(server.port, scene.next_body(640, 480), pause=0.15)
                    server.first.append(answer.first)
                    server.stages.append(answer.stages)
                    server.ask(scene.next_body(640, 480), whole=True)
                took, over = statistics.median(server.first), statistics.median(server.total)
                cells = f"{took:.1f} | {over:.1f} | {server.spent():.1f} | {server.split()}"
                print(f"| {name}, {kind}, poses changed | {cells} |", flush=True)
            took = statistics.median(ours.total)
            theirs = f"VTK {statistics.median(vtk.total):.0f} ms" if vtk is not None else ""
            what = f"25 MB of textured meshes, {kind}, poses changed, over HTTP"
            rows.append(at_most(what, took, BIG_GOALS[kind], "ms", theirs))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers", help="a Python that has vtk; without it only ours is measured")
    parser.add_argument("--full", action="store_true", help="three sizes instead of 640 x 480")
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--only", default="compare,clients,big", help="parts, with commas between")
    options = parser.parse_args()
    rows: list[Row] = []
    with gateway("--only", "render") as running:
        parts = options.only.split(",")
        with ExitStack() as stack:
            vtk = None
            try:
                vtk = stack.enter_context(vtk_server(options.peers)) if options.peers else None
            except (OSError, PeerError) as error:
                rows.append(skipped("VTK", str(error)))
            rows += measure(parts, running, vtk, options.full, options.frames)
    show(rows)


def measure(parts: list[str], running: Gateway, vtk: Server | None, full: bool, frames: int) -> list[Row]:
    """The parts of the bench that were asked for."""
    ours = Server(running.port, running.process.pid)
    sizes = SIZES if full else ((640, 480),)
    all_parts: dict[str, Callable[[], list[Row]]] = {
        "compare": lambda: compare(ours, vtk, sizes, frames),
        "clients": lambda: four_clients(ours, vtk, frames),
        "big": lambda: big(vtk, frames),
    }
    return [row for part in parts for row in all_parts[part]()]


if __name__ == "__main__":
    main()
