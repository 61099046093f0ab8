"""Run all benches and print one table: ``python -m bench [--peers PYTHON] [--quick] [--write FILE] [NAME ...]``.

Run each bench as a command of its own (about twelve minutes in all on two quiet cores). Its rows
(``bench/table.py``) go into one table, its other output into a section below. A bench that fails, takes too long or
lacks its peer becomes a row with the reason. PYTHON is an interpreter with vtk, panda3d, viser and meshcat; benches
that need it are skipped without it.
"""

import argparse
import json
import os
import platform
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from bench.running import run
from bench.table import HEAD, Row, skipped

PLOT = "docs/images/memory.svg"
LIMIT = 900.0
"""Time limit of one bench in seconds: several times its duration on a quiet machine."""
PEERS = ("vtk", "panda3d", "viser", "meshcat")
_DOCUMENT = """\
# Results of `make bench`

The last whole run, of commit {commit}; `docs/performance.md` has the figures that matter to users, and newer ones.
`make bench` writes this file.

Measured on: {machine}

## Goals

{table}

## Details

{details}"""
_VERSIONS = """
import json, importlib.metadata as m
found = {}
for name in %r:
    try: found[name] = m.version(name)
    except m.PackageNotFoundError: pass
print(json.dumps(found))
"""


@dataclass(frozen=True, slots=True)
class Bench:
    """A bench: its command-line arguments."""

    arguments: tuple[str, ...] = ()
    quick: tuple[str, ...] = ()
    """Arguments that shorten the run to a smoke test; its figures are poor."""
    peers: tuple[str, ...] = ()
    """Packages that the interpreter of ``--peers`` needs."""


@dataclass(frozen=True, slots=True)
class Result:
    """Output of one bench."""

    name: str
    command: str
    rows: list[Row]
    details: str


BENCHES = {
    "raster": Bench(quick=("--frames", "5"), peers=("vtk", "panda3d")),
    "shading": Bench(quick=("--frames", "3"), peers=("vtk",)),
    "render": Bench(quick=("--frames", "3"), peers=("vtk",)),
    "codecs": Bench(),
    "event_loop": Bench(),
    "drakeviewer": Bench(quick=("--seconds", "0.5")),
    "startup": Bench(
        ("--cold", "--scenes", "10000", "--plot", PLOT),
        quick=("--starts", "1", "--scenes", "100", "--plot", os.devnull),
    ),
    "stream": Bench(quick=("--seconds", "1", "--qualities", "High", "--clients", "1")),
    "treeviewer": Bench(("--seconds", "1"), peers=("viser", "meshcat")),
    "treeviewer_binary": Bench(("--seconds", "2"), peers=("meshcat",)),
    "viewer": Bench(("--clients", "1,10", "--seconds", "4"), peers=("viser", "meshcat")),
}


def peers_in(python: str | None) -> tuple[dict[str, str], str]:
    """Return the versions of the peers that an interpreter has, and the reason if it has none."""
    if python is None:
        return {}, "no --peers"
    try:
        done = subprocess.run([python, "-c", _VERSIONS % (PEERS,)], capture_output=True, text=True, timeout=60)
        return json.loads(done.stdout), ""
    except (OSError, ValueError, subprocess.TimeoutExpired) as error:
        return {}, f"--peers cannot be run: {type(error).__name__}"


def machine(peers: dict[str, str], load: float) -> str:
    """Describe the machine and the package versions; ``load``: the load average before the run."""
    cpu = platform.processor() or platform.machine()
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        cpu = next((line.partition(": ")[2] for line in lines if line.startswith("model name")), cpu)
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / (1 << 30)
    ours = ("numba", "numpy", "opencv-python-headless", "isal", "trimesh", "moderngl")
    packages = ", ".join(f"{name} {number}" for name, number in ({n: version(n) for n in ours} | peers).items())
    cores = len(os.sched_getaffinity(0))
    busy = " **The machine was busy with other work**: wall-clock figures are poor." if load > 0.5 * cores else ""
    return (
        f"{cores} × {cpu}, {memory:.0f} GiB; {platform.system()} {platform.machine()}, Python "
        f"{platform.python_version()}, {packages}. Load average before: {load:.1f}.{busy}"
    )


