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
    """Limit of several caches together. Beyond it, the least recently used values of all of them are evicted."""

    def __init__(self, max_bytes: int) -> None:
        self.max_bytes = max_bytes
        self._lock = threading.Lock()
        self._caches: WeakSet[Cache[Any, Any]] = WeakSet()
        self._clock = count()
        """Logical clock: each use of a value takes the next number."""
        # Keys of collected objects whose entries are not dropped yet. Objects may be collected while the lock is held.
        self._collected: deque[tuple[ref[Cache[Any, Any]], Hashable]] = deque()

    def figures(self) -> dict[str, CacheFigures]:
        """Return the figures of the caches by their names, sorted."""
        sums: dict[str, CacheFigures] = {}
        with self._lock:
            self._drop_collected()
            for cache in self._caches:
                nbytes, hits, misses = sums.get(cache.name, CacheFigures())
                sums[cache.name] = CacheFigures(nbytes + cache._nbytes, hits + cache.hits, misses + cache.misses)
        return dict(sorted(sums.items()))

    def _drop_collected(self) -> None:
        while self._collected:
            reference, key = self._collected.popleft()
            if (cache := reference()) is not None:
                cache._drop(key)

    def _evict(self, newest: _Entry) -> None:
        """Drop the least recently used values until the limit is kept, but not the newest one."""
        while sum(cache._nbytes for cache in self._caches) > self.max_bytes:
            filled = [cache for cache in self._caches if cache._entries]
            cache = min(filled, key=lambda cache: cache._oldest().used)
            if cache._oldest() is newest:
                return
            cache._drop(next(iter(cache._entries)))
            self._drop_collected()  # entries of weak caches whose key only the dropped value kept alive


SHARED: Final = CacheBudget(DEFAULT_BYTES)
"""The limit of the process's caches (``--cache-bytes``)."""


@dataclass(slots=True)
class _Entry:
    value: Any
    nbytes: int
    references: tuple[ref[Any], ...]
    """Weak references to the objects of the key, if the cache is weak."""
    used: int
    """Time of the last use on the clock of the budget."""


class Cache(Generic[K, V]):
    """Values by key. Callers share the values and must not change them.

    The budget limits the total size of the values of its caches; ``max_count`` limits the number of values of this one.
    The least recently used values are evicted first. A value larger than the whole budget is not kept.

    With ``weak=True``, a key is an object or a tuple of objects, compared by identity. The cache does not keep them
    alive, and drops an entry when one of its objects is collected. The newest value is then kept even if it is larger
    than the budget, since its key is in use.
    """

    def __init__(
        self, name: str, max_count: int | None = None, *, weak: bool = False, budget: CacheBudget = SHARED
    ) -> None:
        """
        Args:
            name: name in metrics.
            max_count: maximum number of values; None: no limit.
        """
        self.name = name
        self.max_count = max_count
        self._weak = weak
        self._budget = budget
        self._entries: OrderedDict[Hashable, _Entry] = OrderedDict()
        self._nbytes = 0
        self.hits = 0
        """Number of look-ups that found a value."""
        self.misses = 0
        """Number of look-ups that found no value."""
        with budget._lock:
            budget._caches.add(self)

    @property
    def nbytes(self) -> int:
        """Sum of the sizes of all values."""
        with self._budget._lock:
            self._budget._drop_collected()
            return self._nbytes

    def __len__(self) -> int:
        with self._budget._lock:
            self._budget._drop_collected()
            return len(self._entries)

    def get(self, key: K) -> V | None:
        """Return the value of a key and mark it as the most recently used; None if there is no value."""
        internal_key = _identity(key) if self._weak else key
        with self._budget._lock:
            self._budget._drop_collected()
            entry = self._entries.get(internal_key)
            if entry is None:
                self.misses += 1
                return None
            self.hits += 1
            entry.used = next(self._budget._clock)
            self._entries.move_to_end(internal_key)
            value: V = entry.value
            return value

    def put(self, key: K, value: V, nbytes: int) -> None:
        """Store a value of ``nbytes`` bytes, replacing the key's previous value."""
        internal_key = _identity(key) if self._weak else key
        with self._budget._lock:
            self._budget._drop_collected()
            self._drop(internal_key)
            if nbytes > self._budget.max_bytes and not self._weak:
                return
            references = self._references(key, internal_key) if self._weak else ()
            entry = self._entries[internal_key] = _Entry(value, nbytes, references, next(self._budget._clock))
            self._nbytes += nbytes
            if self.max_count is not None and len(self._entries) > max(self.max_count, 1):
                self._drop(next(iter(self._entries)))
            self._budget._evict(entry)

    def clear(self) -> None:
        """Drop all values. The counts of hits and misses are kept."""
        with self._budget._lock:
            for key in tuple(self._entries):
                self._drop(key)

    def _references(self, key: K, internal_key: Hashable) -> tuple[ref[Any], ...]:
        """Return weak references to the key's objects. When one is collected, the key's entry is dropped."""
        budget, cache = self._budget, ref(self)

        def on_collected(_: ref[Any]) -> None:
            budget._collected.append((cache, internal_key))
            if budget._lock.acquire(blocking=False):  # otherwise the next method call drops the entry
                try:
                    budget._drop_collected()
                finally:
                    budget._lock.release()

        objects = {id(each): each for each in (key if isinstance(key, tuple) else (key,))}
        return tuple([ref(each, on_collected) for each in objects.values()])

    def _oldest(self) -> _Entry:
        """Return the entry whose last use is the longest ago."""
        return next(iter(self._entries.values()))

    def _drop(self, internal_key: Hashable) -> None:
        entry = self._entries.pop(internal_key, None)
        if entry is not None:
            self._nbytes -= entry.nbytes


def _identity(key: Any) -> Hashable:
    """Return the ``id`` of an object, or those of a tuple of objects."""
    return tuple([id(each) for each in key]) if isinstance(key, tuple) else id(key)
