"""Random-dot projector: its light at every pixel of a camera image.

The pattern is a texture on the projector's image plane, so it stays in place on a surface whichever camera looks at it,
and gives a matcher texture on blank walls. The projector is half-way between the cameras with the same orientation.
Objects cast shadows in its light.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.cache_locator import cached_njit
from renderers.compiler.pending import wait_until_compiled

CELL: Final = 1.5 / 552.0
"""Width of a dot divided by the focal length: 1.5 pixels of a 640 pixel wide image of the 4 mm lens."""
_SIZE: Final = 1024
"""Period of the pattern, cells: 2.8 focal lengths, far beyond any disparity."""
_MIN_CELL: Final = 1.5
"""Minimum width of a cell, pixels. Where cells would be smaller, a coarser level of the pattern avoids aliasing, which
would differ between the cameras."""
_SHADOW_BIAS: Final = 0.02
"""Relative bias against self-shadowing: a slanted surface's depth changes this much within the pixels compared."""


@cache
def _pattern_levels() -> tuple[NDArray[np.uint8], ...]:
    """Return the pattern as a mip chain, (1024, 1024), (512, 512), … uint8: fine dots over dots of four times their
    size."""
    random = np.random.Generator(np.random.Philox(160))
    fine = random.random((_SIZE, _SIZE)) < 0.45
    coarse = np.kron(random.random((_SIZE // 4, _SIZE // 4)) < 0.4, np.ones((4, 4), np.bool_))
    level = np.where(coarse, 160.0, 0.0) + np.where(fine, 95.0, 0.0)
    levels = []
    while level.shape[0] >= 16:
        levels.append(np.round(level).astype(np.uint8))
        level = (level[::2, ::2] + level[1::2, ::2] + level[::2, 1::2] + level[1::2, 1::2]) / 4
    return tuple(levels)


def projected_dots(
    depth: NDArray[np.float32],
    focal_length: float,
    cx: float,
    cy: float,
    offset: float,
    projector_depth: NDArray[np.float32],
) -> NDArray[np.uint8]:
    """Return the light of the projector at every pixel, (H, W) uint8; 255 is full light, background is 0.

    Args:
        depth: (H, W) float32 depth of the camera image, metres, +inf: background.
        focal_length: focal length of the camera, pixels.
        cx: principal point, pixels from the left edge.
        cy: principal point, pixels from the top edge.
        offset: x of the camera in the projector's frame, metres.
        projector_depth: (H, W) float32 depth seen from the projector with the camera's intrinsics, for shadows. Points
            outside its image are lit, because the projector's field of view is the wider one.
    """
    wait_until_compiled("stereo")
    level, cell = 0, CELL * focal_length
    levels = _pattern_levels()
    while cell < _MIN_CELL and level < len(levels) - 1:
        level, cell = level + 1, cell * 2
    out = np.empty(depth.shape, np.uint8)
    _project(depth, projector_depth, levels[level], 1.0 / cell, cx, cy, offset * focal_length, 1.0 - _SHADOW_BIAS, out)
    return out


@cached_njit(nogil=True)
def _project(depth, projector_depth, pattern, cells_per_pixel, cx, cy, offset_f, nearer, out):
    height, width = depth.shape
    mask = pattern.shape[0] - 1
    scale, shift, share = np.float32(cells_per_pixel), np.float32(offset_f), np.float32(nearer)
    middle = np.float32(pattern.shape[0] // 2)
    one, half = np.float32(1.0), np.float32(0.5)
    for k in range(height):
        v = (np.float32(k + 0.5) - np.float32(cy)) * scale + middle
        row = int(np.floor(v))
        fv = v - np.float32(row)
        above, below = row & mask, (row + 1) & mask
        for i in range(width):
            z = depth[k, i]
            light = np.float32(0.0)
            if z < np.float32(np.inf):
                # The point is in shadow if the projector sees something nearer in all three pixels around it.
                shadow = False
                column = int(np.floor(np.float32(i) + half + shift / z))
                if 1 <= column <= width - 2:
                    farthest = max(
                        projector_depth[k, column - 1], projector_depth[k, column], projector_depth[k, column + 1]
                    )
                    shadow = farthest < z * share
                if not shadow:
                    u = (np.float32(i + 0.5) - np.float32(cx) + shift / z) * scale + middle
                    cell = int(np.floor(u))
                    fu = u - np.float32(cell)
                    a, b = cell & mask, (cell + 1) & mask
                    upper = pattern[above, a] * (one - fu) + pattern[above, b] * fu
                    lower = pattern[below, a] * (one - fu) + pattern[below, b] * fu
                    light = upper * (one - fv) + lower * fv
            out[k, i] = int(light + half)
