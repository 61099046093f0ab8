"""The browser view against viser and meshcat-python: 1000 nodes that all move 60 times a second, 100 000 points.

    python -m venv .venv-viewers && .venv-viewers/bin/pip install viser meshcat
    python -m bench.viewer --peers .venv-viewers/bin/python

Every program is a process of its own, the publisher inside it, as its users have it; the clients are one further
process, which takes everything in and draws nothing. Measured over the same seconds: how often the scene was moved, how
many updates the slowest client got, and the CPU time of the server with all its children. The peers' clients cannot
fall behind as ours can (they have no credit), so their servers also pay for what a browser could not draw.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.running import end, tree_of
from bench.table import Row, at_least, show, skipped

HERE = Path(__file__).parent


@dataclass(frozen=True, slots=True)
class Result:
    """One program at one number of clients."""

    program: str
    clients: int
    moved: float
    """Ticks per second of the publisher."""
    slowest: float
    """Updates per second that the slowest client got."""
    cores: float
    """CPU seconds per second of the server."""

    def line(self) -> str:
        return (
            f"{self.program:8} {self.clients:3} clients: moved {self.moved:5.1f} Hz, "
            f"slowest client {self.slowest:5.1f} Hz, {100 * self.cores:5.1f} % of a core"
        )


class Helper:
    """A process that answers each line with a line."""

    def __init__(self, *command: str) -> None:
        environment = {**os.environ, "PYTHONPATH": str(HERE.parent)}
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )

    def read(self) -> Any:
        """The next line of JSON; other lines are what libraries print."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            try:
                return json.loads(line)
            except ValueError:
                continue
        raise SystemExit(f"{self.process.args!r} ended with {self.process.wait()}")

    def ask(self) -> Any:
        assert self.process.stdin is not None
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        return self.read()

    def close(self) -> None:
        end(self.process)


def cpu_of(pid: int) -> float:
    """CPU seconds of a process and all below it."""
    ticks = 0
    for each in tree_of(pid):
        fields = Path(f"/proc/{each}/stat").read_text().rsplit(")", 1)[1].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def measure(program: str, python: str, clients: int, seconds: float) -> Result:
    """Starts a program and its clients, lets them settle, measures, ends them."""
    server = Helper(python, str(HERE / "viewer_servers.py"), program)
    try:
        where = server.read()
        command = (str(HERE / "viewer_clients.py"), where["url"], str(clients), program, where.get("subprotocol", ""))
        helper = Helper(python if program == "viser" else sys.executable, *command)
        try:
            settle = time.monotonic() + 60.0
            while min(helper.ask()) < 2 and time.monotonic() < settle:
                time.sleep(0.2)
            time.sleep(1.0)
            begin, cpu, ticks, got = time.perf_counter(), cpu_of(server.process.pid), server.ask(), helper.ask()
            time.sleep(seconds)
            end, cpu2, ticks2, got2 = time.perf_counter(), cpu_of(server.process.pid), server.ask(), helper.ask()
        finally:
            helper.close()
    finally:
        server.close()
    took = end - begin
    slowest = min(after - before for before, after in zip(got, got2, strict=True)) / took
    return Result(program, clients, (ticks2 - ticks) / took, slowest, (cpu2 - cpu) / took)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers", help="a Python that has viser and meshcat; without it only ours is measured")
    parser.add_argument("--clients", default="1,10,40")
    parser.add_argument("--seconds", type=float, default=8.0)
    options = parser.parse_args()
    programs = [("ours", sys.executable)]
    if options.peers:
        programs += [("viser", options.peers), ("meshcat", options.peers)]
    rows: list[Row] = []
    for clients in map(int, options.clients.split(",")):
        results = []
        for program, python in programs:
            try:
                results.append(measure(program, python, clients, options.seconds))
            except SystemExit as error:
                if program == "ours":
                    raise
                rows.append(skipped(f"1000 moving nodes in a page: {program}", str(error)))
                continue
            print(results[-1].line(), flush=True)
        first = results[0]
        what = f"1000 moving nodes in a page, {clients} clients"
        for other in results[1:]:
            rows.append(Row(f"{what}: moved", f"{first.moved:.0f} Hz", f"{other.program} {other.moved:.0f} Hz"))
            if other.slowest > 0:
                work = (other.cores / other.slowest) / (first.cores / max(first.slowest, 1e-9))
                rows.append(at_least(f"{what}: CPU per update", "", other.program, work, 1.0))
    show(rows)


if __name__ == "__main__":
    main()
