"""Decoded images of textures, cached, in the layout that kernels read.

All mip levels are in one array, so that a texel's index follows from its level, row and column. Level 0 is on the left,
the others are below each other on its right::

    +---------------+-+-------+-+---+
    |               | |   1   | |   |     Each row of a level is followed by a copy of its first texel: a kernel loads
    |       0       | |       | |   |     two neighbouring texels at once, also across the border of a repeated texture.
    |               | +-------+-+   |
    |               | | 2 | |       |
    +---------------+-+---+-+-------+
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.cache import WeakCache
from renderers.drawlist import Image, ImageError

_MAX_CONFLICT_PADDING: Final = 16
"""Texels of padding, a cache line, that keep rows of 1024 texels and more from evicting each other from the cache.
Frames that show such a texture rotated by 90 degrees would take twice as long. Shorter rows have a 64th of padding."""


_OPAQUE_BLACK: Final = 0xFF000000
"""Black with alpha 255 as a little-endian number: a texel is opaque if it is not less."""


@dataclass(frozen=True, slots=True, eq=False)
class Texels:
    """A decoded image."""

    rows: NDArray[np.uint8]
    """``texel_rows`` of the image alone: straight alpha, as stored (not linearised)."""
    width: int
    """W, columns of the image without padding."""
    opaque: bool
    """True if every alpha is 255."""
    translucent: bool
    """True if an alpha is neither 0 nor 255, or if both occur, as in ``vtkTexture::IsTranslucent``."""

    @property
    def rgba(self) -> NDArray[np.uint8]:
        """(H, W, 4) uint8, C-contiguous; a copy."""
        return np.ascontiguousarray(self.rows[:, : self.width])


_decoded: WeakCache[Image, Texels] = WeakCache("textures")


def texels_of(image: Image) -> Texels:
    """Return the decoded image, from the cache if possible. Concurrent first calls may each decode it.

    Raises:
        ImageError: the image cannot be decoded, or not to (H, W, 4) uint8. The message does not name the image.
    """
    texels = _decoded.get(image)
    if texels is not None:
        return texels
    pixels = image.decode()
    if pixels.ndim != 3 or pixels.shape[2] != 4 or pixels.dtype != np.uint8 or 0 in pixels.shape:
        raise ImageError(f"decoded to {pixels.shape} {pixels.dtype}, expected (H, W, 4) uint8")
    opaque = bool(np.ascontiguousarray(pixels).view("<u4").min() >= _OPAQUE_BLACK)
    translucent = not opaque and bool(pixels[..., 3].any())
    width = pixels.shape[1]
    texels = Texels(texel_rows([pixels]), width, opaque, translucent)
    _decoded.put(image, texels, texels.rows.nbytes)
    return texels


def level_row(height: int, level: int) -> int:
    """Return the first row of a mip level in ``texel_rows``, given the height of level 0.

    Level k has max(height // 2^k, 1) rows, so that levels 1 to k - 1 have at most height - 2 height / 2^k + k - 1.
    """
    return max(height - (2 * height >> level) + level, 0)


def texel_rows(levels: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return the mip levels of a texture, each (H, W, 4) uint8, in one array, (rows, stride, 4) uint8, C-contiguous."""
    height, width = levels[0].shape[:2]
    side_by_side = sum(level.shape[1] + 1 for level in levels[:2])
    row_count = max(level_row(height, k) + len(level) for k, level in enumerate(levels))
    rows = np.zeros((row_count, side_by_side + min(side_by_side // 64, _MAX_CONFLICT_PADDING), 4), np.uint8)
    for k, level in enumerate(levels):
        first_row, first_column = level_row(height, k), width + 1 if k > 0 else 0
        part = rows[first_row : first_row + len(level), first_column : first_column + level.shape[1] + 1]
        part[:, :-1], part[:, -1] = level, level[:, 0]
    return rows


def is_decoded(image: Image) -> bool:
    """Return True if the decoded image is cached."""
    return _decoded.get(image) is not None
