"""How kernels are compiled: one specialisation each, cached on disk, the GIL released.

Numba's cache notices a change of the file that holds an entry point, but not of the functions and intrinsics that it
calls from other files. Entry points made by ``kernel`` are stamped with the contents of every source file of their own
folder and of this package instead, so that a cache from another version is never used. Division is IEEE's: a posted
scene may hold any numbers, and none may raise.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, Final

from numba import njit
from numba.core import caching, sigutils

KERNELS: Final[list[Any]] = []
"""Every entry point made so far, for ``compile_all``."""


def kernel(signature: str, *, brief: bool = False) -> Callable[[Callable[..., Any]], Any]:
    """Decorator for entry points that Python calls; what they call among themselves is of ``renderers.linked``.

    Args:
        signature: the one specialisation, as Numba writes it. It is compiled (or loaded from the cache) at the first
            call or by ``compile_all``, never at import.
        brief: keeps the GIL. For those that take microseconds: who lets go of it waits until another thread, which may
            have waited for it, does the same.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher: Any = njit(nogil=not brief, cache=True, fastmath=False, error_model="numpy")(function)
        implementation = dispatcher._cache._impl
        file: Any = caching.IndexDataCacheFile
        dispatcher._cache._cache_file = file(
            cache_path=dispatcher._cache.cache_path,
            filename_base=implementation.filename_base,
            source_stamp=_stamp(Path(function.__code__.co_filename).parent),
        )
        dispatcher.scenegate_signature = signature
        KERNELS.append(dispatcher)
        return dispatcher

    return decorate


@cache
def _stamp(folder: Path) -> str:
    """Digest of the sources of a folder and of this package, whose functions its kernels may call."""
    digest = hashlib.sha256()
    for path in sorted({*folder.glob("*.py"), *Path(__file__).parent.rglob("*.py")}):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def compile_kernel(dispatcher: Any) -> None:
    """Compile an entry point of ``KERNELS``, or load it from the cache."""
    # By the arguments alone, as a first call looks it up: with the result in it the cache would have another key.
    normalize: Any = sigutils.normalize_signature
    arguments, _ = normalize(dispatcher.scenegate_signature)
    dispatcher.compile(tuple(arguments))


def compile_all() -> None:
    """``compile_kernel`` for every entry point of the modules imported so far."""
    for dispatcher in KERNELS:
        compile_kernel(dispatcher)
