"""The one cache class: values by key, bounded in bytes, least recently used dropped first."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Hashable
from typing import Generic, TypeVar

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


class Cache(Generic[K, V]):
    """Values by key. Thread-safe.

    The sum of the sizes and the number of values are bounded; the least recently used are dropped first. A value
    larger than the bound is not kept at all. Values must not change: callers share them.
    """

    def __init__(self, max_bytes: int, max_count: int | None = None) -> None:
        self.max_bytes = max_bytes
        self.max_count = max_count
        self._lock = threading.Lock()
        self._entries: OrderedDict[K, tuple[V, int]] = OrderedDict()
        self._nbytes = 0
        self._hits = 0
        self._misses = 0

    @property
    def nbytes(self) -> int:
        """Sum of the sizes of all values."""
        return self._nbytes

    @property
    def hits(self) -> int:
        """Number of look-ups that found a value."""
        return self._hits

    @property
    def misses(self) -> int:
        """Number of look-ups that found none."""
        return self._misses

    def __len__(self) -> int:
        return len(self._entries)

    def get(self, key: K) -> V | None:
        """Return the value, now the most recently used; None where there is none."""
        with self._lock:
            entry = self._entries.get(key)
            if entry is None:
                self._misses += 1
                return None
            self._hits += 1
            self._entries.move_to_end(key)
            return entry[0]

    def put(self, key: K, value: V, nbytes: int) -> None:
        """Keep a value of ``nbytes`` bytes in place of the key's former one."""
        with self._lock:
            former = self._entries.pop(key, None)
            if former is not None:
                self._nbytes -= former[1]
            if nbytes > self.max_bytes:
                return
            self._entries[key] = value, nbytes
            self._nbytes += nbytes
            while self._nbytes > self.max_bytes or (self.max_count is not None and len(self) > self.max_count):
                _, (_, dropped) = self._entries.popitem(last=False)
                self._nbytes -= dropped

    def clear(self) -> None:
        """Drop everything; the counts of hits and misses stay."""
        with self._lock:
            self._entries.clear()
            self._nbytes = 0
