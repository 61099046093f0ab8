"""Tell Numba to keep our kernels in ``renderers.compiler.cache_folder``'s folders.

By default Numba names a cache folder by the absolute path of the source file, so that another clone or virtual
environment compiles everything again. Numba's setting CACHE_LOCATOR_CLASSES lists the classes that choose the folder;
docs/decisions/0001-kernel-cache.md has the reasons. Every use of Numba's private API for the cache is in this file, and
tests/renderers/compiler/test_cache_locator.py fails when Numba changes it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from numba import njit
from numba.core import caching, config

from renderers.compiler import cache_folder

CACHED: Final[list[Any]] = []
"""All functions made by ``cached_njit`` so far."""
_jit: Final[Any] = njit  # its stubs lack some of the options
_numba: Final[Any] = caching
_config: Final[Any] = config


class KernelCacheLocator(_numba.UserProvidedCacheLocator):  # type: ignore[misc]  # Numba has no stubs for it
    """The cache folder of one of our functions, named by content instead of path."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        super().__init__(function, file)
        self._folder = f"{function.__module__}.{function.__qualname__}".replace("<", "").replace(">", "")

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> KernelCacheLocator | None:
        """Return the locator, or None for a function of another package, which Numba's own locators take."""
        return cls(function, file) if function.__module__.partition(".")[0] in cache_folder.PACKAGES else None

    def get_cache_path(self) -> str:
        """Return the function's folder, which, unlike with Numba's locators, need not be writable."""
        return str(cache_folder.folder() / self._folder)

    def get_source_stamp(self) -> str:
        """Return the digest of all sources: Numba's own stamp leaves out functions called from other files."""
        return cache_folder.sources_digest()


@contextmanager
def _located() -> Iterator[None]:
    """Put our locator before Numba's while a function is decorated.

    Neither longer nor by the environment variable: other libraries' functions keep their own.
    """
    before = _config.CACHE_LOCATOR_CLASSES
    default = _numba.CacheImpl._locator_classes  # noqa: SLF001 - Numba has no public list
    others = before or ",".join(each.__name__ for each in default)
    _config.CACHE_LOCATOR_CLASSES = f"{__name__}.{KernelCacheLocator.__name__},{others}"
    try:
        yield
    finally:
        _config.CACHE_LOCATOR_CLASSES = before


def cached_njit(*signature: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator as ``numba.njit(cache=True)`` that keeps the machine code in our kernel cache.

    Args:
        signature: none, or one: then the function is compiled, or loaded, when it is decorated.
        options: as ``njit``'s.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        with _located():
            dispatcher = _jit(*signature, cache=True, **options)(function)
        CACHED.append(dispatcher)
        return dispatcher

    return decorate


def folder_of(dispatcher: Any) -> Path:
    """Return the folder of a function made by ``cached_njit``."""
    return Path(dispatcher.stats.cache_path)
