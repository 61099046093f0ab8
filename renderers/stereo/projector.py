"""A random-dot projector beside the cameras: which light falls on what each pixel sees.

The pattern is a texture over the projector's own image plane, so it stays where it is on a surface whichever camera
looks: that is what gives a matcher something to match on blank walls. The projector sits half-way between the cameras
and looks where they look; what a nearer object hides from it is dark.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.cache_locator import cached_njit
from renderers.compiler.pending import wait_until_compiled

CELL: Final = 1.5 / 552.0
"""Width of a dot, in units of the focal length: 2 pixels of a 640 pixel wide image of the 4 mm lens."""
_SIZE: Final = 1024
"""Cells after which the pattern repeats: 200 degrees of view, far beyond any disparity range."""
_MIN_CELL: Final = 1.5
"""Pixels. A coarser level of the pattern is used where cells would be smaller: otherwise it would alias, differently in
each camera."""


@cache
def _patterns() -> tuple[NDArray[np.uint8], ...]:
    """(1024, 1024), (512, 512), … uint8: fine dots among ones of four times their size, and averages of them."""
    random = np.random.Generator(np.random.Philox(160))
    fine = random.random((_SIZE, _SIZE)) < 0.45
    coarse = np.kron(random.random((_SIZE // 4, _SIZE // 4)) < 0.4, np.ones((4, 4), np.bool_))
    level = np.where(coarse, 160.0, 0.0) + np.where(fine, 95.0, 0.0)
    levels = []
    while level.shape[0] >= 16:
        levels.append(np.round(level).astype(np.uint8))
        level = (level[::2, ::2] + level[1::2, ::2] + level[::2, 1::2] + level[1::2, 1::2]) / 4
    return tuple(levels)


_SHADOW_STEP: Final = 0.02
"""Share of the depth by which a point may lie behind what the projector sees there and is still lit: slanted surfaces
change that much within the pixels that are compared."""


def dots_on(
    depth: NDArray[np.float32],
    focal_length: float,
    cx: float,
    cy: float,
    offset: float,
    seen: NDArray[np.float32] | None = None,
) -> NDArray[np.uint8]:
    """Light of the projector at every pixel.

    Args:
        depth: (H, W) float32, metres, +inf where nothing is.
        focal_length, cx, cy: of the image, pixels.
        offset: x of the camera in the projector's frame, metres.
        seen: (H, W) float32 depth from where the projector is, with the same intrinsics; None: it casts no shadows.
            What lies outside of it is lit: the projector's field of view is the wider one.

    Returns:
        (H, W) uint8, 255 is full light; 0 where nothing is.
    """
    wait_until_compiled("stereo")
    level, cell = 0, CELL * focal_length
    patterns = _patterns()
    while cell < _MIN_CELL and level < len(patterns) - 1:
        level, cell = level + 1, cell * 2
    out = np.empty(depth.shape, np.uint8)
    _dots_on(depth, patterns[level], 1.0 / cell, cx, cy, offset * focal_length, out)
    if seen is not None:
        _cast_shadows(depth, seen, offset * focal_length, 1.0 - _SHADOW_STEP, out)
    return out


@cached_njit(nogil=True)
def _dots_on(depth, pattern, cells_per_pixel, cx, cy, offset_f, out):
    height, width = depth.shape
    mask = pattern.shape[0] - 1
    scale, shift = np.float32(cells_per_pixel), np.float32(offset_f)
    middle = np.float32(pattern.shape[0] // 2)
    one = np.float32(1.0)
    for k in range(height):
        v = (np.float32(k + 0.5) - np.float32(cy)) * scale + middle
        row = int(np.floor(v))
        fv = v - np.float32(row)
        above, below = row & mask, (row + 1) & mask
        for i in range(width):
            z = depth[k, i]
            light = np.float32(0.0)
            if z < np.float32(np.inf):
                u = (np.float32(i + 0.5) - np.float32(cx) + shift / z) * scale + middle
                column = int(np.floor(u))
                fu = u - np.float32(column)
                a, b = column & mask, (column + 1) & mask
                upper = pattern[above, a] * (one - fu) + pattern[above, b] * fu
                lower = pattern[below, a] * (one - fu) + pattern[below, b] * fu
                light = upper * (one - fv) + lower * fv
            out[k, i] = int(light + np.float32(0.5))


@cached_njit(nogil=True)
def _cast_shadows(depth, seen, offset_f, nearer, light):
    """No light where the projector sees something nearer in all three pixels around the point."""
    height, width = depth.shape
    shift, share = np.float32(offset_f), np.float32(nearer)
    for k in range(height):
        for i in range(width):
            z = depth[k, i]
            if light[k, i] == 0 or not z < np.float32(np.inf):
                continue
            column = int(np.floor(np.float32(i) + np.float32(0.5) + shift / z))
            if column < 1 or column > width - 2:
                continue
            farthest = max(seen[k, column - 1], seen[k, column], seen[k, column + 1])
            if farthest < z * share:
                light[k, i] = 0
