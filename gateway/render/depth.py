"""16-bit depth of Drake's clients: 0 is too close, 65535 too far."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

TOO_FAR_16: Final = 65535
"""Drake's InvalidDepth::kTooFar for 16 bits."""


def millimetres(depth: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Convert (H, W) float32 metres to rounded uint16 millimetres; beyond 16 bits is too far."""
    scaled = np.rint(depth * np.float32(1000.0))
    limited: NDArray[np.float32] = np.minimum(scaled, np.float32(TOO_FAR_16))
    return limited.astype(np.uint16)
