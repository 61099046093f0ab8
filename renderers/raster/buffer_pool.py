"""Arrays that are used again: fresh pages from the system cost more than drawing on them."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray

from renderers.compiler.pointers import Table, address_of, table

POOL_BYTES = 256 << 20
"""Bytes of idle picture arrays that a renderer keeps: a stereo pair of 12 Mpx with all outputs."""
SCRATCH_BYTES = 512 << 20
"""Bytes of idle scratch that a renderer keeps: two to three frames of a million triangles, most of it never touched."""


CACHE_LINE: Final = 64
T = TypeVar("T")


def aligned(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """A C-contiguous array with undefined contents that begins with a cache line. NumPy's own begin 16 bytes behind
    one: every second vector would straddle two, and writing it take twice the time."""
    nbytes = math.prod(shape) * np.dtype(dtype).itemsize
    raw = np.empty(nbytes + CACHE_LINE, np.uint8)
    skipped = -address_of(raw, np.uint8) % CACHE_LINE
    return raw[skipped : skipped + nbytes].view(dtype).reshape(shape)


Kinds = tuple[tuple[tuple[int, ...], type[np.generic]], ...]
"""Shapes and dtypes."""


@dataclass(frozen=True, slots=True, eq=False)
class Pooled:
    """Arrays that go back to their pool together."""

    arrays: tuple[NDArray[Any], ...]
    addresses: tuple[int, ...]
    nbytes: int
    kinds: Kinds


class ArrayPool:
    """Groups of arrays by shapes and dtypes. Thread-safe; what is not given back is simply collected."""

    def __init__(self, max_bytes: int = POOL_BYTES) -> None:
        self._max_bytes = max_bytes
        self._bytes = 0
        self._free: dict[Kinds, list[Pooled]] = {}
        self._lock = threading.Lock()

    def take(self, kinds: Kinds) -> Pooled:
        """C-contiguous arrays with undefined contents."""
        with self._lock:
            free = self._free.get(kinds)
            if free:
                pooled = free.pop()
                if not free:
                    del self._free[kinds]
                self._bytes -= pooled.nbytes
                return pooled
        arrays = tuple([aligned(shape, dtype) for shape, dtype in kinds])
        addresses = tuple([address_of(array, dtype) for array, (_, dtype) in zip(arrays, kinds, strict=True)])
        return Pooled(arrays, addresses, sum(array.nbytes for array in arrays), kinds)

    def give(self, pooled: Pooled) -> None:
        """Take arrays back. The oldest shapes are dropped when too much lies idle."""
        with self._lock:
            if pooled.nbytes <= self._max_bytes:
                self._free.setdefault(pooled.kinds, []).append(pooled)
                self._bytes += pooled.nbytes
            while self._bytes > self._max_bytes:
                oldest = next(iter(self._free))
                self._bytes -= self._free[oldest].pop(0).nbytes
                if not self._free[oldest]:
                    del self._free[oldest]


class Scratch:
    """Named flat arrays that only grow: the working memory of one frame at a time."""

    def __init__(self) -> None:
        self._arrays: dict[str, tuple[NDArray[Any], int]] = {}
        self._tables: dict[str, tuple[int, Table]] = {}
        self._sizes: object = None
        self._places: tuple[int, ...] = ()
        self._made: tuple[object, Any] = None, None
        self.nbytes = 0

    def take(self, name: str, count: int, dtype: type[np.generic]) -> tuple[NDArray[Any], int]:
        """A flat array of at least ``count`` values with undefined contents, and its address."""
        known = self._arrays.get(name)
        if known is None or known[0].size < count:
            if known is not None:  # the old one goes before the new one comes, which there may be no memory for
                self._sizes, self._made = None, (None, None)
                self.nbytes -= self._arrays.pop(name)[0].nbytes
                known = None
            array = aligned((math.ceil(count * 1.25),), dtype)
            known = self._arrays[name] = array, address_of(array, dtype)
            self.nbytes += array.nbytes
        return known

    def table(self, name: str, values: int) -> Table:
        """At least ``values`` int64 with undefined contents, see ``pointers.table``."""
        known = self._tables.get(name)
        if known is None or known[0] < values:
            before = 0 if known is None else known[0]
            known = self._tables[name] = values, table(values)
            self.nbytes += 8 * (values - before)
        return known[1]

    def room(self, sizes: object, parts: Callable[[], Iterable[tuple[str, int, type[np.generic]]]]) -> tuple[int, ...]:
        """Addresses of several arrays, which nobody else takes.

        Args:
            sizes: what their sizes depend on: with the same as before, they are where they were.
            parts: gives what ``take`` is told of each.
        """
        if sizes != self._sizes:
            self._places = tuple([self.take(*part)[1] for part in parts()])
            self._sizes = sizes
        return self._places

    def made(self, key: object, make: Callable[[], T]) -> T:
        """What ``make`` gave last, if that was for the same key; it may hold addresses of arrays nobody else takes."""
        if key != self._made[0]:
            self._made = key, make()
        last: T = self._made[1]
        return last


class ScratchPool:
    """Scratch for every frame in work; large ones are dropped when idle beyond the bound. Thread-safe."""

    def __init__(self, max_bytes: int = SCRATCH_BYTES) -> None:
        self._max_bytes = max_bytes
        self._bytes = 0
        self._free: list[Scratch] = []
        self._lock = threading.Lock()

    def take(self) -> Scratch:
        with self._lock:
            if not self._free:
                return Scratch()
            scratch = self._free.pop()
            self._bytes -= scratch.nbytes
            return scratch

    def give(self, scratch: Scratch) -> None:
        with self._lock:
            if self._bytes + scratch.nbytes <= self._max_bytes:
                self._bytes += scratch.nbytes
                self._free.append(scratch)
