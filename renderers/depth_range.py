"""Depth range of a sensor, applied to a rendered depth image."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.jit import kernel
from renderers.compiler.pointers import address_of, f32_at

_INFINITE: Final = np.float32(math.inf)


def limit_depth(depth: NDArray[np.float32], min_depth: float, max_depth: float) -> None:
    """Mark in place what the sensor cannot measure, as RenderEngineVtk's depth shader does.

    Args:
        depth: (H, W) float32, C-contiguous, metres along the optical axis, inf: background.
        min_depth: metres; this depth and nearer ones become 0.
        max_depth: metres; this depth and farther ones become inf.
    """
    _limit_depth(address_of(depth, np.float32), depth.size, min_depth, max_depth)


@kernel("void(int64, int64, float64, float64)")
def _limit_depth(address, count, min_depth, max_depth):
    values, near, far = f32_at(address), np.float32(min_depth), np.float32(max_depth)
    for at in range(count):
        value = values[at]
        value = _INFINITE if value >= far else value
        values[at] = np.float32(0.0) if value <= near else value
