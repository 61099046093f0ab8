"""The cache class of renderers and gateway: limited in bytes, evicts the least recently used, thread-safe.

All caches of a process share one limit, ``SHARED``, so that the process's memory does not depend on which of them its
clients fill.
"""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from collections.abc import Hashable
from dataclasses import dataclass
from itertools import count
from typing import Any, Final, Generic, NamedTuple, TypeVar
from weakref import WeakSet, ref

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")

DEFAULT_BYTES: Final = 1 << 30
"""Default limit of all caches together: several scenes of 25 MB with everything that is derived from them."""


class CacheFigures(NamedTuple):
    """Figures of a cache, or the sums of those with the same name."""

    nbytes: int = 0
    """Sum of the sizes of all values, approximately."""
    hits: int = 0
    """Number of look-ups that found a value."""
    misses: int = 0
    """Number of look-ups that found no value."""


class CacheBudget:
    """Limit of several caches together. Beyond it, the least recently used values of all of them are evicted.

    Apart from ``figures``, the methods are for the caches, which hold ``lock``.
    """

    def __init__(self, max_bytes: int) -> None:
        self.max_bytes = max_bytes
        self.lock = threading.Lock()
        """Held while any of the caches is used."""
        self.clock = count()
        """Logical clock: each use of a value takes the next number."""
        self._caches: WeakSet[Cache[Any, Any]] = WeakSet()
        self.collected: deque[tuple[ref[Cache[Any, Any]], Hashable]] = deque()
        """Keys of objects that were collected while the lock was held. Their entries are dropped later."""

    def figures(self) -> dict[str, CacheFigures]:
        """Return the figures of the caches by their names, sorted."""
        sums: dict[str, CacheFigures] = {}
        with self.lock:
            self.drop_collected()
            for cache in self._caches:
                nbytes, hits, misses = sums.get(cache.name, CacheFigures())
                sums[cache.name] = CacheFigures(nbytes + cache.total, hits + cache.hits, misses + cache.misses)
        return dict(sorted(sums.items()))

    def add(self, cache: Cache[Any, Any]) -> None:
        """Count a cache."""
        self._caches.add(cache)

    def drop_when_unlocked(self, cache: ref[Cache[Any, Any]], key: Hashable) -> None:
        """Drop the entry of a collected object: now, or at the next use of a cache if the lock is held."""
        self.collected.append((cache, key))
        if self.lock.acquire(blocking=False):
            try:
                self.drop_collected()
            finally:
                self.lock.release()

    def drop_collected(self) -> None:
        """Drop the entries of collected objects."""
        while self.collected:
            reference, key = self.collected.popleft()
            if (cache := reference()) is not None:
                cache.drop(key)

    def evict(self, newest: CacheEntry) -> None:
        """Drop the least recently used values until the limit is kept, but not the newest one."""
        while sum([cache.total for cache in self._caches]) > self.max_bytes:
            filled = [cache for cache in self._caches if cache.entries]
            cache = min(filled, key=lambda cache: next(iter(cache.entries.values())).used)
            key, oldest = next(iter(cache.entries.items()))
            if oldest is newest:
                return
            cache.drop(key)
            self.drop_collected()  # entries of weak caches whose key only the dropped value kept alive


SHARED: Final = CacheBudget(DEFAULT_BYTES)
"""The limit of the process's caches (``--cache-bytes``)."""


@dataclass(slots=True)
class CacheEntry:
    """A value in a cache."""

    value: Any
    nbytes: int
    references: tuple[ref[Any], ...]
    """Weak references to the objects of the key; empty: the key is kept."""
    used: int
    """Time of the last use on the clock of the budget."""


class Cache(Generic[K, V]):
    """Values by key. Callers share the values and must not change them.

    The budget limits the total size of the values of its caches; ``max_count`` limits the number of values of this one.
    The least recently used values are evicted first. A value larger than the whole budget is not kept.

    ``entries``, ``total`` and ``drop`` are for the budget, which holds its lock.
    """

    def __init__(self, name: str, max_count: int | None = None, *, budget: CacheBudget = SHARED) -> None:
        """
        Args:
            name: name in metrics.
            max_count: maximum number of values; None: no limit.
        """
        self.name = name
        self.max_count = max_count
        self._budget = budget
        self.entries: OrderedDict[Hashable, CacheEntry] = OrderedDict()
        """The least recently used one comes first."""
        self.total = 0
        """Sum of the sizes of all values."""
        self.hits = 0
        """Number of look-ups that found a value."""
        self.misses = 0
        """Number of look-ups that found no value."""
        with budget.lock:
            budget.add(self)

    @property
    def nbytes(self) -> int:
        """Sum of the sizes of all values."""
        with self._budget.lock:
            self._budget.drop_collected()
            return self.total

    def __len__(self) -> int:
        with self._budget.lock:
            self._budget.drop_collected()
            return len(self.entries)

    def get(self, key: K) -> V | None:
        """Return the value of a key and mark it as the most recently used; None if there is no value."""
        stored_key, budget = self._stored_key(key), self._budget
        with budget.lock:
            if budget.collected:
                budget.drop_collected()
            entry = self.entries.get(stored_key)
            if entry is None:
                self.misses += 1
                return None
            self.hits += 1
            entry.used = next(budget.clock)
            self.entries.move_to_end(stored_key)
            value: V = entry.value
            return value

    def put(self, key: K, value: V, nbytes: int) -> None:
        """Store a value of ``nbytes`` bytes, replacing the key's previous value."""
        stored_key, budget = self._stored_key(key), self._budget
        references = self._references(key)
        with budget.lock:
            if budget.collected:
                budget.drop_collected()
            self.drop(stored_key)
            if nbytes > budget.max_bytes and not references:
                return
            entry = self.entries[stored_key] = CacheEntry(value, nbytes, references, next(budget.clock))
            self.total += nbytes
            if self.max_count is not None and len(self.entries) > max(self.max_count, 1):
                self.drop(next(iter(self.entries)))
            budget.evict(entry)

    def clear(self) -> None:
        """Drop all values. The counts of hits and misses are kept."""
        with self._budget.lock:
            for key in tuple(self.entries):
                self.drop(key)

    def drop(self, key: Hashable) -> None:
        """Drop a value, if there is one."""
        entry = self.entries.pop(key, None)
        if entry is not None:
            self.total -= entry.nbytes

    def _stored_key(self, key: K) -> Hashable:
        """Return the key in ``entries``."""
        return key

    def _references(self, key: K) -> tuple[ref[Any], ...]:
        """Return ``CacheEntry.references``."""
        return ()


class WeakCache(Cache[K, V]):
    """Values by an object or a tuple of objects, compared by identity.

    The cache does not keep them alive, and drops an entry when one of its objects is collected. The newest value is
    kept even if it is larger than the budget, since its key is in use.
    """

    def _stored_key(self, key: Any) -> Hashable:
        return tuple([id(each) for each in key]) if isinstance(key, tuple) else id(key)

    def _references(self, key: Any) -> tuple[ref[Any], ...]:
        budget, stored_key = self._budget, self._stored_key(key)
        cache: ref[Cache[Any, Any]] = ref(self)

        def on_collected(_: ref[Any]) -> None:
            budget.drop_when_unlocked(cache, stored_key)

        objects = {id(each): each for each in (key if isinstance(key, tuple) else (key,))}
        return tuple([ref(each, on_collected) for each in objects.values()])
