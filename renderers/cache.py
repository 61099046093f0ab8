"""The cache class: bounded in bytes, least recently used first out."""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from collections.abc import Hashable
from typing import Any, Generic, TypeVar
from weakref import ref

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


class Cache(Generic[K, V]):
    """Values by key. Thread-safe.

    The sum of the sizes and the number of values are limited; the least recently used are evicted first. A value that
    exceeds the limit by itself is not kept. Values must not change: callers share them.

    With ``weak=True``, a key is an object, or a tuple of objects, compared by identity and not kept alive: the entry
    is dropped when one of the objects is collected. The newest value is always kept, since its key is in use.
    """

    def __init__(self, max_bytes: int, max_count: int | None = None, *, weak: bool = False) -> None:
        self.max_bytes = max_bytes
        self.max_count = max_count
        self._weak = weak
        self._lock = threading.Lock()
        self._entries: OrderedDict[Hashable, tuple[V, int, tuple[ref[Any], ...]]] = OrderedDict()
        self._nbytes = 0
        self._hits = 0
        self._misses = 0
        # Objects are collected anywhere, even within a method of this class that holds the lock.
        self._dead: deque[Hashable] = deque()

    @property
    def nbytes(self) -> int:
        """Sum of the sizes of all values."""
        with self._lock:
            self._drop_dead()
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
        with self._lock:
            self._drop_dead()
            return len(self._entries)

    def get(self, key: K) -> V | None:
        """Return the value, now the most recently used; None if there is none."""
        own = _identity(key) if self._weak else key
        with self._lock:
            self._drop_dead()
            entry = self._entries.get(own)
            if entry is None:
                self._misses += 1
                return None
            self._hits += 1
            self._entries.move_to_end(own)
            return entry[0]

    def put(self, key: K, value: V, nbytes: int) -> None:
        """Keep a value of ``nbytes`` bytes in place of the key's former one."""
        own = _identity(key) if self._weak else key
        with self._lock:
            self._drop_dead()
            self._drop(own)
            if nbytes > self.max_bytes and not self._weak:
                return
            self._entries[own] = value, nbytes, self._references(key, own) if self._weak else ()
            self._nbytes += nbytes
            while (
                self._nbytes > self.max_bytes or (self.max_count is not None and len(self._entries) > self.max_count)
            ) and len(self._entries) > 1:
                self._drop(next(iter(self._entries)))

    def clear(self) -> None:
        """Drop everything; the counts of hits and misses stay."""
        with self._lock:
            self._entries.clear()
            self._nbytes = 0

    def _references(self, key: K, own: Hashable) -> tuple[ref[Any], ...]:
        """Return weak references to a key's objects that mark its entry as dead."""

        def mark_dead(_: ref[Any]) -> None:
            self._dead.append(own)
            if self._lock.acquire(blocking=False):  # otherwise the next call drops the entry
                try:
                    self._drop_dead()
                finally:
                    self._lock.release()

        objects = {id(each): each for each in (key if isinstance(key, tuple) else (key,))}
        return tuple([ref(each, mark_dead) for each in objects.values()])

    def _drop_dead(self) -> None:
        while self._dead:
            self._drop(self._dead.popleft())

    def _drop(self, own: Hashable) -> None:
        entry = self._entries.pop(own, None)
        if entry is not None:
            self._nbytes -= entry[1]


def _identity(key: Any) -> Hashable:
    return tuple([id(each) for each in key]) if isinstance(key, tuple) else id(key)
