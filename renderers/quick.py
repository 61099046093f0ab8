"""Frozen dataclasses that are made as fast as others."""

from __future__ import annotations

import dataclasses
import inspect
import sys
from typing import Any, Final, TypeVar

T = TypeVar("T")

_SET_CLASS: Final[Any] = object.__dict__["__class__"].__set__


def _refuse(cls: type) -> None:
    raise TypeError(f"{cls.__name__} cannot have {cls.__bases__[0].__name__} as a base: it is made with other slots")


def quick(cls: type[T]) -> type[T]:
    """A frozen slotted dataclass as a class without slots of its own on one with these slots that is not frozen: values
    are of that one while their fields are set.

    The ``__init__`` of ``dataclasses`` calls ``object.__setattr__`` with the name of every field, which takes four
    times as long; readers make thousands of meshes and materials.

    Raises:
        TypeError: it is none, or has fields that need more than being set. Also where it is made the base of another.
    """
    if "__slots__" not in cls.__dict__ or hasattr(cls, "__post_init__"):
        raise TypeError(f"{cls.__name__} has no slots, or a __post_init__")
    fields = dataclasses.fields(cls)  # type: ignore[arg-type]  # whoever is none gets the TypeError
    if [*inspect.signature(cls).parameters] != [field.name for field in fields]:
        raise TypeError(f"{cls.__name__} is not made from its fields alone")
    if cls.__bases__ != (object,):
        raise TypeError(f"{cls.__name__} has a base")
    slots: tuple[str, ...] = cls.__dict__["__slots__"]
    home, given = vars(sys.modules[cls.__module__]), cls.__init__
    parameters, statements = [], []
    names: dict[str, Any] = dict(home)
    for field in fields:
        if field.kw_only or field.default_factory is not dataclasses.MISSING:
            raise TypeError(f"{cls.__name__}.{field.name} is no field that is only set")
        default = field.default is not dataclasses.MISSING
        names[f"_default_{field.name}"] = field.default
        parameters.append(f"{field.name}=_default_{field.name}" if default else field.name)
        statements.append(f"    self.{field.name} = {field.name}\n")
    members = {name: value for name, value in vars(cls).items() if name not in (*slots, "__weakref__", "__dict__")}
    opened = type(f"_Open{cls.__name__}", (), {"__slots__": slots, "__module__": cls.__module__})
    made: Any = type(cls)(cls.__name__, (opened,), {**members, "__slots__": ()})  # type: ignore[misc]  # a metaclass
    names |= {"_set_class": _SET_CLASS, "_opened": opened, "_made": made}
    head = f"def __init__(self, {', '.join(parameters)}):\n    _set_class(self, _opened)\n"
    exec(head + "".join(statements) + "    self.__class__ = _made\n", names)  # noqa: S102 - names of fields
    init = names["__init__"]
    init.__annotations__, init.__qualname__, init.__module__ = given.__annotations__, given.__qualname__, cls.__module__
    made.__init__, made.__init_subclass__ = init, classmethod(_refuse)
    kind: type[T] = made
    return kind
