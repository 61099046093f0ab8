"""``device_function``: decorator of functions that only kernels call.

Numba optimises every function by itself, adds wrappers for Python and generates machine code. A kernel links the
result and optimises it again, so that a third of all compile time goes into code that never runs. The compiler here
only lowers device functions to LLVM; they are optimised once, in the kernel
(docs/decisions/0003-rasterizer-in-numba.md). This is the only file that uses Numba's private compiler API.
"""

from collections.abc import Callable
from typing import Any, Final, TypeVar

from numba import njit, types
from numba.core import compiler, compiler_machinery, typed_passes, untyped_passes
from numba.core.codegen import JITCodeLibrary

from renderers.compiler.kernel_types import KernelSignature

F = TypeVar("F", bound=Callable[..., Any])


class _NoEnvironment:
    """Code generator without environments: they belong to functions in an execution engine."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, name: str, env: object) -> None:
        """Do nothing: environments are for exceptions, which kernels do not raise."""


class _DeviceLibrary(JITCodeLibrary):
    """LLVM code of a device function: linked into kernels, never optimised or compiled."""

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
class _ChooseLibrary(compiler_machinery.LoweringPass):
    """Lower the function into a ``_DeviceLibrary``, if it returns what its annotation says."""

    _name = "choose_device_library"

    def __init__(self) -> None:
        pass

    def run_pass(self, state: Any) -> bool:
        state.func_id.func.kernel_signature.check_result(state.args, state.return_type)
        state.library = _DeviceLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        return False


_UNNEEDED_PASSES: Final = {
    untyped_passes.WithLifting,
    untyped_passes.InlineClosureLikes,
    untyped_passes.RewriteDynamicRaises,
    untyped_passes.MakeFunctionToJitFunction,
    untyped_passes.RewriteSemanticConstants,
    untyped_passes.DeadBranchPrune,
    untyped_passes.InlineInlinables,
    untyped_passes.FindLiterallyCalls,
    untyped_passes.LiteralUnroll,
    untyped_passes.LiteralPropagationSubPipelinePass,
    typed_passes.NoPythonSupportedFeatureValidation,
    typed_passes.DumpParforDiagnostics,
    typed_passes.InlineOverloads,
    typed_passes.NopythonRewrites,
}
"""Passes for features that device functions do not use. They would take a fifteenth of the compile time."""


class _Compiler(compiler.Compiler):
    def define_pipelines(self) -> list[Any]:
        (passes,) = super().define_pipelines()
        passes.add_pass_after(_ChooseLibrary, typed_passes.AnnotateTypes)
        passes.passes = [each for each in passes.passes if each[0] not in _UNNEEDED_PASSES]
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


def _decorator(**options: Any) -> Callable[[F], F]:
    """Return a decorator like ``njit`` for functions whose annotations are their signature.

    They are compiled once for all values of a constant argument. Numba would compile a function again for every
    constant; LLVM propagates constants anyway when it inlines.
    """

    def decorate(function: F) -> F:
        dispatcher = _jit(**options)(function)
        signature = KernelSignature(function)
        untyped: Any = function
        untyped.kernel_signature = signature
        compiler = dispatcher._compiler  # noqa: SLF001 - Numba has no option for it
        numba_fold = compiler.fold_argument_types

        def fold_argument_types(args: Any, kws: Any) -> Any:
            unliteral: Any = types.unliteral  # the type of a constant without its value
            named = {name: unliteral(each) for name, each in dict(kws).items()}
            python_signature, given = numba_fold(tuple(map(unliteral, args)), named)
            return python_signature, signature.accept(given)

        compiler.fold_argument_types = fold_argument_types
        decorated: F = dispatcher
        return decorated

    return decorate


def device_function(function: F) -> F:
    """Decorate a function that kernels call. A call from Python crashes the process.

    LLVM decides whether to inline it. Numba's default is to inline all that an ``inlined`` function calls: one kernel
    for shading would have 42,000 instructions instead of 14,000, and take twice as long to compile.
    """
    return _decorator(forceinline=False, **_OPTIONS)(function)


def inlined(function: F) -> F:
    """Decorate a ``device_function`` that is always inlined."""
    return _decorator(forceinline=True, **_OPTIONS)(function)
