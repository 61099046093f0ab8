"""Functions that only kernels call: linked into these, neither optimised nor made machine code by themselves.

Numba makes every compiled function whole: optimised, with wrappers for Python, as machine code. What a kernel calls
is then linked into it and optimised again, layer upon layer, and a third of the time that all kernels take goes into
code that is never run. The compiler here leaves such functions as they were lowered; all is optimised once, in the
kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from numba import njit, types
from numba.core import compiler, compiler_machinery, typed_passes, untyped_passes
from numba.core.codegen import JITCodeLibrary


class _NoEnvironment:
    """A code generator for functions that are in no engine: there is nowhere to put what raises exceptions."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, name: str, env: object) -> None:
        """Nothing: kernels raise no exceptions."""


class _Linked(JITCodeLibrary):
    """Code to be linked into other code."""

    @property
    def codegen(self) -> Any:
        return _NoEnvironment(self._codegen)

    def get_pointer_to_function(self, name: str) -> int:
        self._ensure_finalized()
        return 0

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True


@compiler_machinery.register_pass(mutates_CFG=False, analysis_only=True)
class _LinkedLibrary(compiler_machinery.LoweringPass):
    """Says where lowering puts its code."""

    _name = "linked_library"

    def __init__(self) -> None:
        pass

    def run_pass(self, state: Any) -> bool:
        state.library = _Linked(state.targetctx.codegen(), state.func_id.func_qualname)
        return False


_NOT_USED: Final = {
    untyped_passes.WithLifting,
    untyped_passes.InlineClosureLikes,
    untyped_passes.RewriteDynamicRaises,
    untyped_passes.MakeFunctionToJitFunction,
    typed_passes.InlineOverloads,
    typed_passes.NopythonRewrites,
}
"""Passes for what these functions have not: ``with``, closures, exceptions, expressions of arrays. They take a tenth of
the time."""


class _Compiler(compiler.Compiler):
    def define_pipelines(self) -> list[Any]:
        (passes,) = super().define_pipelines()
        passes.add_pass_after(_LinkedLibrary, typed_passes.AnnotateTypes)
        passes.passes = [each for each in passes.passes if each[0] not in _NOT_USED]
        passes.finalize()
        return [passes]


_jit: Final[Any] = njit  # its stubs lack some of the options
_OPTIONS: Final[dict[str, Any]] = {
    "nogil": True,
    "error_model": "numpy",
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "pipeline_class": _Compiler,
}


def _linked(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """A decorator as ``njit``; what it decorates is compiled once for all integers and truth values, constants or not.

    Numba would compile it anew for every constant that it is called with, and for the first value of every variable
    that begins as one. Where a constant matters, LLVM knows it as well, once the function is inlined.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = _jit(**options)(function)
        fold = dispatcher._compiler.fold_argument_types

        def without_constants(args: Any, kws: Any) -> Any:
            plain: Any = types.unliteral
            return fold(tuple(map(plain, args)), {name: plain(value) for name, value in dict(kws).items()})

        dispatcher._compiler.fold_argument_types = without_constants
        return dispatcher

    return decorate


inner: Final[Any] = _linked(**_OPTIONS)
"""Decorator for a function that kernels call. Python cannot call it: that ends the process."""
inlined: Final[Any] = _linked(forceinline=True, **_OPTIONS)
"""``inner`` for what shall have no call of its own."""
