"""Pools of output arrays and working memory. Fresh pages from the operating system cost more than drawing on them."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray

from renderers.compiler.pointers import Table, address_of, table

POOL_BYTES = 256 << 20
"""Maximum bytes of idle output arrays of a renderer: a stereo pair of 12 Mpx with all outputs."""
SCRATCH_BYTES = 512 << 20
"""Maximum bytes of idle scratch memory of a renderer: two to three frames of a million triangles."""


CACHE_LINE: Final = 64


def aligned(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Return an uninitialised C-contiguous array that begins with a cache line.

    NumPy's own arrays begin 16 bytes after one: every second vector would straddle two lines and take twice the time.
    """
    nbytes = math.prod(shape) * np.dtype(dtype).itemsize
    raw = np.empty(nbytes + CACHE_LINE, np.uint8)
    skipped = -address_of(raw, np.uint8) % CACHE_LINE
    return raw[skipped : skipped + nbytes].view(dtype).reshape(shape)


ArrayShapes = tuple[tuple[tuple[int, ...], type[np.generic]], ...]
"""Shapes and dtypes."""


@dataclass(frozen=True, slots=True, eq=False)
class PooledArrays:
    """Arrays that go back to their pool together."""

    arrays: tuple[NDArray[Any], ...]
    addresses: tuple[int, ...]
    nbytes: int
    shapes: ArrayShapes


class ArrayPool:
    """Free arrays, in groups of the same shapes and dtypes. Thread-safe. Arrays need not be given back."""

    def __init__(self, max_bytes: int = POOL_BYTES) -> None:
        self._max_bytes = max_bytes
        self._bytes = 0
        self._free: dict[ArrayShapes, list[PooledArrays]] = {}
        self._lock = threading.Lock()

    def take(self, shapes: ArrayShapes) -> PooledArrays:
        """Return uninitialised C-contiguous arrays."""
        with self._lock:
            free = self._free.get(shapes)
            if free:
                pooled = free.pop()
                if not free:
                    del self._free[shapes]
                self._bytes -= pooled.nbytes
                return pooled
        arrays = tuple([aligned(shape, dtype) for shape, dtype in shapes])
        addresses = tuple([address_of(array, dtype) for array, (_, dtype) in zip(arrays, shapes, strict=True)])
        return PooledArrays(arrays, addresses, sum(array.nbytes for array in arrays), shapes)

    def give(self, pooled: PooledArrays) -> None:
        """Take arrays back. Above the limit, the oldest shapes are dropped."""
        with self._lock:
            if pooled.nbytes <= self._max_bytes:
                self._free.setdefault(pooled.shapes, []).append(pooled)
                self._bytes += pooled.nbytes
            while self._bytes > self._max_bytes:
                oldest = next(iter(self._free))
                self._bytes -= self._free[oldest].pop(0).nbytes
                if not self._free[oldest]:
                    del self._free[oldest]

    def clear(self) -> None:
        """Drop all free arrays."""
        with self._lock:
            self._free.clear()
            self._bytes = 0


class Scratch:
    """Named flat arrays that only grow: the working memory of one frame at a time."""

    def __init__(self) -> None:
        self._arrays: dict[str, tuple[NDArray[Any], int]] = {}
        self._tables: dict[str, tuple[int, Table]] = {}
        self.nbytes = 0

    def take(self, name: str, count: int, dtype: type[np.generic]) -> tuple[NDArray[Any], int]:
        """Return an uninitialised flat array of at least ``count`` values, and its address."""
        entry = self._arrays.get(name)
        if entry is None or entry[0].size < count:
            if entry is not None:  # before the new one is allocated: memory may be short
                self.nbytes -= self._arrays.pop(name)[0].nbytes
                entry = None
            array = aligned((math.ceil(count * 1.25),), dtype)
            entry = self._arrays[name] = array, address_of(array, dtype)
            self.nbytes += array.nbytes
        return entry

    def table(self, name: str, values: int) -> Table:
        """Return at least ``values`` uninitialised int64, as from ``pointers.table``."""
        entry = self._tables.get(name)
        if entry is None or entry[0] < values:
            old_values = 0 if entry is None else entry[0]
            entry = self._tables[name] = values, table(values)
            self.nbytes += 8 * (values - old_values)
        return entry[1]


class ScratchPool:
    """Idle scratch, one per frame in progress. Scratch beyond the limit is dropped. Thread-safe."""

    def __init__(self, max_bytes: int = SCRATCH_BYTES) -> None:
        self._max_bytes = max_bytes
        self._bytes = 0
        self._free: list[Scratch] = []
        self._lock = threading.Lock()

    def take(self) -> Scratch:
        """Return idle or new scratch, for one frame."""
        with self._lock:
            if not self._free:
                return Scratch()
            scratch = self._free.pop()
            self._bytes -= scratch.nbytes
            return scratch

    def give(self, scratch: Scratch) -> None:
        """Take scratch back, or drop it above the limit."""
        with self._lock:
            if self._bytes + scratch.nbytes <= self._max_bytes:
                self._bytes += scratch.nbytes
                self._free.append(scratch)

    def clear(self) -> None:
        """Drop all idle scratch."""
        with self._lock:
            self._free.clear()
            self._bytes = 0
