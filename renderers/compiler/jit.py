"""How kernels are compiled: one specialisation each, cached on disk, the GIL released.

Division is IEEE's: a posted scene may hold any numbers, and none may raise.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from numba.core import sigutils

from renderers.compiler.cache_locator import cached_njit

KERNELS: Final[list[Any]] = []
"""Every entry point made so far, for ``compile_all``."""


def kernel(signature: str, *, brief: bool = False) -> Callable[[Callable[..., Any]], Any]:
    """Decorator for entry points that Python calls; see ``device_function`` for what they call.

    Args:
        signature: the one specialisation, as Numba writes it. It is compiled (or loaded from the cache) at the first
            call or by ``compile_all``, never at import.
        brief: keeps the GIL. For those that take microseconds: who lets go of it waits until another thread, which may
            have waited for it, does the same.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher: Any = cached_njit(nogil=not brief, fastmath=False, error_model="numpy")(function)
        dispatcher.scenegate_signature = signature
        KERNELS.append(dispatcher)
        return dispatcher

    return decorate


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
