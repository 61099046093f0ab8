"""Frozen dataclasses that are made as fast as others."""

from __future__ import annotations

import dataclasses
import inspect
import sys
from typing import TypeVar

T = TypeVar("T")


def quick(cls: type[T]) -> type[T]:
    """Gives a frozen slotted dataclass an ``__init__`` that calls the descriptors of its slots.

    The one of ``dataclasses`` calls ``object.__setattr__`` with the name of every field, which takes twice as
    long; readers make thousands of meshes and materials.

    Raises:
        TypeError: it is none, or has fields that need more than being set.
    """
    if "__slots__" not in cls.__dict__ or hasattr(cls, "__post_init__"):
        raise TypeError(f"{cls.__name__} has no slots, or a __post_init__")
    fields = dataclasses.fields(cls)  # type: ignore[arg-type]  # whoever is none gets the TypeError
    if [*inspect.signature(cls).parameters] != [field.name for field in fields]:
        raise TypeError(f"{cls.__name__} is not made from its fields alone")
    parameters, statements, names = [], ["    pass"], dict(vars(sys.modules[cls.__module__]))
    for field in fields:
        if field.kw_only or field.default_factory is not dataclasses.MISSING:
            raise TypeError(f"{cls.__name__}.{field.name} is no field that is only set")
        default = field.default is not dataclasses.MISSING
        names[f"_set_{field.name}"] = getattr(cls, field.name).__set__
        names[f"_default_{field.name}"] = field.default
        parameters.append(f"{field.name}=_default_{field.name}" if default else field.name)
        statements.append(f"    _set_{field.name}(self, {field.name})")
    given = cls.__init__
    exec(f"def __init__(self, {', '.join(parameters)}):\n" + "\n".join(statements), names)  # noqa: S102 - names of fields
    made = names["__init__"]
    made.__annotations__, made.__qualname__, made.__module__ = given.__annotations__, given.__qualname__, cls.__module__
    cls.__init__ = made  # type: ignore[method-assign]  # as dataclasses does
    return cls
