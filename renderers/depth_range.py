"""Depth images as a sensor delivers them: limited to its range, and as 16-bit millimetres."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import F32, I64, Address, f32
from renderers.compiler.pointers import address_of, f32_at

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
        depth: (H, W), C-contiguous, metres along the optical axis; inf is the background.
        min_depth: metres; this depth and smaller ones become 0.
        max_depth: metres; this depth and larger ones become inf.
    """
    with np.errstate(over="ignore"):  # a limit beyond float32 is none
        lower, upper = f32(min_depth), f32(max_depth)
    _limit(address_of(depth, np.float32), depth.size, lower, upper)


@kernel
def _limit(depth_at: Address, count: I64, lower: F32, upper: F32) -> None:
    """Limit the depths at an address: 0.02 ms for 640 x 480 pixels, for which NumPy took 0.3 to 1.4."""
    depth = f32_at(depth_at)
    for i in range(count):
        limited = f32(np.inf) if depth[i] >= upper else depth[i]
        depth[i] = f32(0.0) if limited <= lower else limited
