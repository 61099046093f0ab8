"""From process start to ready, with the kernel cache and without, and memory through many different scenes.

    python -m bench.startup [--scenes 10000] [--plot docs/images/memory.svg] [--cold]

``ready`` is when ``scenegate serve`` has started every interface. Modules have their byte code, as pip and the image
install them, whatever PYTHONDONTWRITEBYTECODE says here: compiling 1500 modules takes longer than all else. ``--cold``
measures with an empty cache, too: how much CPU time the children spend that fill it, and how much the serving process
itself. The scenes differ in everything: each has a mesh that was never sent before, about 100 kB as a request; the
caches are made small, so that they are full soon.
"""

import argparse
import json
import os
import statistics
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bench import render_requests
from bench.gateways import gateway, post
from bench.table import Row, at_most, show

STARTS = 7
CACHE_BYTES = 32 << 20


def cpu_seconds(pid: int) -> tuple[float, float]:
    """Return the CPU time of a process and of its children that have ended, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    own, children = sum(map(int, fields[11:13])), sum(map(int, fields[13:15]))
    return own / os.sysconf("SC_CLK_TCK"), children / os.sysconf("SC_CLK_TCK")


def all_starts(starts: int, *, cold: bool) -> list[Row]:
    """Measure starts with kernels in the cache, all interfaces and ``--only render``; with ``cold`` also without."""
    with tempfile.TemporaryDirectory() as folder:
        installed = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": folder}
        for flags in ((), ("--only", "render")):
            with gateway(*flags, environment=installed):
                pass  # fills the caches if need be
        rows = _warm_starts(starts, installed)
        return rows + _cold_start(installed) if cold else rows


def _warm_starts(starts: int, environment: dict[str, str]) -> list[Row]:
    rows = []
    for name, flags in (("all interfaces", ()), ("`--only render`", ("--only", "render"))):
        took: list[float] = []
        spent: list[float] = []
        for _ in range(starts):
            with gateway(*flags, environment=environment) as running:
                took.append(running.started - running.began)
                spent.append(cpu_seconds(running.process.pid)[0])
        what = f"process start to ready, kernels cached, {name} (best {min(took):.2f} s)"
        rows.append(at_most(what, statistics.median(took), 2.0, "s"))
        what = f"its CPU time, which other programs disturb less, {name}"
        rows.append(at_most(what, statistics.median(spent), 2.0, "s CPU"))
    return rows


def _cold_start(environment: dict[str, str]) -> list[Row]:
    """Measure a start with an empty kernel cache."""
    with tempfile.TemporaryDirectory() as folder:
        inherited = os.environ.pop("NUMBA_CACHE_DIR", None)
        try:
            with gateway(environment={**environment, "SCENEGATE_CACHE_DIR": folder}) as running:
                took = running.started - running.began
                own, children = cpu_seconds(running.process.pid)
        finally:
            if inherited is not None:
                os.environ["NUMBA_CACHE_DIR"] = inherited
    what = f"first start, kernels compiled: CPU of the children ({own:.1f} s CPU in the server)"
    return [Row("first start, kernels compiled, to ready", f"{took:.0f} s"), at_most(what, children, 15.0, "s CPU")]


def different_scenes(count: int) -> Iterator[bytes]:
    """Yield render requests that share no geometry."""
    positions, normals, uv, triangles = render_requests.sphere(32, 32)
    rng = np.random.default_rng(5)
    names = ("accessors", "bufferViews", "buffers", "materials", "meshes", "nodes")
    for _ in range(count):
        document: dict[str, Any] = {"asset": {"version": "2.0", "generator": "VTK"}, **{name: [] for name in names}}
        document |= {"scene": 0, "scenes": [{"nodes": [0, 1]}]}
        document |= {"cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "zfar": 10.0, "znear": 0.01}}]}
        stretched = (positions * rng.uniform(0.5, 1.5, 3)).astype(np.float32)
        attributes = {
            "POSITION": render_requests.accessor(document, stretched, 5126, "VEC3"),
            "NORMAL": render_requests.accessor(document, normals * np.float32(rng.uniform(0.9, 1.1)), 5126, "VEC3"),
            "TEXCOORD_0": render_requests.accessor(document, uv * np.float32(rng.uniform(0.5, 1.0)), 5126, "VEC2"),
        }
        indices = render_requests.accessor(document, rng.permutation(triangles).reshape(-1), 5125, "SCALAR")
        document["materials"].append({"pbrMetallicRoughness": {"baseColorFactor": [*rng.random(3), 1.0]}})
        document["meshes"].append({"primitives": [{"attributes": attributes, "indices": indices, "material": 0}]})
        document["nodes"] += [{"mesh": 0, "matrix": [*np.eye(4).ravel()[:14], -2.0, 1.0]}, {"camera": 0}]
        yield render_requests.request_body(json.dumps(document).encode(), render_requests.fields_for("color"), 320, 240)


def memory(count: int, plot: Path | None) -> list[Row]:
    """Measure resident memory of a gateway over ``count`` different scenes."""
    flags = ("--only", "render", "--cache-bytes", str(CACHE_BYTES))
    seen: list[tuple[int, float]] = []
    with gateway(*flags) as running:
        begin = time.perf_counter()
        for number, body in enumerate(different_scenes(count)):
            answer = post(running.port, body)
            if answer.status != 200:
                raise SystemExit(f"scene {number}: {answer.body[:300]!r}")
            if number % max(1, count // 200) == 0:
                seen.append((number, running.rss()))
        seen.append((count, running.rss()))
        took = time.perf_counter() - begin
    later = np.array([point for point in seen if point[0] >= count // 2])
    slope = float(np.polyfit(later[:, 0], later[:, 1], 1)[0]) * 1000
    first, last = seen[0][1], seen[-1][1]
    print(
        f"\n{count} different scenes in {took:.0f} s: {first:.0f} MB at first, {max(mb for _, mb in seen):.0f} MB at "
        f"most, {last:.0f} MB at last; {slope:+.2f} MB per 1000 scenes over the second half"
    )
    if plot is not None:
        plot.write_text(drawing(seen, f"{slope:+.2f} MB per 1000 scenes over the second half"), encoding="utf-8")
    what = f"memory through {count} different scenes: growth over the second half, MB per 1000 scenes"
    return [Row(what, f"{slope:+.2f}; {last:.0f} MB at last", "", "", "≤ 1", slope <= 1.0)]


def drawing(points: list[tuple[int, float]], note: str) -> str:
    """A plot of resident memory (MB) over scenes, as SVG."""
    width, height, left, bottom = 720, 300, 60, 40
    most, top = points[-1][0], 1.15 * max(mb for _, mb in points)

    def at(number: float, mb: float) -> tuple[float, float]:
        return left + (width - left - 20) * number / most, height - bottom - (height - bottom - 20) * mb / top

    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in (at(number, mb) for number, mb in points))
    marks = []
    step = 10 ** int(np.floor(np.log10(top))) / 2
    for k in range(int(top / step) + 1):
        _, y = at(0, k * step)
        marks.append(f'<path d="M{left} {y:.1f}H{width - 20}" stroke="#ddd"/>')
        marks.append(f'<text x="{left - 6}" y="{y + 4:.1f}" text-anchor="end">{k * step:.0f}</text>')
    for k in range(6):
        x, _ = at(most * k / 5, 0)
        marks.append(f'<text x="{x:.1f}" y="{height - bottom + 18}" text-anchor="middle">{most * k // 5}</text>')
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" '
        f'font-size="12"><rect width="100%" height="100%" fill="white"/>{"".join(marks)}'
        f'<polyline points="{line}" fill="none" stroke="#1763c6" stroke-width="2"/>'
        f'<text x="{left}" y="14">resident memory of the gateway, MB ({note})</text>'
        f'<text x="{width - 20}" y="{height - 6}" text-anchor="end">different scenes</text></svg>\n'
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=10_000)
    parser.add_argument("--plot", type=Path, help="an SVG file for the memory")
    parser.add_argument("--starts", type=int, default=STARTS, help="of each kind, for the median")
    parser.add_argument("--cold", action="store_true", help="also start with an empty cache (a minute of CPU)")
    options = parser.parse_args()
    rows = all_starts(options.starts, cold=options.cold)
    if options.scenes:
        rows += memory(options.scenes, options.plot)
    show(rows)


if __name__ == "__main__":
    main()
