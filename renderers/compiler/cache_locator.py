"""``cached_njit``: Numba's ``njit`` with the machine code in the folders of ``renderers.compiler.cache_folder``.

By default Numba names a cache folder by the absolute path of the source file, so that another clone or virtual
environment compiles everything again. Numba's setting CACHE_LOCATOR_CLASSES lists the classes that choose the folder
(docs/decisions/0001-kernel-cache.md). Every use of Numba's private API for the cache and its events is in this file;
tests/renderers/compiler/test_cache_locator.py fails when Numba changes it.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from numba import njit
from numba.core import caching, config, event

from renderers.compiler import cache_folder

CACHED_KERNELS: Final[list[Any]] = []
"""All functions that ``cached_njit`` has decorated."""
_log = logging.getLogger(__name__)
_jit: Final[Any] = njit  # its stubs lack some of the options
_caching: Final[Any] = caching  # without stubs
_config: Final[Any] = config  # without stubs
_event: Final[Any] = event  # without stubs


class KernelCacheLocator(_caching.UserProvidedCacheLocator):  # type: ignore[misc]  # Numba has no stubs for it
    """Locator of the cache folder of one of our functions."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        super().__init__(function, file)
        self._folder = f"{function.__module__}.{function.__qualname__}".replace("<", "").replace(">", "")

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> KernelCacheLocator | None:
        """Return the locator, or None for a function of another package; Numba then tries its own locators."""
        return cls(function, file) if function.__module__.partition(".")[0] in cache_folder.PACKAGES else None

    def get_cache_path(self) -> str:
        """Return the function's folder. Unlike with Numba's locators, it need not be writable."""
        return str(cache_folder.folder() / self._folder)

    def get_source_stamp(self) -> str:
        """Return the digest of all sources. Numba's own stamp leaves out functions that are called from other files."""
        return cache_folder.sources_digest()


@contextmanager
def _own_locator() -> Iterator[None]:
    """Put our locator before Numba's while a function is decorated; functions of other libraries do not get it."""
    setting = _config.CACHE_LOCATOR_CLASSES
    defaults = _caching.CacheImpl._locator_classes  # noqa: SLF001 - Numba has no public list
    others = setting or ",".join(locator.__name__ for locator in defaults)
    _config.CACHE_LOCATOR_CLASSES = f"{__name__}.{KernelCacheLocator.__name__},{others}"
    try:
        yield
    finally:
        _config.CACHE_LOCATOR_CLASSES = setting


def cached_njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return ``numba.njit(cache=True)`` with our cache folder, for ``jit.kernel``; ``options``: options of ``njit``."""

    def decorate(function: Callable[..., Any]) -> Any:
        with _own_locator():
            dispatcher = _jit(cache=True, **options)(function)
        _treat_damage_as_miss(dispatcher)
        CACHED_KERNELS.append(dispatcher)
        return dispatcher

    return decorate


def _treat_damage_as_miss(dispatcher: Any) -> None:
    """Delete a function's files that Numba cannot read, so that it is compiled again; Numba's own cache raises."""
    cache = dispatcher._cache  # noqa: SLF001 - Numba has no public name
    load = cache.load_overload

    def load_or_delete(*args: Any) -> Any:
        try:
            return load(*args)
        except (OSError, MemoryError):  # not of the files' contents
            raise
        except Exception as error:  # noqa: BLE001 - a damaged pickle raises anything
            path = folder_of(dispatcher)
            _log.warning("Damaged in the kernel cache, and compiled again: %s (%s)", path, error)
            for file in path.glob("*.nb[ic]"):
                file.unlink(missing_ok=True)
            return None

    cache.load_overload = load_or_delete


def folder_of(dispatcher: Any) -> Path:
    """Return the folder of a function made by ``cached_njit``."""
    return Path(dispatcher.stats.cache_path)


@contextmanager
def watch_compiler(on_compile: Callable[[str, int], object]) -> Iterator[None]:
    """Call ``on_compile`` before this process compiles a function inside the block, with its full name and its depth.

    The depth of a kernel is 1. A function that is compiled for another one is one deeper.
    """
    depth = threading.local()

    class Watch(_event.Listener):  # type: ignore[misc]  # Numba has no stubs for it
        def on_start(self, event: Any) -> None:
            depth.value = getattr(depth, "value", 0) + 1
            function = event.data["dispatcher"].py_func
            on_compile(f"{function.__module__}.{function.__qualname__}", depth.value)

        def on_end(self, event: Any) -> None:
            depth.value = getattr(depth, "value", 1) - 1

    watch = Watch()
    _event.register("numba:compile", watch)
    try:
        yield
    finally:
        _event.unregister("numba:compile", watch)
