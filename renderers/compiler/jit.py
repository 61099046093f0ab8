"""``kernel``: decorator of the compiled functions that Python calls. Each has one signature and is cached on disk.

Division follows IEEE 754 and never raises, as scenes may contain any numbers.
"""

import os
import threading
from collections.abc import Callable
from typing import Any, Final, Generic, ParamSpec, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.cache_locator import cached_njit
from renderers.compiler.kernel_types import KernelSignature, type_of
from renderers.compiler.pending import PENDING, wait_for_kernel

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T", bound=np.generic)

_CHECKS_ARGUMENTS: Final = bool(os.environ.get("SCENEGATE_CHECK_KERNELS"))
"""True: every call compares its arguments with the annotations, as in tests.

Otherwise arrays are still compared, by Numba, but a float may be passed as an integer."""
_compiling: Final = threading.Lock()


class Kernel(Generic[P, R]):
    """A compiled function with the signature of its annotations. Its other attributes are those of Numba's dispatcher.

    It is compiled, or loaded from the cache, at its first call or by ``compile_all``, never at import; and never again
    for other types.
    """

    def __init__(self, dispatcher: Any, signature: KernelSignature) -> None:
        self.dispatcher = dispatcher
        self.name = signature.name
        """Full name."""
        self.signature = signature
        self._is_compiled = False

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Call the machine code.

        Raises:
            TypeError: an argument has another type than its annotation says.
        """
        if PENDING:
            wait_for_kernel(self.name)
        if not self._is_compiled:
            self.compile()
        if _CHECKS_ARGUMENTS:
            self._check(args)
        try:
            result: R = self.dispatcher(*args, **kwargs)
        except TypeError:
            self._check(args)  # names the parameter
            raise
        return result

    def __getattr__(self, name: str) -> Any:
        return getattr(self.dispatcher, name)

    def _check(self, args: tuple[Any, ...]) -> None:
        self.signature.accept(list(map(type_of, args, self.signature.arguments)))

    def compile(self) -> None:
        """Compile the kernel, or load it from the cache."""
        with _compiling:
            if self._is_compiled:
                return
            # Without the return type, as at a first call: the cache would have another key with it.
            arguments = self.signature.arguments
            self.dispatcher.compile(arguments)
            self.signature.check_result(arguments, self.dispatcher.overloads[arguments].signature.return_type)
            self.dispatcher.disable_compile()
            self._is_compiled = True


KERNELS: Final[list[Kernel[Any, Any]]] = []
"""All kernels of the modules imported so far."""


@overload
def kernel(function: Callable[P, R]) -> Kernel[P, R]: ...
@overload
def kernel(*, releases_gil: bool) -> Callable[[Callable[P, R]], Kernel[P, R]]: ...
def kernel(function: Callable[..., Any] | None = None, *, releases_gil: bool = True) -> Any:
    """Decorate a function that Python calls; ``device_function`` is for functions that kernels call.

    Args:
        releases_gil: False for kernels that take microseconds: taking the GIL again may take longer than they do.
    """

    def decorate(function: Callable[..., Any]) -> Kernel[Any, Any]:
        dispatcher = cached_njit(nogil=releases_gil, fastmath=False, error_model="numpy")(function)
        compiled: Kernel[Any, Any] = Kernel(dispatcher, KernelSignature(function))
        KERNELS.append(compiled)
        return compiled

    return decorate if function is None else decorate(function)


def read_only(array: NDArray[T]) -> NDArray[T]:
    """Return a read-only view: a ``ReadOnly`` parameter takes no other arrays."""
    view = array.view()
    view.flags.writeable = False
    return view


def compile_all() -> None:
    """Compile, or load, all kernels of the modules imported so far."""
    for each in KERNELS:
        each.compile()
