"""Arrays that are used again: fresh pages from the system cost more than drawing on them."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray

from renderers.pointers import address_of

POOL_BYTES = 256 << 20
"""Bytes of idle picture arrays that a renderer keeps: a stereo pair of 12 Mpx with all outputs."""
SCRATCH_BYTES = 512 << 20
"""Bytes of idle scratch that a renderer keeps: two to three frames of a million triangles, most of it never touched."""


CACHE_LINE: Final = 64


def aligned(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """A C-contiguous array with undefined contents that begins with a cache line. NumPy's own begin 16 bytes behind
    one: every second vector would straddle two, and writing it take twice the time."""
    nbytes = math.prod(shape) * np.dtype(dtype).itemsize
    raw = np.empty(nbytes + CACHE_LINE, np.uint8)
    skipped = -address_of(raw, np.uint8) % CACHE_LINE
    return raw[skipped : skipped + nbytes].view(dtype).reshape(shape)


@dataclass(frozen=True, slots=True, eq=False)
class Pooled:
    """An array that goes back to its pool."""

    array: NDArray[Any]
    address: int
    nbytes: int
    kind: tuple[tuple[int, ...], type[np.generic]]
    """Shape and dtype."""


class ArrayPool:
    """Arrays by shape and dtype. Thread-safe; what is not given back is simply collected."""

    def __init__(self, max_bytes: int = POOL_BYTES) -> None:
        self._max_bytes = max_bytes
        self._bytes = 0
        self._free: dict[tuple[tuple[int, ...], type[np.generic]], list[Pooled]] = {}
        self._lock = threading.Lock()

    def take(self, shape: tuple[int, ...], dtype: type[np.generic]) -> Pooled:
        """A C-contiguous array with undefined contents."""
        kind = (shape, dtype)
        with self._lock:
            free = self._free.get(kind)
            if free:
                pooled = free.pop()
                if not free:
                    del self._free[kind]
                self._bytes -= pooled.nbytes
                return pooled
        array = aligned(shape, dtype)
        return Pooled(array, address_of(array, dtype), array.nbytes, kind)

    def give(self, taken: Iterable[Pooled | None]) -> None:
        """Take arrays back; None is nothing. The oldest shapes are dropped when too much lies idle."""
        with self._lock:
            for pooled in taken:
                if pooled is not None and pooled.nbytes <= self._max_bytes:
                    self._free.setdefault(pooled.kind, []).append(pooled)
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
        self._sizes: object = None
        self._places: tuple[int, ...] = ()
        self.nbytes = 0

    def take(self, name: str, count: int, dtype: type[np.generic]) -> tuple[NDArray[Any], int]:
        """A flat array of at least ``count`` values with undefined contents, and its address."""
        known = self._arrays.get(name)
        if known is None or known[0].size < count:
            if known is not None:  # the old one goes before the new one comes
                self.nbytes -= self._arrays.pop(name)[0].nbytes
                known = None
            array = aligned((math.ceil(count * 1.25),), dtype)
            known = self._arrays[name] = array, address_of(array, dtype)
            self.nbytes += array.nbytes
        return known

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


class ScratchPool:
    """Scratch for every frame in work; large ones are dropped when idle beyond the bound. Thread-safe."""

    def __init__(self, max_bytes: int = SCRATCH_BYTES) -> None:
        self._max_bytes = max_bytes
        self._free: list[Scratch] = []
        self._lock = threading.Lock()

    def take(self) -> Scratch:
        with self._lock:
            return self._free.pop() if self._free else Scratch()

    def give(self, scratch: Scratch) -> None:
        with self._lock:
            if sum(s.nbytes for s in self._free) + scratch.nbytes <= self._max_bytes:
                self._free.append(scratch)
