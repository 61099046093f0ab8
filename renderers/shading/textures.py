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

from dataclasses import dataclass, field
from threading import Lock
from typing import Final

import cv2
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
    """``empty_rows`` with the image as level 0: straight alpha, as stored (not linearised)."""
    size: tuple[int, int]
    """Height and width of the image."""
    opaque: bool
    """True if every alpha is 255."""
    translucent: bool
    """True if an alpha is neither 0 nor 255, or if both occur, as in ``vtkTexture::IsTranslucent``."""
    rows_with_levels: dict[bool, NDArray[np.uint8]] = field(default_factory=dict)
    """Arrays with all levels, by the parameter ``srgb`` of ``mipmaps.mip_level_rows``. The first one is ``rows``."""
    lock: Lock = field(default_factory=Lock)
    """Held while levels are made."""


_decoded: WeakCache[Image, Texels] = WeakCache("textures")


def texels_of(image: Image) -> Texels:
    """Return the decoded image, from the cache if possible. Concurrent first calls may each decode it.

    Raises:
        ImageError: the image cannot be decoded, or not to (H, W, 3 | 4) uint8. The message does not name the image.
    """
    texels = cached_texels(image)
    if texels is not None:
        return texels
    pixels = image.decode()
    if pixels.ndim != 3 or pixels.shape[2] not in (3, 4) or pixels.dtype != np.uint8 or 0 in pixels.shape:
        raise ImageError(f"decoded to {pixels.shape} {pixels.dtype}, expected (H, W, 3 | 4) uint8")
    opaque = pixels.shape[2] == 3 or bool(np.ascontiguousarray(pixels).view("<u4").min() >= _OPAQUE_BLACK)
    translucent = not opaque and bool(pixels[..., 3].any())
    size = pixels.shape[0], pixels.shape[1]
    rows = empty_rows(*size)
    set_level(rows, size, 0, pixels)
    texels = Texels(rows, size, opaque, translucent)
    keep_texels(image, texels)
    return texels


def keep_texels(image: Image, texels: Texels) -> None:
    """Cache a decoded image with the levels that it has."""
    _decoded.put(image, texels, texels.rows.nbytes * max(len(texels.rows_with_levels), 1))


def level_row(height: int, level: int) -> int:
    """Return the first row of a mip level in ``Texels.rows``, given the height of level 0.

    Level k has max(height // 2^k, 1) rows, so that levels 1 to k - 1 have at most height - 2 height / 2^k + k - 1.
    The result is a few rows more, as level 1 begins in row 1.
    """
    return max(height - (2 * height >> level) + level, 0)


def empty_rows(height: int, width: int) -> NDArray[np.uint8]:
    """Return the array of a texture before ``set_level``, (rows, stride, 4) uint8, C-contiguous."""
    last_level = max(height, width).bit_length() - 1
    row_count = max(level_row(height, k) + max(height >> k, 1) for k in range(last_level + 1))
    side_by_side = width + 1 + (max(width // 2, 1) + 1 if last_level > 0 else 0)
    return np.zeros((row_count, side_by_side + min(side_by_side // 64, _MAX_CONFLICT_PADDING), 4), np.uint8)


def set_level(rows: NDArray[np.uint8], size: tuple[int, int], k: int, level: NDArray[np.uint8]) -> None:
    """Store mip level ``k``, (H, W, 3 | 4) uint8, in the array of a texture; ``size``: height and width of level 0."""
    first_row, first_column = level_row(size[0], k), size[1] + 1 if k > 0 else 0
    part = rows[first_row : first_row + len(level), first_column : first_column + level.shape[1] + 1]
    if level.shape[2] == 3:
        cv2.cvtColor(level, cv2.COLOR_RGB2RGBA, dst=part[:, :-1])
    else:
        part[:, :-1] = level
    part[:, -1] = part[:, 0]


def cached_texels(image: Image) -> Texels | None:
    """Return the decoded image if it is cached."""
    return _decoded.get(image)
