"""Depth as Drake's clients read it: 0 is too close, infinite (16 bit: 65535) too far."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

TOO_FAR_16: Final = 65535
"""InvalidDepth::kTooFar of ImageDepth16U, millimetres."""


def limit_depth(depth: NDArray[np.float32], min_depth: float, max_depth: float) -> None:
    """Marks, in place, what the sensor cannot measure.

    Args:
        depth: (H, W) float32, metres along the optical axis, inf where nothing is.
        min_depth: metres; at it and nearer becomes 0.
        max_depth: metres; at it and farther becomes inf (both as in RenderEngineVtk's depth shader).
    """
    np.copyto(depth, np.float32(math.inf), where=depth >= max_depth)
    np.copyto(depth, np.float32(0.0), where=depth <= min_depth)


def millimetres(depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    """(H, W) float32 metres -> uint16 millimetres, rounded; what 16 bits cannot hold is too far."""
    scaled = np.rint(depth * np.float32(1000.0))
    limited: NDArray[np.float32] = np.minimum(scaled, np.float32(TOO_FAR_16))
    return limited.astype(np.uint16)
