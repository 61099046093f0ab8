"""Results that are kept as long as the object that they were computed from."""

import threading
from collections.abc import Callable
from functools import wraps
from typing import TypeVar
from weakref import WeakKeyDictionary

K = TypeVar("K")
V = TypeVar("V")


def cached_by_weak_key(compute: Callable[[K], V]) -> Callable[[K], V]:
    """Decorate a function of one object: each result is computed once, and kept as long as the object. Thread-safe."""
    results: WeakKeyDictionary[K, tuple[V]] = WeakKeyDictionary()  # in tuples, because a result may be None
    lock = threading.Lock()

    @wraps(compute)
    def kept(argument: K) -> V:
        with lock:
            found = results.get(argument)
        if found is None:
            result = compute(argument)  # without the lock: it may take long
            with lock:
                found = results.setdefault(argument, (result,))
        return found[0]

    return kept
