"""Kernels that call other kernels, and what threads within them share.

A kernel that calls another one by its address is compiled in no time, whatever the other one does, and Python is not
asked between: threads that work on one frame would wait for each other's turn with the interpreter.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any, Final

from llvmlite import ir
from numba import extending, types

from renderers.compiler.jit import compile_kernel

intrinsic: Any = extending.intrinsic
_I32, _I64 = ir.IntType(32), ir.IntType(64)


@cache
def kernel_address(dispatcher: Any) -> int:
    """Where the code of an entry point made by ``jit.kernel`` lies, for ``call_kernel``; it is never freed."""
    compile_kernel(dispatcher)
    (result,) = dispatcher.overloads.values()
    address: int = result.library.get_pointer_to_function(result.fndesc.llvm_func_name)
    return address


@intrinsic
def call_kernel(typing_context: Any, address: Any, arguments: Any) -> Any:
    """``call_kernel(address, (a, b, ..))``: call an entry point that takes int64 and returns nothing.

    By Numba's own convention: the results and a description of an error are left where two pointers say. Kernels have
    no result and raise nothing.
    """
    count = len(arguments)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        kind = context.call_conv.get_function_type(types.none, [types.int64] * count)
        with builder.goto_entry_block():
            places = [builder.alloca(argument.pointee) for argument in kind.args[:2]]
        for place in places:
            builder.store(ir.Constant(place.type.pointee, None), place)
        values = [builder.extract_value(args[1], k) for k in range(count)]
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), [*places, *values])
        return ir.Constant(_I32, 0)

    return types.int32(types.int64, arguments), generate


@intrinsic
def take_number(typing_context: Any, pointer: Any, index: Any) -> Any:
    """``take_number(pointer, i)``: the int64 there, which is one more for whoever asks next, from any thread."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.atomic_rmw("add", builder.gep(args[0], [args[1]]), ir.Constant(_I64, 1), "seq_cst")

    return types.int64(pointer, types.int64), generate


@intrinsic
def shared_number(typing_context: Any, pointer: Any, index: Any) -> Any:
    """The int64 there as another thread left it, with all that it wrote before ``take_number``."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load_atomic(builder.gep(args[0], [args[1]]), "acquire", align=8)

    return types.int64(pointer, types.int64), generate


@intrinsic
def is_set(typing_context: Any, address: Any) -> Any:
    """``is_set(address)``: whether the int64 there, which another thread may write, is not 0; see ``stop.StopFlag``."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        word = builder.load_atomic(builder.inttoptr(args[0], _I64.as_pointer()), "monotonic", align=8)
        return builder.icmp_signed("!=", word, ir.Constant(_I64, 0))

    return types.boolean(types.int64), generate


def _yield_address() -> int:
    try:
        return ctypes.cast(ctypes.CDLL(None).sched_yield, ctypes.c_void_p).value or 0
    except (AttributeError, OSError, TypeError):  # not POSIX: whoever waits goes on looking
        return 0


YIELD_ADDRESS: Final = _yield_address()
"""``int sched_yield(void)``; 0: there is none."""


@intrinsic
def yield_at(typing_context: Any, address: Any) -> Any:
    """Let another thread have the core; ``address``: YIELD_ADDRESS, not 0."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.call(builder.inttoptr(args[0], ir.FunctionType(_I32, []).as_pointer()), [])
        return ir.Constant(_I32, 0)

    return types.int32(types.int64), generate
