"""``kernel``: decorator of the compiled functions that Python calls. Each has one signature and is cached on disk.

Division follows IEEE 754 and never raises, as scenes may contain any numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.cache_locator import cached_njit
from renderers.compiler.numba_typing import argument_types
from renderers.compiler.pending import PENDING, wait_for_kernel

T = TypeVar("T", bound=np.generic)


class Kernel:
    """A compiled function. Its other attributes are those of Numba's dispatcher."""

    def __init__(self, dispatcher: Any, signature: str) -> None:
        self.dispatcher = dispatcher
        self.name = f"{dispatcher.py_func.__module__}.{dispatcher.py_func.__name__}"
        """Full name."""
        self._signature = signature

    def __call__(self, *args: Any) -> Any:
        if PENDING:
            wait_for_kernel(self.name)
        return self.dispatcher(*args)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.dispatcher, name)

    def compile(self) -> None:
        """Compile the kernel, or load it from the cache."""
        # Without the return type, as at a first call: the cache would have another key with it.
        self.dispatcher.compile(argument_types(self._signature))


KERNELS: Final[list[Kernel]] = []
"""All kernels of the modules imported so far."""


def kernel(signature: str, *, releases_gil: bool = True) -> Callable[[Callable[..., Any]], Kernel]:
    """Decorate a function that Python calls; ``device_function`` is for functions that kernels call.

    Args:
        signature: Numba's text for the types of the arguments and the result. The kernel is compiled, or loaded from
            the cache, at its first call or by ``compile_all``, never at import.
        releases_gil: False for kernels that take microseconds: taking the GIL again may take longer than they do.
    """

    def decorate(function: Callable[..., Any]) -> Kernel:
        dispatcher = cached_njit(nogil=releases_gil, fastmath=False, error_model="numpy")(function)
        compiled = Kernel(dispatcher, signature)
        KERNELS.append(compiled)
        return compiled

    return decorate


def read_only(array: NDArray[T]) -> NDArray[T]:
    """Return a read-only view: a kernel whose signature has ``readonly=True`` is compiled for such arrays only."""
    view = array.view()
    view.flags.writeable = False
    return view


def compile_all() -> None:
    """Compile, or load, all kernels of the modules imported so far."""
    for each in KERNELS:
        each.compile()
