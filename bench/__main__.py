"""Every bench, one table: ``python -m bench [--peers PYTHON] [--quick] [--write FILE] [NAME ...]``.

Each bench runs as a command of its own, shortly; its rows (``bench/table.py``) go into the one table, all that it
prints into a section below. PYTHON is an interpreter with vtk, viser, meshcat (and pydrake, where it is at hand);
without it, what needs it is skipped and says so.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from bench.table import HEAD, Row, at_least, skipped

PLOT = "docs/images/memory.svg"


@dataclass(frozen=True, slots=True)
class Bench:
    """How one is run here, and how rows are made of what it prints beyond its own rows."""

    arguments: tuple[str, ...] = ()
    quick: tuple[str, ...] = ()
    """More arguments for a run that shows whether everything works; its figures are poor."""
    peers: bool = False
    """Whether it takes ``--peers``."""
    rows: Callable[[str], list[Row]] = lambda _: []


def stream_rows(text: str) -> list[Row]:
    """Of the live camera's lines: name, clients, sets/s, MB/s, CPU, ms/set ..."""
    rows = []
    for rate, clients, sets, cpu in re.findall(r"live \S+ \S+ (max|device) +(\d+) +([\d.]+) +\d+ +([\d.]+)", text):
        what = f"stereo stream, {clients} clients, rate {rate}: sets per second and client (server {cpu} cores)"
        per_client = float(sets) / int(clients)
        goal = per_client >= 24.5 if rate == "max" else None
        rows.append(Row(what, f"{per_client:.1f} Hz", "", "", "≥ 25 Hz" if rate == "max" else "", goal))
    return rows


def tree_rows(text: str) -> list[Row]:
    """Of lines such as ``ratio meshcat / ours, udp, 1 transform: 31.2``."""
    found = re.findall(r"ratio (\S+) / ([^:]+): ([\d.]+)$", text, re.MULTILINE)
    return [Row(f"tree viewer, {what}", "", peer, f"{ratio}×") for peer, what, ratio in found]


def viewer_rows(text: str) -> list[Row]:
    """Of lines such as ``ours against viser: 2.1 x the rate, 12 x less CPU per update``."""
    rows, clients = [], "1"
    for line in text.splitlines():
        if found := re.match(r"ours +(\d+) clients", line):
            clients = found[1]
        if found := re.search(r"ours against (\w+): ([\d.]+) x the rate, (\d+) x less CPU", line):
            what = f"browser view, 1000 moving nodes, {clients} clients: CPU per update ({found[2]}× the rate)"
            rows.append(at_least(what, "", found[1], float(found[3]), 1.0))
    return rows


BENCHES = {
    "raster": Bench(quick=("--frames", "5"), peers=True),
    "stores": Bench(),
    "render": Bench(quick=("--frames", "5"), peers=True),
    "codecs": Bench(),
    "concurrency": Bench(),
    "startup": Bench(("--cold", "--scenes", "10000", "--plot", PLOT), quick=("--scenes", "1000", "--plot", os.devnull)),
    "stream": Bench(("--live", "--clients", "1", "4", "--seconds", "4"), rows=stream_rows),
    "treeviewer": Bench(("--seconds", "1"), peers=True, rows=tree_rows),
    "viewer": Bench(("--clients", "1,10", "--seconds", "4"), peers=True, rows=viewer_rows),
}


def machine() -> str:
    """What the figures were measured on."""
    cpu = platform.processor() or platform.machine()
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        cpu = next((line.partition(": ")[2] for line in lines if line.startswith("model name")), cpu)
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / (1 << 30)
    packages = ", ".join(f"{name} {version(name)}" for name in ("numba", "numpy", "opencv-python-headless", "isal"))
    cores, load = len(os.sched_getaffinity(0)), os.getloadavg()[1]
    busy = (
        f" **The machine was busy** (load average {load:.0f}): wall-clock figures are poor." if load > 2 * cores else ""
    )
    return (
        f"{cores} × {cpu}, {memory:.0f} GiB; {platform.system()} {platform.machine()}, "
        f"Python {platform.python_version()}, {packages}.{busy}"
    )


def run(name: str, bench: Bench, peers: str | None, quick: bool) -> tuple[str, list[Row], str]:
    """The command line, its rows, and all else that it printed."""
    command = ["-m", f"bench.{name}", *bench.arguments, *(["--peers", peers] if bench.peers and peers else [])]
    command += bench.quick if quick else ()
    shown = f"python {' '.join(command)}"
    print(f"$ {shown.replace(peers, 'PYTHON') if peers else shown}", flush=True)
    done = subprocess.run([sys.executable, *command], capture_output=True, text=True)
    before, _, after = done.stdout.partition(HEAD)
    lines = [line for line in after.splitlines()[2:] if line.startswith("|")]
    rows = [_parsed(line) for line in lines] + bench.rows(done.stdout)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [""])[-1][:200]
        rows.append(skipped(f"{name}", f"it ended with {done.returncode}: {last}"))
    return shown.replace(peers, "PYTHON") if peers else shown, rows, before.strip("\n")


def _parsed(line: str) -> Row:
    what, ours, peer, ratio, goal, met = (cell.strip() for cell in line.strip("|").split("|"))
    return Row(what, ours, peer, ratio, goal, {"yes": True, "**no**": False}.get(met))


def document(results: list[tuple[str, str, list[Row], str]]) -> str:
    """docs/performance.md."""
    head = Path(__file__).with_name("performance.md").read_text(encoding="utf-8")
    table = "\n".join(
        [HEAD, "|---|---|---|---|---|---|", *(row.markdown() for _, _, rows, _ in results for row in rows)]
    )
    sections = []
    for name, command, _, details in results:
        text = details if details.lstrip().startswith("|") else f"```\n{details}\n```"
        plot = f"\n\n![Memory through different scenes]({PLOT.removeprefix('docs/')})" if name == "startup" else ""
        sections.append(f"### {name}\n\n`{command}`\n\n{text}{plot}")
    filled = head.replace("{machine}", machine()).replace("{table}", table).replace("{details}", "\n\n".join(sections))
    return filled.rstrip() + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[[], *BENCHES], help="default: all")
    parser.add_argument("--peers", help="a Python that has vtk, viser and meshcat")
    parser.add_argument("--quick", action="store_true", help="few frames: whether everything works")
    parser.add_argument("--write", type=Path, help="docs/performance.md")
    options = parser.parse_args()
    results: list[tuple[str, str, list[Row], str]] = []
    for name in options.names or BENCHES:
        results.append((name, *run(name, BENCHES[name], options.peers, options.quick)))
        if options.write:  # after each: all of them take a while
            options.write.write_text(document(results), encoding="utf-8")
    print(f"\n{HEAD}\n|---|---|---|---|---|---|")
    for _, _, rows, _ in results:
        for row in rows:
            print(row.markdown())


if __name__ == "__main__":
    main()