def measured(name: str, python: str | None, found: dict[str, str], reason: str, quick: bool) -> Result:
    """Run one bench and return its rows and output."""
    bench = BENCHES[name]
    missing = [peer for peer in bench.peers if peer not in found]
    command = ["-m", f"bench.{name}", *bench.arguments, *(bench.quick if quick else ())]
    shown = f"python {' '.join(command)}"
    if python and bench.peers and not missing:
        command += ["--peers", python]
        shown += " --peers PYTHON"
    print(f"$ {shown}", flush=True)
    ran = run(command, LIMIT)
    before, _, _ = ran.output.partition(HEAD)
    rows = rows_in(ran.output)
    if missing:
        why = reason or f"the interpreter of --peers has no {', '.join(missing)}"
        rows.append(skipped(f"{name} against {', '.join(bench.peers)}", why))
    if ran.failure:
        rows.append(skipped(name, ran.failure))
    for row in rows:
        print(row.markdown())
    print(f"({ran.seconds:.0f} s)\n", flush=True)
    return Result(name, shown, rows, before.strip("\n"))


def rows_in(output: str) -> list[Row]:
    """Return the rows of the table at the end of a bench's output; none if it has no table."""
    _, _, table_rows = output.partition(HEAD)
    return [_parsed(line) for line in table_rows.splitlines() if line.startswith("|")]


def _parsed(line: str) -> Row:
    what, ours, peer, ratio, goal, met = (cell.strip() for cell in line.strip("|").split("|"))
    return Row(what, ours, peer, ratio, goal, {"yes": True, "**no**": False}.get(met))


def table(results: list[Result]) -> str:
    """Return the rows of all benches as one Markdown table."""
    lines = [row.markdown() for result in results for row in result.rows]
    return "\n".join([HEAD, *lines])


def document(results: list[Result], where: str) -> str:
    """Return the text of bench/results.md."""
    sections = []
    for result in results:
        details = result.details or "Nothing beyond its rows above."
        text = details if details.lstrip().startswith(("|", "Nothing")) else f"```\n{details}\n```"
        plot = f"\n\n![Memory through different scenes](../{PLOT})" if result.name == "startup" else ""
        sections.append(f"### {result.name}\n\n`{result.command}`\n\n{text}{plot}\n")
    described = subprocess.run(("git", "describe", "--always", "--dirty"), capture_output=True, text=True, check=False)
    commit = described.stdout.strip() or "unknown"
    return _DOCUMENT.format(commit=commit, machine=where, table=table(results), details="\n".join(sections))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[[], *BENCHES], help="default: all")
    parser.add_argument("--peers", help="a Python that has vtk, panda3d, viser and meshcat")
    parser.add_argument("--quick", action="store_true", help="few frames: whether everything works")
    parser.add_argument("--write", type=Path, help="bench/results.md, when all have been run")
    options = parser.parse_args()
    if options.write and options.names:
        parser.error("--write is for all benches: a page of some of them would pass for the whole")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    load, begin = os.getloadavg()[0], time.perf_counter()
    found, reason = peers_in(options.peers)
    print("Kernels are compiled into the cache, where they are not.", flush=True)
    if failure := run(("-m", "scenegate", "warmup"), LIMIT).failure:
        print(f"`scenegate warmup`: {failure}")
    results: list[Result] = []
    try:
        for name in options.names or BENCHES:
            result = measured(name, options.peers, found, reason, options.quick)
            results.append(result)
    except KeyboardInterrupt:
        print("\nInterrupted; the rows so far:")
    print(table(results))
    if len(results) < len(options.names or BENCHES):
        sys.exit(130)
    print(f"\n{(time.perf_counter() - begin) / 60:.0f} min")
    if options.write:
        part = options.write.with_suffix(".part")
        part.write_text(document(results, machine(found, load)), encoding="utf-8")
        part.replace(options.write)


if __name__ == "__main__":
    main()
