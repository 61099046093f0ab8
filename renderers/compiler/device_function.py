"""Functions that only kernels call. They are linked into kernels, and neither optimised nor compiled by themselves.

Numba would optimise every such function, give it wrappers for Python and make machine code of it. A kernel would link
the result and optimise it again: a third of all compile time goes into code that never runs. The compiler here leaves
functions as lowered; everything is optimised once, in the kernel. docs/decisions/0003-rasterizer-in-numba.md has the
reasons; this is the only file that uses Numba's private compiler API.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from numba import njit, types
from numba.core import compiler, compiler_machinery, typed_passes, untyped_passes
from numba.core.codegen import JITCodeLibrary


class _NoEnvironment:
    """A code generator for functions that are in no execution engine, and therefore have no environment."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, name: str, env: object) -> None:
        """Do nothing: kernels raise no exceptions."""


class _Linked(JITCodeLibrary):
    """Code that is linked into other code."""

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
    """Choose the library that lowering puts its code into."""

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
"""Passes for features that these functions do not use; they take a tenth of the time."""


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
    """Return a decorator like ``njit`` whose functions are compiled once for constants and variables of a type.

    Numba would compile a function anew for every constant argument. LLVM propagates constants anyway when it inlines.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher = _jit(**options)(function)
        compiler = dispatcher._compiler  # noqa: SLF001 - Numba has no option for it
        fold = compiler.fold_argument_types

        def without_constants(args: Any, kws: Any) -> Any:
            plain: Any = types.unliteral
            return fold(tuple(map(plain, args)), {name: plain(value) for name, value in dict(kws).items()})

        compiler.fold_argument_types = without_constants
        return dispatcher

    return decorate


device_function: Final[Any] = _linked(**_OPTIONS)
"""Decorator for a function that kernels call. A call from Python crashes the process."""
inlined: Final[Any] = _linked(forceinline=True, **_OPTIONS)
"""``device_function`` that is always inlined."""
