"""Convert colours as users write them to the protocol's: red, green, blue and alpha from 0 to 1."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

ROUNDING: Final = 1e-5
"""Tolerance beyond 0 and 1 for floating-point numbers; the viewer clamps them."""


def rgba(value: ArrayLike) -> list[float]:
    """Return three or four numbers from 0 to 1.

    Args:
        value: three or four numbers from 0 to 1, a uint8 array (0 to 255), a CSS name, or ``#rgb``, ``#rgba``,
            ``#rrggbb``, ``#rrggbbaa``.
    Raises:
        ValueError: the value is none of these.
    """
    array = np.array(_parse_color(value), np.uint8) if isinstance(value, str) else np.asarray(value)
    numbers = array / 255.0 if array.dtype == np.uint8 else array.astype(np.float64)
    if numbers.shape not in ((3,), (4,)):
        raise ValueError(f"color must have 3 or 4 numbers, not shape {numbers.shape}")
    if np.isnan(numbers).any():
        raise ValueError("color must have numbers, not nan")
    check_range("color", numbers)
    channels: list[float] = numbers.tolist()
    return channels


def check_range(name: str, values: NDArray[Any]) -> None:
    """Check that colours or intensities are uint8, or from 0 to 1. NaN is allowed; the viewer shows it as 0.

    Raises:
        ValueError: a value is outside of 0 to 1, so that the viewer would clamp it.
    """
    if values.dtype == np.uint8 or not values.size:
        return
    low, high = values.min(), values.max()
    if np.isnan(high):  # fmin and fmax ignore NaN, at a tenth of the speed
        low, high = np.fmin.reduce(values, axis=None), np.fmax.reduce(values, axis=None)
    if low < -ROUNDING or high > 1.0 + ROUNDING:
        wrong = high if high > 1.0 + ROUNDING else low
        raise ValueError(f"{name} must be from 0 to 1, or a uint8 array from 0 to 255, not {wrong:g}")


def _parse_color(text: str) -> tuple[int, ...]:
    from PIL import ImageColor  # slow to import, and most clients write numbers

    try:
        channels = ImageColor.getrgb(text)
        if max(channels) <= 255:
            return channels
    except ValueError:
        pass
    raise ValueError(f"color {text[:40]!r} is neither a CSS name nor #rgb, #rgba, #rrggbb or #rrggbbaa")
