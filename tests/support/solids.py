"""Solids of every type, from the fields of their classes: a new subclass of ``Solid`` is in all tests that use this."""

from typing import Any, Final, get_type_hints

from hypothesis import strategies as st

from scenegate.messages.geometry import Solid, fields_of
from scenegate.transforms import Vector

TYPES: Final = tuple(Solid.__subclasses__())


def solids(numbers: st.SearchStrategy[float]) -> st.SearchStrategy[Solid]:
    """Return a strategy for solids of all types, with these numbers."""
    by_type: dict[Any, st.SearchStrategy[Any]] = {
        float: numbers,
        bool: st.booleans(),
        Vector: st.tuples(numbers, numbers, numbers),
    }
    return st.one_of(
        [
            st.builds(solid, **{field.name: by_type[get_type_hints(solid)[field.name]] for field in fields_of(solid)})
            for solid in TYPES
        ]
    )


def example(solid: type[Solid]) -> Solid:
    """Return a solid of a type whose fields have different values: 1, 2, 3, or True."""
    values: dict[Any, Any] = {bool: True, Vector: (1.0, 2.0, 3.0)}
    hints = get_type_hints(solid)
    return solid(**{field.name: values.get(hints[field.name], 1.0 + i) for i, field in enumerate(fields_of(solid))})
