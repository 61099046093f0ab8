"""Operators, fields and functions of our own Numba types, and the names of Numba and llvmlite that they are made of.

Four files import the libraries: this one, ``device_function`` (the compiler's passes), ``cache_locator`` (the cache and
events) and ``cache_folder`` (the CPU's name). Private API is needed since the public ``numba.extending`` does not
replace it: ``overload`` compiles a function for each use, and the functions of ``type_callable`` are tried after
Numba's own. ``tests/renderers/compiler/test_numba_typing.py`` fails when Numba changes it.
"""

from collections.abc import Callable
from typing import Any, ClassVar, Final

from llvmlite import ir as ir
from numba import extending as numba_extending
from numba import typeof as numba_typeof
from numba import types as types
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_global

extending: Final[Any] = numba_extending  # the stubs lack most names
typeof: Final[Any] = numba_typeof


def define_function(key: Any, definition: Callable[..., Any]) -> None:
    """Define what a call of ``key``, a function or a class, does in kernels.

    Args:
        definition: takes the typing context and the arguments' types; returns the signature and a function
            ``generate(context, builder, signature, arguments)`` that emits the instructions and returns the result, or
            None if the types are wrong.
    """
    generators: dict[Any, Callable[..., Any]] = {}
    key_of_template = key

    class Template(AbstractTemplate):
        key = key_of_template

        def generic(self, args: Any, kws: Any) -> Any:
            typed = None if kws else definition(self.context, *args)
            if typed is None:
                return None
            signature, generators[signature.args] = typed
            return signature

    def lower(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return generators[signature.args](context, builder, signature, args)

    infer_global(key, types.Function(Template))
    extending.lower_builtin(key, types.VarArg(types.Any))(lower)


def intrinsic(definition: Callable[..., Any]) -> Any:
    """Decorate the definition of a function for kernels whose instructions we emit, as for ``define_function``.

    Numba's own decorator refreshes all of its registries for every call that it types: 4 % of the compile time.
    """

    def function(*arguments: object) -> object:
        raise NotImplementedError("only kernels can call it")

    function.__doc__ = definition.__doc__
    define_function(function, definition)
    return function


def define_operator(
    key: Callable[..., Any],
    operands: tuple[type[types.Type] | types.VarArg, ...],
    signature_of: Callable[..., Any],
    emit: Callable[..., Any],
) -> None:
    """Define an operator of our types.

    Args:
        key: the operator, from the module ``operator``.
        operands: classes of the operands' Numba types.
        signature_of: returns the signature for the operands' types, as ``result(a, b)`` of Numba types, or None if they
            are not ours. Operands are converted to its types.
        emit: ``emit(builder, signature, *operands)`` emits its instructions and returns the result.
    """

    class Template(AbstractTemplate):
        metadata: ClassVar[dict[str, str]] = {"target": "cpu"}  # type: ignore[misc]  # tried before Numba's own

        def generic(self, args: Any, kws: Any) -> Any:
            return None if kws else signature_of(*args)

    def lower(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return emit(builder, signature, *args)

    register_template: Any = infer_global
    register_template(key)(Template)
    extending.lower_builtin(key, *operands)(lower)


def _define_extreme(key: Callable[..., Any], comparison: str) -> None:
    """Define ``min`` or ``max`` of numbers of one type, for the whole process: the results are Numba's, NaN included.

    Numba compiles its own as a function for each kernel and number of arguments: a twentieth of all compile time.
    """

    def signature_of(*arguments: Any) -> Any:
        unliteral: Any = types.unliteral  # the type of a constant without its value
        (number, *others) = kinds = tuple(map(unliteral, arguments))
        is_ours = number in types.signed_domain | types.real_domain and others and {*others} == {number}
        return number(*kinds) if is_ours else None

    def emit(builder: Any, signature: Any, result: Any, *others: Any) -> Any:
        is_float = isinstance(signature.return_type, types.Float)
        compare = builder.fcmp_ordered if is_float else builder.icmp_signed
        for other in others:
            result = builder.select(compare(comparison, other, result), other, result)
        return result

    define_operator(key, (types.VarArg(types.Number),), signature_of, emit)


_define_extreme(min, "<")
_define_extreme(max, ">")


def define_fields(
    owner: type[types.Type], field_type: Callable[..., Any], load: Callable[..., Any], store: Callable[..., Any]
) -> None:
    """Define the fields of all types of a class.

    Args:
        owner: class of Numba types.
        field_type: ``field_type(type, name)`` returns a field's type, or None if there is no such field.
        load: ``load(context, builder, type, value, name)`` emits its instructions and returns the field.
        store: ``store(context, builder, signature, (value, field), name)`` emits the assignment.
    """

    class Fields(AttributeTemplate):
        key = owner

        def generic_resolve(self, value: Any, attr: str) -> Any:  # type: ignore[override]  # Numba's stubs are wrong
            return field_type(value, attr)

    extending.infer_getattr(Fields)
    extending.lower_getattr_generic(owner)(load)
    extending.lower_setattr_generic(owner)(store)
