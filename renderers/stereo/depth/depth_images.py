"""Depth images of one frame, as the rc_visard streams them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderers.stereo.model import DISPARITY_SCALE


@dataclass(frozen=True, slots=True, eq=False)
class DepthImages:
    """Disparity, error and confidence images of one frame."""

    disparity: NDArray[np.uint16]
    """(H, W) uint16, units of 1/16 pixel, 0: invalid."""
    error: NDArray[np.uint8]
    """(H, W) uint8, units of ``error_scale`` pixels, 0 where invalid."""
    confidence: NDArray[np.uint8]
    """(H, W) uint8, units of 1/255, 0 where invalid."""
    error_scale: float = DISPARITY_SCALE
    """Pixels per unit of ``error``: 1/16 divided by a power of two."""
