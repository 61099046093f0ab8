"""The sRGB transfer function (IEC 61966-2-1) on single values and on rows; pictures have kernels of their own."""

from __future__ import annotations

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
    linear[:, :3] = np.where(shown > 0.04045, ((shown + 0.055) / 1.055) ** 2.4, shown / 12.92)
    return linear
