"""Answers of type inference are remembered by what they depend on, and by nothing less."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit, types
from numba.core.compiler import Flags
from numba.core.targetconfig import ConfigStack
from numba.core.typing import signature

from renderers.compiler.remembered import remember


class Functions:
    """Stands for ``types.Function``; says how often it was asked."""

    asked = 0
    known: Any = signature(types.int64, types.int64)

    def __init__(self) -> None:
        self._impl_keys: dict[Any, object] = {}

    def get_call_type(self, context: object, args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        type(self).asked += 1
        if types.unicode_type in args:
            raise TypeError("not a number")
        if self.known is not None:
            self._impl_keys[self.known.args] = object()
        return self.known


@pytest.fixture
def functions() -> type[Functions]:
    class Fresh(Functions):
        asked = 0

    remember(Fresh)
    return Fresh


def test_the_same_question_is_asked_once(functions: type[Functions]) -> None:
    function, context = functions(), object()
    for _ in range(3):
        assert function.get_call_type(context, (types.int64,), {}) is Functions.known
    assert functions.asked == 1


def test_the_implementation_is_that_of_the_answer(functions: type[Functions]) -> None:
    function, context = functions(), object()
    function.get_call_type(context, (types.int64,), {})
    (first,) = function._impl_keys.values()
    options = Flags()
    options.error_model = "numpy"
    with ConfigStack().enter(options):
        function.get_call_type(context, (types.int64,), {})
    assert first not in function._impl_keys.values()
    function.get_call_type(context, (types.int64,), {})
    assert list(function._impl_keys.values()) == [first]


def test_another_function_type_context_or_option_is_another_question(functions: type[Functions]) -> None:
    function, context = functions(), object()
    function.get_call_type(context, (types.int64,), {})
    function.get_call_type(context, (types.int32,), {})
    function.get_call_type(context, (types.int64, types.int64), {})
    function.get_call_type(object(), (types.int64,), {})
    functions().get_call_type(context, (types.int64,), {})
    assert functions.asked == 5
    for model in ("python", "numpy", "numpy"):
        options = Flags()
        options.error_model = model
        with ConfigStack().enter(options):
            function.get_call_type(context, (types.int64,), {})
    assert functions.asked == 7


def test_what_is_not_settled_is_asked_again(functions: type[Functions]) -> None:
    function, context = functions(), object()
    for _ in range(2):
        function.get_call_type(context, (types.int64,), {"named": types.int64})
        function.get_call_type(context, (types.List(types.undefined),), {})
        with pytest.raises(TypeError):
            function.get_call_type(context, (types.unicode_type,), {})
    functions.known = signature(types.List(types.undefined), types.int64)
    for _ in range(2):
        function.get_call_type(context, (types.float64,), {})
    functions.known = None
    for _ in range(2):
        assert function.get_call_type(context, (types.float32,), {}) is None
    assert functions.asked == 10


def test_numba_compiles_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(types.Function, "get_call_type", types.Function.get_call_type)  # as it was, at the end

    def mixed(values: Any) -> Any:
        total = 0.0
        for k in range(len(values)):
            total += max(values[k], 2) * 3 + min(k, 2) / 4 - (k % 3 == 1)
        return total, np.zeros(3) + total, (1, 2.5, "a")[1]

    plain: Any = njit(mixed)
    remember()
    remembering: Any = njit(mixed)
    for values in (np.arange(5), np.linspace(0, 3, 7), np.array([1, 2], np.uint8)):
        ours, theirs = remembering(values), plain(values)
        assert ours[0] == theirs[0]
        assert np.array_equal(ours[1], theirs[1])
        assert ours[2] == theirs[2]
    assert [str(s) for s in remembering.nopython_signatures] == [str(s) for s in plain.nopython_signatures]
