"""Gamma of the looks ``pbr`` and ``gltf``: encoding of linear light as bytes, and decoding."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.kernel_types import F32, Pointer
from renderers.compiler.simd import F32x8, I32x8
from renderers.shading.level_cells import CELL_BITS, CELL_SIZE, cell_starts, level_cells, level_thresholds
from renderers.shading.vec3 import saturate

GAMMA: Final = 2.2
"""VTK's physically based shader ends with ``pow(color, 1.0 / 2.2)``, not with the piecewise sRGB function."""

_STEPS: Final = 4096
"""Number of cells of LINEAR_FROM_GAMMA."""
_MIN_LINEAR: Final = np.float32(2.0**-40)
"""Smaller linear values are encoded as 0, an error of a thousandth of a level."""
_MIN_LINEAR_BITS: Final = int(_MIN_LINEAR.view(np.int32))


def _gamma_from_linear() -> NDArray[np.float32]:
    """Return ``c^(1/2.2)`` of every 2^16th float32 from _MIN_LINEAR to 1, and once more for interpolation, (5122,)."""
    linear = cell_starts(_MIN_LINEAR).view(np.float32).astype(np.float64)
    encoded: NDArray[np.float32] = (linear ** (1.0 / GAMMA)).astype(np.float32)
    encoded[0] = 0.0
    return encoded


THRESHOLDS: Final = level_thresholds(lambda encoded: encoded**GAMMA)
"""(256,) float32: least linear value of each byte."""
GAMMA_CELLS: Final = level_cells(THRESHOLDS)
"""Table for ``level_cells.encoded_pixels``."""
GAMMA_FROM_LINEAR: Final = _gamma_from_linear()
"""Table for ``encode_gamma``."""
LINEAR_FROM_GAMMA: Final = (np.minimum(np.arange(_STEPS + 2) / _STEPS, 1.0) ** GAMMA).astype(np.float32)
"""(_STEPS + 2,) float32, table for ``decode_gamma``: (i / _STEPS)^2.2. The last entry is for interpolation at 1."""


@inlined
def byte_from_unit(c: F32x8) -> I32x8:
    """Return ``round(255 c)``. NaN and values below 0 give 0, values above 1 give 255."""
    return vec.to_i32(saturate(c) * vec.f32(255.0) + vec.f32(0.5))


@inlined
def decode_gamma(c: F32x8, linear_from_gamma: Pointer[F32]) -> F32x8:
    """Return ``c^2.2``, clamped to 0 .. 1 (NaN to 0), within 1e-7, by the table LINEAR_FROM_GAMMA."""
    step = saturate(c) * vec.f32(float(_STEPS))
    cell = vec.to_i32(step)
    low, high = vec.gather(linear_from_gamma, cell), vec.gather(linear_from_gamma, cell + vec.i32(1))
    return low + (step - vec.to_f32(cell)) * (high - low)


@inlined
def encode_gamma(c: F32x8, gamma_from_linear: Pointer[F32]) -> F32x8:
    """Return ``c^(1/2.2)``, clamped to 0 .. 1 (NaN to 0), within 2e-6, by the table GAMMA_FROM_LINEAR."""
    c = vec.minimum(vec.maximum(c, vec.f32(_MIN_LINEAR)), vec.f32(1.0))
    bits = vec.float_bits(c) - vec.i32(_MIN_LINEAR_BITS)
    cell = bits >> vec.i32(CELL_BITS)
    low, high = vec.gather(gamma_from_linear, cell), vec.gather(gamma_from_linear, cell + vec.i32(1))
    t = vec.to_f32(bits & vec.i32(CELL_SIZE - 1)) * vec.f32(1.0 / CELL_SIZE)
    return low + t * (high - low)
