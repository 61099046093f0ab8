"""Calls from kernel to kernel by address, and atomic access to memory that threads share.

Kernels that call each other by address are compiled separately. Python is not involved, so that the threads of a frame
do not wait for the GIL between two kernels.
"""

import ctypes
from functools import cache
from typing import Any, Final

from renderers.compiler.jit import Kernel
from renderers.compiler.numba_typing import intrinsic, ir, types
from renderers.compiler.pending import wait_for_kernel

_I32, _I64 = ir.IntType(32), ir.IntType(64)


@cache
def kernel_address(kernel: Kernel[..., Any]) -> int:
    """Return the address of a kernel's machine code, for ``call_kernel``; it is never freed."""
    wait_for_kernel(kernel.name)
    kernel.compile()
    (result,) = kernel.overloads.values()
    address: int = result.library.get_pointer_to_function(result.fndesc.llvm_func_name)
    return address


@intrinsic
def call_kernel(typing_context: Any, address: Any, arguments: Any) -> Any:
    """``call_kernel(address, (a, b, ..))``: call a kernel that takes int64 and returns nothing.

    Numba's calling convention passes two pointers before the arguments, to the result and to an exception.
    """
    count = len(arguments)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        function = context.call_conv.get_function_type(types.none, [types.int64] * count)
        with builder.goto_entry_block():
            outcomes = [builder.alloca(argument.pointee) for argument in function.args[:2]]
        for outcome in outcomes:
            builder.store(ir.Constant(outcome.type.pointee, None), outcome)
        values = [builder.extract_value(args[1], k) for k in range(count)]
        builder.call(builder.inttoptr(args[0], function.as_pointer()), [*outcomes, *values])
        return ir.Constant(_I32, 0)

    return types.int32(types.int64, arguments), generate


@intrinsic
def atomic_add_one(typing_context: Any, pointer: Any, index: Any) -> Any:
    """``atomic_add_one(pointer, i)``: add 1 to an int64 and return its former value."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.atomic_rmw("add", builder.gep(args[0], [args[1]]), ir.Constant(_I64, 1), "seq_cst")

    return types.int64(pointer, types.int64), generate


@intrinsic
def load_acquire(typing_context: Any, pointer: Any, index: Any) -> Any:
    """``load_acquire(pointer, i)``: read an int64. Writes before its last ``atomic_add_one`` are visible then."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load_atomic(builder.gep(args[0], [args[1]]), "acquire", align=8)

    return types.int64(pointer, types.int64), generate


@intrinsic
def is_set(typing_context: Any, address: Any) -> Any:
    """``is_set(address)``: True if the int64 of a ``stop.StopFlag`` is not 0. Other threads may set it meanwhile."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        flag = builder.load_atomic(builder.inttoptr(args[0], _I64.as_pointer()), "monotonic", align=8)
        return builder.icmp_signed("!=", flag, ir.Constant(_I64, 0))

    return types.boolean(types.int64), generate


def _yield_address() -> int:
    try:
        return ctypes.cast(ctypes.CDLL(None).sched_yield, ctypes.c_void_p).value or 0
    except (AttributeError, OSError, TypeError):  # not POSIX: waiting threads spin
        return 0


YIELD_ADDRESS: Final = _yield_address()
"""Address of ``int sched_yield(void)``; 0 if there is none."""


@intrinsic
def yield_at(typing_context: Any, address: Any) -> Any:
    """``yield_at(YIELD_ADDRESS)``: let another thread run. The address must not be 0."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.call(builder.inttoptr(args[0], ir.FunctionType(_I32, []).as_pointer()), [])
        return ir.Constant(_I32, 0)

    return types.int32(types.int64), generate
