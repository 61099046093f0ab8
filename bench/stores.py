"""Measure the innermost store of the rasterizer: ``python -m bench.stores``.

LLVM may turn "store the new value where the mask is set, else the old one" into masked stores, which are microcoded on
Zen 1 to 3: 0.95 to 1.0 ns a pixel instead of 0.15 to 0.2 (``renderers.compiler.simd``). The kernels read the old
value by ``load_volatile`` to prevent that. Both ways are measured.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np
from numba import njit

from bench.table import at_most, show
from renderers.compiler import simd as vec
from renderers.compiler.pointers import f32_at, i32_at

PIXELS = 32 * 1280
TIMES = 200


@njit(nogil=True)
def _again(new: int, depths: int, ids: int, times: int) -> None:
    n, d, i = f32_at(new), f32_at(depths), i32_at(ids)
    for time_ in range(times):
        for k in range(0, PIXELS, 8):
            w, old = vec.load(n, k), vec.load_volatile(d, k)
            vec.store(d, k, vec.select(w > old, w, old))
            vec.store(i, k, vec.select(w > old, vec.i32(time_), vec.load_volatile(i, k)))


@njit(nogil=True)
def _plainly(new: int, depths: int, ids: int, times: int) -> None:
    n, d, i = f32_at(new), f32_at(depths), i32_at(ids)
    for time_ in range(times):
        for k in range(0, PIXELS, 8):
            w, old = vec.load(n, k), vec.load(d, k)
            vec.store(d, k, vec.select(w > old, w, old))
            vec.store(i, k, vec.select(w > old, vec.i32(time_), vec.load(i, k)))


def nanoseconds(kernel: Callable[[int, int, int, int], None]) -> float:
    """Return the CPU time (ns) of a depth test and write of one pixel, in cache."""
    new = np.random.default_rng(0).random(PIXELS + 528, np.float32)
    depths, ids = np.zeros(PIXELS + 1056, np.float32), np.zeros(PIXELS, np.int32)
    values = []
    for _ in range(21):
        depths[:] = 0.5
        start = time.thread_time()
        kernel(new.ctypes.data, depths.ctypes.data, ids.ctypes.data, TIMES)
        values.append(1e9 * (time.thread_time() - start) / (PIXELS * TIMES))
    return statistics.median(values[1:])


def main() -> None:
    plainly, again = nanoseconds(_plainly), nanoseconds(_again)
    peer = f"with masked stores, where LLVM makes them: {plainly:.2f} ns"
    show([at_most("depth test and write of one pixel", again, 0.5, "ns", peer)])


if __name__ == "__main__":
    main()
