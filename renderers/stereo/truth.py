"""Exact disparity from rendered depth: the best that any matcher could measure with this geometry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.cache_locator import cached_njit
from renderers.compiler.pending import wait_until_compiled

OCCLUSION_STEP: Final = 1.0
"""Pixels: a point is occluded if the right camera sees something nearer there by more than this disparity (the
tolerance of the common left-right consistency check)."""


@dataclass(frozen=True, slots=True)
class DepthRange:
    """Range of depths that can be measured."""

    min_depth: float
    """Metres."""
    max_depth: float
    """Metres."""


def true_disparity(
    depth_left: NDArray[np.float32], depth_right: NDArray[np.float32], focal_times_baseline: float, limits: DepthRange
) -> NDArray[np.float32]:
    """Return the disparity of every pixel of the left image that both cameras see.

    Args:
        depth_left: (H, W) float32 depth from the left camera, metres along the optical axis, +inf: background.
        depth_right: (H, W) float32 depth from the right camera.
        focal_times_baseline: f t at this resolution, pixels times metres.
        limits: depths outside are not measured.

    Returns:
        (H, W) float32: ``d = f t / z`` in pixels. 0: background, out of range, occluded in the right image, or outside
        it (left edge of the field of view).
    """
    wait_until_compiled("stereo")
    out = np.empty(depth_left.shape, np.float32)
    near, far = np.float32(limits.min_depth), np.float32(limits.max_depth)
    _true_disparity(
        depth_left, depth_right, np.float32(focal_times_baseline), near, far, np.float32(OCCLUSION_STEP), out
    )
    return out


@cached_njit(nogil=True)
def _true_disparity(left, right, ft, near, far, occlusion_step, out):
    height, width = left.shape
    for k in range(height):
        for i in range(width):
            z = left[k, i]
            d = np.float32(0.0)
            if near <= z <= far:
                d = ft / z
                x = np.float32(i) - d  # column in the right image; integers are pixel centres
                if x < np.float32(-0.5):
                    d = np.float32(0.0)
                else:
                    a = max(int(np.floor(x)), 0)
                    b = min(a + 1, width - 1)
                    farther = max(right[k, a], right[k, b])
                    # +inf: the right camera looks past an edge, so nothing occludes the point.
                    if ft / farther > d + occlusion_step:
                        d = np.float32(0.0)
            out[k, i] = d
