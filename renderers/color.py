"""The sRGB transfer function (IEC 61966-2-1) for values and arrays. Kernels for images are in ``renderers.shading``."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_CHUNK_COLORS: Final = 1 << 13
"""Colours decoded in one call: contiguous and in the CPU's caches, a million take half the time."""


def srgb_from_linear(value: float) -> float:
    """Return the sRGB encoding of a linear value. The same formula applies outside of 0 .. 1."""
    return 1.055 * value ** (1.0 / 2.4) - 0.055 if value > 0.0031308 else 12.92 * value


def linear_from_srgb(value: float) -> float:
    """Return the linear value of an sRGB-encoded one. The same formula applies outside of 0 .. 1."""
    return ((value + 0.055) / 1.055) ** 2.4 if value > 0.04045 else value / 12.92


def linear_colors_from_srgb(colors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Decode sRGB colours, (N, 3) or (N, 4) float32, 0 to 1, to linear ones. Alpha, the fourth column, is copied."""
    linear = colors.copy()
    for begin in range(0, len(colors), _CHUNK_COLORS):
        chunk = linear[begin : begin + _CHUNK_COLORS, :3]
        chunk[:] = linear_values_from_srgb(chunk.copy())
    return linear


def srgb_colors_from_linear(colors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Encode linear colours, (N, 4) float32, clipped to 0 to 1, as sRGB. Alpha, the fourth column, is copied."""
    encoded = colors.copy()
    encoded[:, :3] = srgb_values_from_linear(np.clip(colors[:, :3], 0.0, 1.0))
    return encoded


def linear_values_from_srgb(encoded: NDArray[Any]) -> NDArray[Any]:
    """Return ``linear_from_srgb`` of every element, in the array's float type."""
    return np.where(encoded > 0.04045, ((encoded + 0.055) / 1.055) ** 2.4, encoded / 12.92)


def srgb_values_from_linear(linear: NDArray[Any]) -> NDArray[Any]:
    """Return ``srgb_from_linear`` of every element, in the array's float type."""
    return np.where(linear > 0.0031308, 1.055 * linear ** (1.0 / 2.4) - 0.055, 12.92 * linear)


LINEAR_FROM_BYTE: Final[NDArray[np.float32]] = linear_values_from_srgb(np.arange(256) / 255.0).astype(np.float32)
"""(256,) float32, linear value of each sRGB byte. Texels are decoded before filtering, as required by glTF 2.0."""
