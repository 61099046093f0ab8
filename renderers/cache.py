"""The cache class of renderers and gateway: limited in bytes, evicts the least recently used, thread-safe."""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from collections.abc import Hashable
from typing import Any, Generic, TypeVar
from weakref import ref

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


class Cache(Generic[K, V]):
    """Values by key. Callers share the values and must not change them.

    The sum of the sizes and the number of values are limited; the least recently used are evicted first. A value larger
    than ``max_bytes`` is not kept.

    With ``weak=True``, a key is an object or a tuple of objects, compared by identity. The cache does not keep them
    alive, and drops an entry when one of its objects is collected. The newest value is then kept even if it is larger
    than ``max_bytes``, since its key is in use.
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
        # Keys of collected objects whose entries are not dropped yet. Objects may be collected while the lock is held.
        self._collected: deque[Hashable] = deque()

    @property
    def nbytes(self) -> int:
        """Sum of the sizes of all values."""
        with self._lock:
            self._drop_collected()
            return self._nbytes

    @property
    def hits(self) -> int:
        """Number of look-ups that found a value."""
        return self._hits

    @property
    def misses(self) -> int:
        """Number of look-ups that found no value."""
        return self._misses

    def __len__(self) -> int:
        with self._lock:
            self._drop_collected()
            return len(self._entries)

    def get(self, key: K) -> V | None:
        """Return the value of a key and mark it as the most recently used; None if there is no value."""
        internal_key = _identity(key) if self._weak else key
        with self._lock:
            self._drop_collected()
            entry = self._entries.get(internal_key)
            if entry is None:
                self._misses += 1
                return None
            self._hits += 1
            self._entries.move_to_end(internal_key)
            return entry[0]

    def put(self, key: K, value: V, nbytes: int) -> None:
        """Store a value of ``nbytes`` bytes, replacing the key's previous value."""
        internal_key = _identity(key) if self._weak else key
        with self._lock:
            self._drop_collected()
            self._drop(internal_key)
            if nbytes > self.max_bytes and not self._weak:
                return
            self._entries[internal_key] = value, nbytes, self._references(key, internal_key) if self._weak else ()
            self._nbytes += nbytes
            while (
                self._nbytes > self.max_bytes or (self.max_count is not None and len(self._entries) > self.max_count)
            ) and len(self._entries) > 1:
                self._drop(next(iter(self._entries)))

    def clear(self) -> None:
        """Drop all values. The counts of hits and misses are kept."""
        with self._lock:
            self._entries.clear()
            self._nbytes = 0

    def _references(self, key: K, internal_key: Hashable) -> tuple[ref[Any], ...]:
        """Return weak references to the key's objects. When one is collected, the key's entry is dropped."""

        def on_collected(_: ref[Any]) -> None:
            self._collected.append(internal_key)
            if self._lock.acquire(blocking=False):  # otherwise the next method call drops the entry
                try:
                    self._drop_collected()
                finally:
                    self._lock.release()

        objects = {id(each): each for each in (key if isinstance(key, tuple) else (key,))}
        return tuple([ref(each, on_collected) for each in objects.values()])

    def _drop_collected(self) -> None:
        while self._collected:
            self._drop(self._collected.popleft())

    def _drop(self, internal_key: Hashable) -> None:
        entry = self._entries.pop(internal_key, None)
        if entry is not None:
            self._nbytes -= entry[1]


def _identity(key: Any) -> Hashable:
    """Return the ``id`` of an object, or those of a tuple of objects."""
    return tuple([id(each) for each in key]) if isinstance(key, tuple) else id(key)
