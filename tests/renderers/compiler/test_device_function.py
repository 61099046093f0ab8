"""Device functions are linked into the kernels that call them, and get no machine code of their own."""

from typing import Any, TypeVar

import numpy as np
from numba import njit

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import F32, F64, I64, Array1, f32

Value = TypeVar("Value", I64, F32, F64)


@inlined
def square(x: Value) -> Value:
    return x * x


@device_function
def sum_of_squares(values: Array1[np.float64], count: I64) -> F64:
    total = 0.0
    for k in range(count):
        total += square(values[k])
    return total


@njit
def length(values):
    copy = np.empty(len(values), np.float64)
    for k in range(len(values)):
        copy[k] = values[k]
    return np.sqrt(sum_of_squares(copy, len(copy))), square(2), square(f32(3.0))


def test_functions_are_linked_into_what_calls_them() -> None:
    assert length(np.array([3.0, 4.0])) == (5.0, 4, 9.0)
    functions: Any = ((square, 3), (sum_of_squares, 1))
    for function, versions in functions:
        assert len(function.overloads) == versions
        for result in function.overloads.values():
            library, name = result.library, result.fndesc.llvm_func_name
            assert name in {f.name for f in library.get_defined_functions()}
            assert library.get_pointer_to_function(name) == 0
            assert not library.codegen._engine.is_symbol_defined(name)  # noqa: SLF001 - no public name tells it
    (whole,) = length.overloads.values()
    assert whole.library.get_pointer_to_function(whole.fndesc.llvm_func_name) != 0
