"""Drawing with what other processors have: our frames by kernels compiled for them, in turns, and their pictures.

    python -m bench.cpus [--frames 20]

Each is a process whose Numba was told that this is another CPU of x86-64: ``avx2`` has what came by 2013, ``sse4.2``
what came by 2008 (x86-64-v2). Their kernels are compiled first, a minute of CPU time each, and kept beside the others.
Two threads, scenes and sizes of ``bench.raster``: colour, depth and label. Figures are medians of CPU time, ms a frame,
and the geometric mean of their ratios to this processor's. That all pictures are the same is checked on the way.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import llvmlite.binding as llvm

from bench.raster import EVERYTHING, SIZES, Process, drawn, scenes, view
from bench.table import geometric_mean
from bench.turns import Time, in_turns, median
from renderers.interface import Look
from renderers.raster import CpuRenderer, warmup

_SSE: Final = frozenset(
    (
        *("64bit", "cmov", "cx8", "cx16", "fxsr", "mmx", "sahf", "popcnt", "crc32"),
        *("sse", "sse2", "sse3", "ssse3", "sse4.1", "sse4.2"),
    )
)
_AVX2: Final = _SSE | {"avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave", "xsaveopt"}
CPUS: Final = {"this one": None, "avx2": ("haswell", _AVX2), "sse4.2": ("nehalem", _SSE)}
"""LLVM's names, and what they have; all else is switched off."""


def started(cpu: str) -> Process:
    """A process that draws as that CPU would; it compiles before it answers."""
    environment = dict(os.environ)
    other = CPUS[cpu]
    if other is not None:
        name, features = other
        listed = (f"{'+' if feature in features else '-'}{feature}" for feature in llvm.get_host_cpu_features())
        environment |= {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": ",".join(listed)}
    command = (sys.executable, "-m", "bench.cpus", "--draw")
    pipe = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1, env=environment
    )
    return Process(pipe)


def draw() -> None:
    """Answers lines of scene, width, height and frame by two times, or by a number made of the picture's bytes."""
    warmup()
    everything, renderer = scenes(), CpuRenderer(2)
    for line in sys.stdin:
        what, name, *numbers = line.rstrip("\n").split("\t")
        width, height, frame = map(int, numbers)
        camera = view(width, height, frame)
        if what == "picture":
            picture = renderer.render(everything[name], camera, EVERYTHING, Look())
            arrays: tuple[Any, ...] = (picture.color, picture.depth, picture.label)
            digest = hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()
            print(0, int(digest[:12], 16), flush=True)
        else:
            print(*drawn(renderer, everything[name], camera), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--draw", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.draw:
        draw()
        return
    begin = time.perf_counter()
    drawers = {cpu: started(cpu) for cpu in CPUS}
    ratios: dict[str, list[float]] = {cpu: [] for cpu in CPUS}
    print(f"{'CPU ms':24}" + "".join(f"{cpu:>12}" for cpu in CPUS), flush=True)

    def asked(drawer: Process, words: str, frame: int) -> Time:
        return drawer.ask(f"{words}\t{frame}")

    for name in scenes():
        for width, height in SIZES:
            words = f"{name}\t{width}\t{height}"
            pictures = {cpu: drawer.ask(f"picture\t{words}\t0")[1] for cpu, drawer in drawers.items()}
            if len(set(pictures.values())) != 1:
                raise SystemExit(f"{name}, {width}x{height}: the pictures differ: {pictures}")
            calls: dict[str, Callable[[int], Time]] = {
                cpu: partial(asked, drawer, f"time\t{words}") for cpu, drawer in drawers.items()
            }
            cpu_times = {cpu: median(times).cpu for cpu, times in in_turns(calls, options.frames).items()}
            for cpu, value in cpu_times.items():
                ratios[cpu].append(value / cpu_times["this one"])
            print(
                f"{name:14}{width:5}x{height:<4}" + "".join(f"{value:12.2f}" for value in cpu_times.values()),
                flush=True,
            )
    print(f"{'over this one':24}" + "".join(f"{geometric_mean(ratio):12.2f}" for ratio in ratios.values()))
    print(f"All pictures are the same, bit for bit ({time.perf_counter() - begin:.0f} s).")
    for drawer in drawers.values():
        drawer.close()


if __name__ == "__main__":
    main()
