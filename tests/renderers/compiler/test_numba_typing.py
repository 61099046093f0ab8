"""Types of our own in kernels: functions, operators, fields and signatures."""

import itertools
import math
import operator
from typing import Any

import numpy as np
import pytest
from llvmlite import ir
from numba import extending, njit, types
from numba.core.errors import TypingError

from renderers.compiler.cache_locator import watch_compiler
from renderers.compiler.numba_typing import define_fields, define_operator, intrinsic

_extending: Any = extending
_I64 = ir.IntType(64)


class Minutes(types.Type):
    """A duration, as int64 minutes."""

    def __init__(self) -> None:
        super().__init__("Minutes")


minutes = Minutes()


@_extending.register_model(Minutes)
class _Model(_extending.models.PrimitiveModel):  # type: ignore[misc]  # Numba has no stubs for it
    def __init__(self, manager: Any, numba_type: Minutes) -> None:
        super().__init__(manager, numba_type, _I64.as_pointer())


@intrinsic
def minutes_at(typing_context: Any, address: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], _I64.as_pointer())

    return minutes(types.int64), generate


define_operator(
    operator.mod,
    (Minutes, types.Integer),
    lambda a, b: types.int64(minutes, types.int64) if a is minutes and isinstance(b, types.Integer) else None,
    lambda builder, sig, a, b: builder.srem(builder.load(a), b),
)
define_fields(
    Minutes,
    lambda owner, name: types.int64 if name == "hours" else None,
    lambda context, builder, owner, value, name: builder.sdiv(builder.load(value), ir.Constant(_I64, 60)),
    lambda context, builder, sig, args, name: builder.store(
        builder.mul(context.cast(builder, args[1], sig.args[1], types.int64), ir.Constant(_I64, 60)), args[0]
    ),
)


@njit
def use(address, base):
    duration = minutes_at(address)
    before = duration.hours, duration % base
    duration.hours = base
    return before, duration.hours, 7 % base


def test_fields_and_operators_of_our_types() -> None:
    memory = np.array([200], np.int64)
    assert use(memory.ctypes.data, np.int32(60)) == ((3, 20), 60, 7)
    assert memory[0] == 3600


@intrinsic
def hours_of(typing_context: Any, duration: Any) -> Any:
    if not isinstance(duration, types.Integer):
        return None

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.sdiv(args[0], ir.Constant(_I64, 60))

    return types.int64(types.int64), generate


@njit
def hours(duration):
    return hours_of(duration)


def test_functions_of_our_own_convert_arguments_and_refuse_other_types() -> None:
    assert hours(200) == hours(np.int32(200)) == 3
    with pytest.raises(TypingError):
        hours(200.0)


@njit
def extremes(a, b, c):
    return min(a, b), max(a, b), min(a, b, c), max(a, b, c)


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int32, np.int64, np.uint32])
def test_minimum_and_maximum_are_those_of_python(dtype: Any) -> None:
    numbers: tuple[float, ...] = (0, 1, 2, 2**31 - 1)
    if dtype is not np.uint32:
        numbers = (*numbers, -1)
    if issubclass(dtype, np.floating):
        numbers = (*numbers, math.nan, math.inf, -math.inf, -0.0)
    for a, b, c in itertools.product(map(dtype, numbers), repeat=3):
        results, expected = extremes(a, b, c), (min(a, b), max(a, b), min(a, b, c), max(a, b, c))
        assert np.array(results, dtype).tobytes() == np.array(expected, dtype).tobytes(), (a, b, c)


@njit
def clamped(value):
    return max(min(value, 10, 11, 12), 1, 2, 3)  # four numbers: no other test has compiled Numba's own for them


def test_minimum_and_maximum_are_not_compiled_as_functions() -> None:
    compiled: list[None] = []
    with watch_compiler(lambda *_: compiled.append(None)):
        assert clamped(12) == 10
    assert len(compiled) == 1
