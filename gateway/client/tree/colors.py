"""Colours as users write them, as the protocol has them: red, green, blue and alpha from 0 to 1."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

ROUNDING: Final = 1e-5
"""How far floating-point numbers may be outside of 0 to 1; the viewer clamps them."""


def rgba(value: ArrayLike) -> list[float]:
    """Three or four numbers from 0 to 1.

    Args:
        value: three or four numbers from 0 to 1, a uint8 array (0 to 255), a CSS name, or ``#rgb``, ``#rgba``,
            ``#rrggbb``, ``#rrggbbaa``.
    Raises:
        ValueError: something else; the message says what.
    """
    array = np.array(_parsed(value), np.uint8) if isinstance(value, str) else np.asarray(value)
    numbers = array / 255.0 if array.dtype == np.uint8 else array.astype(np.float64)
    if numbers.shape not in ((3,), (4,)):
        raise ValueError(f"color must have 3 or 4 numbers, not shape {numbers.shape}")
    if np.isnan(numbers).any():
        raise ValueError("color must have numbers, not nan")
    check_range("color", numbers)
    listed: list[float] = numbers.tolist()
    return listed


def check_range(name: str, values: NDArray[Any]) -> None:
    """Checks an array of colours or intensities: uint8, or from 0 to 1. NaN is allowed, the viewer takes it for 0.

    Raises:
        ValueError: some are outside, so that the viewer would clamp them.
    """
    if values.dtype == np.uint8 or not values.size:
        return
    least, most = values.min(), values.max()
    if np.isnan(most):  # a tenth as fast
        least, most = np.fmin.reduce(values, axis=None), np.fmax.reduce(values, axis=None)
    if least < -ROUNDING or most > 1.0 + ROUNDING:
        wrong = most if most > 1.0 + ROUNDING else least
        raise ValueError(f"{name} must be from 0 to 1, or a uint8 array from 0 to 255, not {wrong:g}")


def _parsed(text: str) -> tuple[int, ...]:
    from PIL import ImageColor  # takes a tenth of a second, and most clients write numbers

    try:
        found = ImageColor.getrgb(text)
        if max(found) <= 255:
            return found
    except ValueError:
        pass
    raise ValueError(f"color {text[:40]!r} is neither a CSS name nor #rgb, #rgba, #rrggbb or #rrggbbaa")
