"""Depth as Drake's clients read it in 16 bits: 0 is too close, 65535 too far."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

TOO_FAR_16: Final = 65535
"""InvalidDepth::kTooFar of ImageDepth16U, millimetres."""


def millimetres(depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    """(H, W) float32 metres -> uint16 millimetres, rounded; what 16 bits cannot hold is too far."""
    scaled = np.rint(depth * np.float32(1000.0))
    limited: NDArray[np.float32] = np.minimum(scaled, np.float32(TOO_FAR_16))
    return limited.astype(np.uint16)
