"""What was made of an object, kept while the object lives and as long as a bound in bytes allows."""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from typing import Generic, TypeVar
from weakref import ref

K = TypeVar("K")
V = TypeVar("V")


class WeakLru(Generic[K, V]):
    """Values by weakly held keys (compared by identity), the least recently used dropped first. Thread-safe.

    A dropped value stays alive for whoever still works with it. One that is larger than the bound by itself is kept
    until the next one comes, since it is being used.
    """

    def __init__(self, max_bytes: int) -> None:
        self._max_bytes = max_bytes
        self._lock = threading.Lock()
        self._kept: OrderedDict[ref[K], tuple[V, int]] = OrderedDict()
        self._nbytes = 0
        # Keys die anywhere, within this class's own statements too, so that their death is only noted there.
        self._dead: deque[ref[K]] = deque()

    @property
    def nbytes(self) -> int:
        """Bytes of what is kept."""
        with self._lock:
            self._bury()
            return self._nbytes

    def __len__(self) -> int:
        with self._lock:
            self._bury()
            return len(self._kept)

    def get(self, key: K) -> V | None:
        """The value, which thereby becomes the most recently used; None when there is none."""
        with self._lock:
            self._bury()
            handle = ref(key)
            found = self._kept.get(handle)
            if found is None:
                return None
            self._kept.move_to_end(handle)
            return found[0]

    def put(self, key: K, value: V, nbytes: int) -> None:
        """Keeps a value in place of the key's former one."""
        with self._lock:
            self._bury()
            self._drop(ref(key))
            self._kept[ref(key, self._dead.append)] = (value, nbytes)
            self._nbytes += nbytes
            while self._nbytes > self._max_bytes and len(self._kept) > 1:
                self._drop(next(iter(self._kept)))

    def _bury(self) -> None:
        while self._dead:
            self._drop(self._dead.popleft())

    def _drop(self, handle: ref[K]) -> None:
        found = self._kept.pop(handle, None)
        if found is not None:
            self._nbytes -= found[1]
