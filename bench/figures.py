"""Run the command beside each row of docs/performance.md's table, and print the row with the figures that it gives.

    python -m venv .venv-peers
    .venv-peers/bin/pip install vtk panda3d viser meshcat pyrender pillow opencv-python-headless
    python -m bench.figures --peers .venv-peers/bin/python [--write] [NAME ...]

NAME is part of a command, such as ``bench.raster``; default: all, ten minutes. ``--write`` puts the rows into the page.
"""

import argparse
import os
import re
import sys
from pathlib import Path

from bench.__main__ import LIMIT, machine, peers_in, rows_in
from bench.running import run
from bench.table import Row

PAGE = Path("docs/performance.md")
ROW = re.compile(r"^\| (?P<task>[^|]+) \|[^|]*\|[^|]*\| `(?P<command>bench\.[^|`]+)` \|$", re.MULTILINE)
MACHINE = "Measured on "
BEGINS = {
    "frame: colour": ("frame, 50k triangles, 640x480",),
    "frame, 1,000,000": ("frame, 1M triangles, 1280x960",),
    "`POST /render`": ("`/render` color, 640×480, over HTTP",),
    "the same, 25 MB": ("25 MB of textured meshes, color, poses changed, over HTTP",),
    "sample of a dataset": ("sample of a dataset, studio", "sample of a dataset, gltf"),
    "PNG": ("PNG, RGB writer",),
    "read glTF": ("glTF reader, requests of Drake's client, nothing known",),
    "1000 transforms": ("tree viewer, ours, udp: 1000 t",),
    "mesh of 100,000": ("tree viewer, binary, tcpq: mesh 100k",),
    "updates of 1000": ("1000 moving nodes in a page, 1 clients: moved",),
    "sets of the": ("demo at High, `ground_truth`", "demo at High, `matched`"),
    "start to ready": ("process start to ready, kernels cached, all", "first start, kernels compiled, to ready"),
}
"""How the rows of a bench begin, by the beginning of a task in the page."""
WITHOUT_PEERS = ("bench.codecs", "bench.stream", "bench.startup")


def row_of(task: str, command: str, rows: list[Row]) -> str:
    """Return a row of the page: without what the rows of the bench say in brackets and after semicolons."""
    begins = next(begins for start, begins in BEGINS.items() if task.startswith(start))
    names = [next((row.what for row in rows if row.what.startswith(begin)), "") for begin in begins]
    found = [row for name in names for row in rows if row.what == name and not row.peer.startswith("floor")]
    columns = [row.ours for row in found], [row.peer for row in found]
    ours, peers = (", ".join(dict.fromkeys(re.sub(r" \(.*?\)|;.*", "", c) for c in column if c)) for column in columns)
    return f"| {task} | {ours} | {peers} | `{command}` |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--peers", help="a Python that has the packages above")
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    found, _ = peers_in(options.peers)
    page, where = PAGE.read_text("utf-8"), machine(found, os.getloadavg()[0])
    ran: dict[str, list[Row]] = {}
    for match in ROW.finditer(page):
        command = match["command"]
        if options.names and not any(name in command for name in options.names):
            continue
        if command not in ran:
            peers = ["--peers", options.peers] if options.peers and not command.startswith(WITHOUT_PEERS) else []
            done = run(("-m", *command.split(), *peers), LIMIT)
            if done.failure:
                print(f"{command}: {done.failure}", file=sys.stderr)
            ran[command] = rows_in(done.output)
        if ran[command]:
            row = row_of(match["task"], command, ran[command])
            print(row, flush=True)
            page = page.replace(match[0], row)
    print(f"\n{MACHINE}{where}")
    if options.write:
        PAGE.write_text(re.sub(f"(?m)^{MACHINE}.*$", f"{MACHINE}{where}", page), "utf-8")


if __name__ == "__main__":
    main()
