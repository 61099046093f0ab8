"""What a depth sensor cannot measure, in finished pictures."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import inner
from renderers.compiler.jit import kernel
from renderers.compiler.pointers import address_of, f32_at

_BRIEF: Final = 1 << 19
"""Pixels that take some 30 microseconds: sooner than another thread has taken the interpreter and given it back."""
_INFINITE: Final = np.float32(math.inf)


def limit_depth(depth: NDArray[np.float32], min_depth: float, max_depth: float) -> None:
    """Marks, in place, what the sensor cannot measure.

    Args:
        depth: (H, W) float32, C-contiguous, metres along the optical axis, inf where nothing is.
        min_depth: metres; at it and nearer becomes 0.
        max_depth: metres; at it and farther becomes inf (both as in RenderEngineVtk's depth shader).
    """
    limit = _limit_small if depth.size <= _BRIEF else _limit_large
    limit(address_of(depth, np.float32), depth.size, min_depth, max_depth)


@kernel("void(int64, int64, float64, float64)", releases_gil=False)
def _limit_small(address, count, min_depth, max_depth):
    _limit(f32_at(address), count, np.float32(min_depth), np.float32(max_depth))


@kernel("void(int64, int64, float64, float64)")
def _limit_large(address, count, min_depth, max_depth):
    _limit(f32_at(address), count, np.float32(min_depth), np.float32(max_depth))


@inner
def _limit(values, count, least, most):
    for at in range(count):
        value = values[at]
        value = _INFINITE if value >= most else value
        values[at] = np.float32(0.0) if value <= least else value
