"""Exact disparity from rendered depth: what an ideal matcher of this geometry could measure at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.cache_locator import cached_njit

OCCLUSION_STEP = 1.0
"""Pixels. A point counts as hidden from the right camera when what that camera sees there is nearer by more than this
disparity: the tolerance of the usual left-right consistency check."""


@dataclass(frozen=True, slots=True)
class DepthRange:
    """Which disparities can be measured."""

    min_depth: float
    """Metres."""
    max_depth: float
    """Metres."""


def true_disparity(
    depth_left: NDArray[np.float32], depth_right: NDArray[np.float32], focal_times_baseline: float, limits: DepthRange
) -> NDArray[np.float32]:
    """Disparity of every pixel of the left image that both cameras see.

    Args:
        depth_left: (H, W) float32, metres along the optical axis, +inf: nothing.
        depth_right: (H, W) float32, the same from the right camera.
        focal_times_baseline: f t in pixel metres, of this resolution.
        limits: nearer and farther points are not measured.

    Returns:
        (H, W) float32: ``d = f t / z`` in pixels; 0: nothing there, out of range, hidden from the right camera
        (occlusion), or outside the right image (left edge of the field of view).
    """
    out = np.empty(depth_left.shape, np.float32)
    _true_disparity(
        depth_left, depth_right, focal_times_baseline, limits.min_depth, limits.max_depth, OCCLUSION_STEP, out
    )
    return out


@cached_njit(nogil=True)
def _true_disparity(left, right, ft, z_min, z_max, step, out):
    height, width = left.shape
    ft32 = np.float32(ft)
    step32 = np.float32(step)
    near = np.float32(z_min)
    far = np.float32(z_max)
    for k in range(height):
        for i in range(width):
            z = left[k, i]
            d = np.float32(0.0)
            if near <= z <= far:
                d = ft32 / z
                x = np.float32(i) - d  # column in the right image, in units where a column's centre is its index
                if x < np.float32(-0.5):
                    d = np.float32(0.0)
                else:
                    a = max(int(np.floor(x)), 0)
                    b = min(a + 1, width - 1)
                    farther = max(right[k, a], right[k, b])
                    # +inf there means that the right camera looks past an edge: not hidden by anything.
                    if ft32 / farther > d + step32:
                        d = np.float32(0.0)
            out[k, i] = d
