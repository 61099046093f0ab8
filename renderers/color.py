"""The sRGB transfer function (IEC 61966-2-1) on single values and on arrays; pictures have kernels of their own."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray


def srgb_from_linear(value: float) -> float:
    """Linear light to what displays show, 0..1; values beyond follow the same curve."""
    return 1.055 * value ** (1.0 / 2.4) - 0.055 if value > 0.0031308 else 12.92 * value


def linear_from_srgb(value: float) -> float:
    """What displays show to linear light, 0..1; values beyond follow the same curve."""
    return ((value + 0.055) / 1.055) ** 2.4 if value > 0.04045 else value / 12.92


def linear_colors_from_srgb(colors: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N, 3) or (N, 4) colours in 0..1 as displays show them, to linear light; a fourth column, alpha, stays."""
    linear = colors.copy()
    shown = colors[:, :3]
    linear[:, :3] = linear_values_from_srgb(shown)
    return linear


def linear_values_from_srgb(shown: NDArray[Any]) -> NDArray[Any]:
    """``linear_from_srgb`` of every element, in the array's own float type."""
    return np.where(shown > 0.04045, ((shown + 0.055) / 1.055) ** 2.4, shown / 12.92)


def srgb_values_from_linear(linear: NDArray[Any]) -> NDArray[Any]:
    """``srgb_from_linear`` of every element, in the array's own float type."""
    return np.where(linear > 0.0031308, 1.055 * linear ** (1.0 / 2.4) - 0.055, 12.92 * linear)


BYTE_VALUES: Final[NDArray[np.float32]] = linear_values_from_srgb(np.arange(256) / 255.0).astype(np.float32)
"""(256,) float32: the linear value of an sRGB byte. Texels are converted before they are filtered, as the glTF
specification asks."""
