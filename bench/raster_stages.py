"""Measure the CPU time of each phase of a frame, on one thread, with the scenes of ``raster``.

    python -m bench.raster_stages [--look phong] [--frames 30]

The first quartile of each phase over the frames, ms: programs that share the machine only ever add to it. ``whole`` is
the frame as it is drawn, in one call; what is beside the phases is Python and the tables.
"""

from __future__ import annotations

import argparse
import ctypes
import time
from collections import defaultdict
from collections.abc import Callable
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np

from bench.raster import EVERYTHING, SIZES, scenes, view
from gateway.runtime.workers.process_tuning import tune
from renderers.interface import Look
from renderers.raster import CpuRenderer, frame, warmup
from renderers.raster.coverage import draw_band
from renderers.raster.layout import RasterFrame
from renderers.raster.resolve import resolve_band
from renderers.raster.setup import setup
from renderers.raster.transform import transform
from renderers.shading.headlight.shade_rows import shade_rows
from renderers.visibility_buffer import BAND_ROWS

PHASES = ("transform", "setup", "draw", "shade", "back faces", "resolve", "whole")


def read_frame(address: int) -> SimpleNamespace:
    """Return the fields of the RasterFrame at an address."""
    memory = (ctypes.c_char * RasterFrame.nbytes).from_address(address)
    frame = np.frombuffer(bytes(memory), RasterFrame.dtype)[0]
    return SimpleNamespace(**{name: frame[name].tolist() for name in RasterFrame.dtype.names or ()})


def laps(spent: dict[str, float]) -> Callable[[str], None]:
    """Return a function that adds the thread's CPU time (s) since its previous call to the named phase."""
    now = time.thread_time()

    def note(phase: str) -> None:
        nonlocal now
        before, now = now, time.thread_time()
        spent[phase] += now - before

    return note


def by_phase(address: int, spent: dict[str, float]) -> None:
    """Run the phases of a frame one by one; add the CPU time (s) of each to ``spent``."""
    note = laps(spent)
    values = read_frame(address)
    transform(address, 0, values.vertex_count)
    note("transform")
    setup(address, 0, values.chunk_count)
    note("setup")
    for first in range(0, values.height, BAND_ROWS):
        rows = first, min(first + BAND_ROWS, values.height)
        draw_band(address, *rows, values.band_memory, 0)
        note("draw")
        shade_rows(values.shade_job, values.band_memory, *rows)
        note("shade")
        if values.first_back_bin:
            draw_band(address, *rows, values.band_memory, 1)
            note("back faces")
        resolve_band(address, *rows, values.band_memory)
        note("resolve")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--look", choices=("phong", "plain", "pbr"), default="phong")
    parser.add_argument("--frames", type=int, default=30)
    options = parser.parse_args()
    tune()  # malloc as in a server
    warmup()
    renderer, look = CpuRenderer(1), Look(options.look)
    print(f"{'ms CPU':24}" + "".join(f"{phase:>12}" for phase in PHASES), flush=True)
    for name, scene in scenes().items():
        for width, height in SIZES:
            times: dict[str, list[float]] = defaultdict(list)
            for number in range(options.frames + 2):
                spent: dict[str, float] = defaultdict(float)
                with patch.object(frame, "run_phases", lambda address, _, spent=spent: by_phase(address, spent)):
                    renderer.render(scene, view(width, height, number), EVERYTHING, look)
                start = time.thread_time()
                renderer.render(scene, view(width, height, number), EVERYTHING, look)
                spent["whole"] = time.thread_time() - start
                for phase, value in spent.items():
                    times[phase].append(value)
            quartiles = [sorted(times[phase][2:])[options.frames // 4] if phase in times else 0.0 for phase in PHASES]
            cells = "".join(f"{1e3 * value:12.3f}" for value in quartiles)
            print(f"{name:14}{width:5}x{height:<4}" + cells, flush=True)


if __name__ == "__main__":
    main()
