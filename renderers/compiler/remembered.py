"""What Numba's type inference was answered once, it need not ask again.

For every call and every operator Numba walks through all that is registered under the name (of ``+`` several dozens,
from dates to strings), builds an object for each and asks it whether it takes these types; and inference asks for each
expression of a function again until nothing changes. All kernels together have 67,000 such questions, of which 1,600
differ: to answer them anew each time takes a quarter of the time that compiling takes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from numba.core import types
from numba.core.targetconfig import ConfigStack

_Answer = Callable[[Any, Any, tuple[Any, ...], dict[str, Any]], Any]


class _Memory:
    """Signatures, and which implementation is meant, by function, types of the arguments and the options that are
    compiled with."""

    def __init__(self, answer: _Answer) -> None:
        self._answer = answer
        self._answers: dict[tuple[Any, ...], tuple[Any, Any]] = {}
        self._options: Any = None
        self._said = repr(None)

    def resolve(self, function: Any, context: Any, args: Any, kws: dict[str, Any]) -> Any:
        """As ``types.Function.get_call_type``: the signature; raises what that raises, every time."""
        if kws:
            return self._answer(function, context, args, kws)
        key = (function, context, *args, self._current())
        known = self._answers.get(key)
        if known is not None:
            signature, implementation = known
            function._impl_keys[signature.args] = implementation  # of these options: others may have come between
            return signature
        signature = self._answer(function, context, args, kws)
        # A type that is not known in full yet may be another one when it is asked for again.
        if signature is not None and signature.is_precise() and all(each.is_precise() for each in args):
            self._answers[key] = signature, function._impl_keys[signature.args]
        return signature

    def _current(self) -> str:
        """The options: functions of Numba's own, as ``max``, are compiled with those of who calls them."""
        options = ConfigStack.top_or_none()
        if options is not self._options:
            self._options, self._said = options, repr(options)
        return self._said


def remember(functions: Any = types.Function) -> None:
    """From now on, in this process; for one that compiles and ends.

    What is registered for types that were asked for before is not seen any more.

    Args:
        functions: Numba's class of builtin functions, operators and intrinsics.
    """
    memory: Final = _Memory(functions.get_call_type)

    def get_call_type(function: Any, context: Any, args: Any, kws: dict[str, Any]) -> Any:
        return memory.resolve(function, context, args, kws)

    functions.get_call_type = get_call_type
