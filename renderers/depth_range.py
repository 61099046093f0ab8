"""Depth images as a sensor delivers them: limited to its range, and as 16-bit millimetres."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

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
        depth: (H, W) float32, metres along the optical axis; inf is the background.
        min_depth: metres; this depth and smaller ones become 0.
        max_depth: metres; this depth and larger ones become inf.
    """
    with np.errstate(over="ignore"):  # a limit beyond float32 is none
        lower, upper = np.float32(min_depth), np.float32(max_depth)
    np.copyto(depth, np.float32(math.inf), where=depth >= upper)
    np.copyto(depth, np.float32(0.0), where=depth <= lower)
