"""``kernel``: decorator of the compiled functions that Python calls. Each has one signature and is cached on disk.

Division follows IEEE 754 and never raises, as scenes may contain any numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from numba.core import sigutils

from renderers.compiler.cache_locator import cached_njit

KERNELS: Final[list[Any]] = []
"""All kernels of the modules imported so far."""


def kernel(signature: str, *, releases_gil: bool = True) -> Callable[[Callable[..., Any]], Any]:
    """Decorate a function that Python calls; ``device_function`` is for functions that kernels call.

    Args:
        signature: Numba's text for the types of the arguments and the result. The kernel is compiled, or loaded from
            the cache, at its first call or by ``compile_all``, never at import.
        releases_gil: False for kernels that take microseconds: taking the GIL again may take longer than they do.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher: Any = cached_njit(nogil=releases_gil, fastmath=False, error_model="numpy")(function)
        dispatcher.scenegate_signature = signature
        KERNELS.append(dispatcher)
        return dispatcher

    return decorate


def compile_kernel(dispatcher: Any) -> None:
    """Compile a kernel, or load it from the cache."""
    # Without the return type, as at a first call: the cache would have another key with it.
    normalize: Any = sigutils.normalize_signature
    arguments, _ = normalize(dispatcher.scenegate_signature)
    dispatcher.compile(tuple(arguments))


def compile_all() -> None:
    """Compile, or load, all kernels of the modules imported so far."""
    for dispatcher in KERNELS:
        compile_kernel(dispatcher)
