"""Types of the parameters of kernels: annotations that mypy and Numba both read.

A compiled function says once what it takes, and the compiler derives its signature from it:

    @kernel
    def brighten(image: Array2[np.float32], gain: F32) -> None: ...

    @inlined
    def saturate(color: F32x8) -> F32x8: ...

| annotation | in a kernel | to mypy |
|---|---|---|
| ``I64``, ``U8``, ``F32``, ... | a number of that many bits | ``int`` or ``float`` |
| ``bool`` | one byte | ``bool`` |
| ``Address`` | an address as a number; Python passes it | ``int`` |
| ``Pointer[F32]`` | C's ``float *``, exists within kernels only | a class |
| a subclass of ``structs.Struct`` | C's ``struct *`` | that class |
| ``F32x8``, ``F64x8``, ``I32x8``, ``Mask8`` | a vector of eight lanes, see ``simd`` | a class |
| ``Array2[np.float32]``, ``ReadOnly3[np.uint8]`` | a C-contiguous array of that rank | ``np.ndarray`` |
| ``tuple[..]``, a ``NamedTuple`` | the values side by side | itself |
| a ``TypeVar`` with constraints | one function for each of them | itself |
| a ``TypeVar`` with a bound | any type | itself |
"""

import inspect
import itertools
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Final,
    Generic,
    TypeAlias,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.numba_typing import typeof
from renderers.compiler.numba_typing import types as numba_types

types: Any = numba_types  # its stubs lack attributes

I64 = Annotated[int, types.int64]
I32 = Annotated[int, types.int32]
I8 = Annotated[int, types.int8]
U64 = Annotated[int, types.uint64]
U32 = Annotated[int, types.uint32]
U16 = Annotated[int, types.uint16]
U8 = Annotated[int, types.uint8]
F64 = Annotated[float, types.float64]
F32 = Annotated[float, types.float32]
Address = I64
"""The address of an array, a struct or machine code; 0: none."""

T = TypeVar("T")
Number = TypeVar("Number", I64, I32, F32, F64)
"""Type variable of functions for several types of numbers."""


class Pointer(Generic[T]):
    """Address of values of one type. ``p[i]`` reads and writes without a check."""

    if TYPE_CHECKING:

        def __getitem__(self, index: int) -> T: ...

        def __setitem__(self, index: int, value: T) -> None: ...


if TYPE_CHECKING:
    _Scalar = TypeVar("_Scalar", bound=np.generic)
    Array1: TypeAlias = NDArray[_Scalar]
    Array2: TypeAlias = NDArray[_Scalar]
    Array3: TypeAlias = NDArray[_Scalar]
    ReadOnly1: TypeAlias = NDArray[_Scalar]
    ReadOnly2: TypeAlias = NDArray[_Scalar]
    ReadOnly3: TypeAlias = NDArray[_Scalar]

    def i64(value: Any) -> int: ...
    def i32(value: Any) -> int: ...
    def u64(value: Any) -> int: ...
    def u32(value: Any) -> int: ...
    def u16(value: Any) -> int: ...
    def u8(value: Any) -> int: ...
    def f64(value: Any) -> float: ...
    def f32(value: Any) -> float: ...

else:

    class _ArrayOfRank:
        """``Array2[np.float32]``: the Numba type of C-contiguous arrays of one rank."""

        def __init__(self, rank: int, *, readonly: bool) -> None:
            self._rank, self._readonly = rank, readonly

        def __getitem__(self, scalar: type[np.generic]) -> Any:
            dtype = typeof(scalar(0))
            return types.Array(dtype, self._rank, "C", readonly=self._readonly)

    Array1, Array2, Array3 = (_ArrayOfRank(rank, readonly=False) for rank in (1, 2, 3))
    ReadOnly1, ReadOnly2, ReadOnly3 = (_ArrayOfRank(rank, readonly=True) for rank in (1, 2, 3))
    i64, i32, f64, f32 = np.int64, np.int32, np.float64, np.float32
    u64, u32, u16, u8 = np.uint64, np.uint32, np.uint16, np.uint8

ANY: Final = object()
"""In place of a Numba type: any type."""
_PYTHON_TYPES: Final = {None: types.none, bool: types.boolean, int: types.int64, float: types.float64}
_NAMES: Final = {types.boolean: "bool", types.none: "None"}


