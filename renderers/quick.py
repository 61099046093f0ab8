"""Frozen dataclasses that are made as fast as others."""

from __future__ import annotations

import dataclasses
import inspect
from typing import Any, Final, TypeVar

import msgspec

T = TypeVar("T")

_MADE: Final = frozenset(
    {
        "__annotations__",
        "__delattr__",
        "__dict__",
        "__eq__",
        "__getstate__",
        "__hash__",
        "__init__",
        "__match_args__",
        "__repr__",
        "__setattr__",
        "__setstate__",
        "__slots__",
        "__weakref__",
    }
)
"""Members by ``dataclasses``, in place of which msgspec puts its own."""


def quick(cls: type[T]) -> type[T]:
    """A frozen slotted dataclass as msgspec makes it, in C: readers make thousands of meshes and materials, and the
    ``__init__`` of ``dataclasses`` calls ``object.__setattr__`` with the name of every field, which takes ten times as
    long. It is still one for the functions of ``dataclasses``.

    Raises:
        TypeError: it is none, or has fields that need more than being set.
    """
    if "__slots__" not in cls.__dict__ or hasattr(cls, "__post_init__"):
        raise TypeError(f"{cls.__name__} has no slots, or a __post_init__")
    fields = dataclasses.fields(cls)  # type: ignore[arg-type]  # whoever is none gets the TypeError
    if [*inspect.signature(cls).parameters] != [field.name for field in fields]:
        raise TypeError(f"{cls.__name__} is not made from its fields alone")
    if cls.__bases__ != (object,):
        raise TypeError(f"{cls.__name__} has a base")
    for field in fields:
        if field.kw_only or field.default_factory is not dataclasses.MISSING:
            raise TypeError(f"{cls.__name__}.{field.name} is no field that is only set")
    slots: tuple[str, ...] = cls.__dict__["__slots__"]
    parameters: Any = cls.__dict__["__dataclass_params__"]
    if not parameters.frozen or parameters.order:
        raise TypeError(f"{cls.__name__} is not frozen, or ordered")
    members = {name: value for name, value in vars(cls).items() if name not in _MADE and name not in slots}
    kind: type[T] = msgspec.defstruct(  # type: ignore[assignment]  # of the same fields and methods
        cls.__name__,
        [
            (field.name, field.type)
            if field.default is dataclasses.MISSING
            else (field.name, field.type, field.default)
            for field in fields
        ],
        namespace=members,
        module=cls.__module__,
        frozen=True,
        eq=parameters.eq,
        weakref="__weakref__" in slots,
    )
    return kind
