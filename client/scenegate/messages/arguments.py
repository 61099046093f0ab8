"""Read and describe values of users, for errors that name the argument and its value."""

import reprlib
from typing import Any

import numpy as np
from numpy.typing import NDArray


def describe(value: object) -> str:
    """Return a short description of any value of a user, about 40 characters, for an error text."""
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}" if value.ndim else describe(value.item())
    if value is None or isinstance(value, (str, int, float)):
        text = repr(value)
    elif isinstance(value, (tuple, list, dict)):
        text = reprlib.repr(value)
    else:
        name = type(value).__name__
        text = f"{'an' if name[0] in 'AEIOUaeiou' else 'a'} {name}"
    return text if len(text) <= 40 else f"{text[:40]}…"


def as_array(values: Any, wanted: str, dtype: type[np.generic] | None = None) -> NDArray[Any]:
    """Return values as array; raise ValueError, which begins with ``wanted``, if they are no array of the type."""
    try:
        return np.asarray(values, dtype)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{wanted}, not {describe(values)}") from None