def numba_type(annotation: Any, bound: Mapping[Any, Any] | None = None) -> Any:
    """Return the Numba type of an annotation; ``bound``: annotations that its type variables stand for.

    Raises:
        TypeError: kernels have no such type.
    """
    arguments = get_args(annotation)
    origin = get_origin(annotation) or annotation
    if isinstance(annotation, TypeVar):
        return numba_type((bound or {})[annotation]) if annotation.__constraints__ else ANY
    if isinstance(annotation, types.Type):
        return annotation
    if origin is Annotated:
        return arguments[1]
    if annotation in _PYTHON_TYPES:
        return _PYTHON_TYPES[annotation]
    if origin is Pointer:
        return types.CPointer(numba_type(arguments[0], bound))
    if origin is tuple:
        return types.BaseTuple.from_types([numba_type(each, bound) for each in arguments])
    if hasattr(annotation, "numba_type"):  # vectors and structs
        return annotation.numba_type
    if isinstance(origin, type) and issubclass(origin, tuple):
        # The parameters of a generic NamedTuple are its fields' type variables.
        own = {
            p: numba_type(each, bound) for p, each in zip(getattr(origin, "__parameters__", ()), arguments, strict=True)
        }
        fields = get_type_hints(origin, include_extras=True).values()
        return types.BaseTuple.from_types([numba_type(each, own) for each in fields], origin)
    raise TypeError(f"{annotation!r} is no type of kernels")


def type_of(value: Any, wanted: Any) -> Any:
    """Return the Numba type of an argument; of Python's numbers the wanted one, if that is a number of their kind."""
    kinds = {int: (types.Integer, types.Float), float: (types.Float,)}.get(type(value), ())
    if isinstance(wanted, kinds):
        return wanted
    return typeof(value)


def name_of(numba: Any) -> str:
    """Return how an annotation spells a Numba type, for messages."""
    if isinstance(numba, types.CPointer):
        return f"Pointer[{name_of(numba.dtype)}]"
    if isinstance(numba, types.Array):
        kind = "Array" if numba.mutable else "ReadOnly"
        return f"{kind}{numba.ndim}[np.{numba.dtype}]" + ("" if numba.layout == "C" else ", not C-contiguous")
    if isinstance(numba, types.Integer | types.Float):
        return f"{'F' if isinstance(numba, types.Float) else 'I' if numba.signed else 'U'}{numba.bitwidth}"
    return _NAMES.get(numba, str(numba))


def _type_variables(annotation: Any) -> set[Any]:
    if isinstance(annotation, TypeVar):
        return {annotation} if annotation.__constraints__ else set()
    return set().union(*map(_type_variables, get_args(annotation)))


def _fits(given: Any, wanted: Any) -> bool:
    """Return True for the same types, and for numbers all of which the wanted type has."""
    if wanted is ANY or given == wanted:
        return True
    if isinstance(wanted, types.Float):
        return isinstance(given, types.Float) and given.bitwidth < wanted.bitwidth
    if not isinstance(wanted, types.Integer) or isinstance(given, types.Boolean):
        return isinstance(wanted, types.Integer)
    is_wider = isinstance(given, types.Integer) and given.bitwidth < wanted.bitwidth
    return is_wider and (wanted.signed or not given.signed)


class KernelSignature:
    """The types that the annotations of a compiled function name."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self.name: Final = f"{function.__module__}.{function.__qualname__}"

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(inspect.signature(self._function).parameters)

    @cached_property
    def _variants(self) -> list[tuple[tuple[Any, ...], Any]]:
        """Numba types of the arguments and of the result, for each choice of the type variables."""
        annotations = inspect.get_annotations(self._function, eval_str=True)
        if missing := [name for name in (*self.names, "return") if name not in annotations]:
            raise TypeError(f"{self.name} has no annotation of {missing[0]!r}")
        variables = sorted(set().union(*map(_type_variables, annotations.values())), key=str)
        choices = [
            dict(zip(variables, each, strict=True))
            for each in itertools.product(*(v.__constraints__ for v in variables))
        ]
        return [
            (
                tuple(numba_type(annotations[name], bound) for name in self.names),
                numba_type(annotations["return"], bound),
            )
            for bound in choices
        ]

    @property
    def arguments(self) -> tuple[Any, ...]:
        """Numba types of the arguments of a function without type variables."""
        ((arguments, _),) = self._variants
        return arguments

    def accept(self, given: Sequence[Any]) -> tuple[Any, ...]:
        """Return the types of the signature that arguments of these types are passed as. Numbers may be widened.

        Raises:
            TypeError: an argument has another type; the message names its parameter.
        """
        given = tuple(given)
        if any(given == arguments for arguments, _ in self._variants):
            return given
        for arguments, _ in self._variants:
            if all(map(_fits, given, arguments)):
                return tuple(a if b is ANY else b for a, b in zip(given, arguments, strict=True))
        wanted = self._variants[0][0]
        for name, a, b in zip(self.names, given, wanted, strict=True):
            if not _fits(a, b):
                raise TypeError(f"{self.name}: {name} is {name_of(a)}, wanted {name_of(b)}")
        raise TypeError(f"{self.name}: {', '.join(map(name_of, given))} do not go together")

    def check_result(self, given: Sequence[Any], result: Any) -> None:
        """Raise TypeError if the function returns another type than it says, for arguments of these types."""
        for arguments, wanted in self._variants:
            if all(b in (a, ANY) for a, b in zip(given, arguments, strict=True)) and result == wanted:
                return
        raise TypeError(f"{self.name} returns {name_of(result)}, not {name_of(self._variants[0][1])}")
