"""Depth images as a sensor delivers them: limited to its range, and as 16-bit millimetres."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.jit import kernel
from renderers.compiler.pointers import address_of, f32_at

_INFINITY: Final = np.float32(math.inf)
TOO_FAR_16: Final = 65535
"""Drake's InvalidDepth::kTooFar for 16-bit depth, millimetres."""


def depth_in_millimetres(depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Convert (H, W) float32 metres to millimetres, rounded half to even; ``TOO_FAR_16`` for what does not fit."""
    rounded = np.rint(depth * np.float32(1000.0))
    limited: NDArray[np.float32] = np.minimum(rounded, np.float32(TOO_FAR_16))
    return limited.astype(np.uint16)


def limit_depth(depth: NDArray[np.float32], min_depth: float, max_depth: float) -> None:
    """Replace the depths that the sensor cannot measure, in place, as RenderEngineVtk's depth shader does.

    Args:
        depth: (H, W) float32, C-contiguous, metres along the optical axis; inf is the background.
        min_depth: metres; this depth and smaller ones become 0.
        max_depth: metres; this depth and larger ones become inf.
    """
    _limit_depth(address_of(depth, np.float32), depth.size, min_depth, max_depth)


@kernel("void(int64, int64, float64, float64)")
def _limit_depth(address, count, min_depth, max_depth):
    depths, lower, upper = f32_at(address), np.float32(min_depth), np.float32(max_depth)
    for k in range(count):
        depth = depths[k]
        depth = _INFINITY if depth >= upper else depth
        depths[k] = np.float32(0.0) if depth <= lower else depth
