"""Decoded images of textures, cached, in the layout that kernels read.

Rows of texels are padded to ``row_stride``. The first texel of the padding repeats the row's first texel: a kernel
loads two neighbouring texels at once, also across the border of a repeated texture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.cache import WeakCache
from renderers.drawlist import Image, ImageError
from renderers.stop import check_stop

MAX_CONFLICT_PADDING: Final = 16
"""Texels of padding, a cache line, that keep rows of 1024 texels and more from evicting each other from the cache.
Frames that show such a texture rotated by 90 degrees would take twice as long. Shorter rows have a 64th of padding."""


@dataclass(frozen=True, slots=True, eq=False)
class Texels:
    """A decoded image."""

    rows: NDArray[np.uint8]
    """(H, row_stride(W), 4) uint8, C-contiguous, straight alpha, as stored (not linearised)."""
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
    check_stop()
    pixels = image.decode()
    check_stop()
    if pixels.ndim != 3 or pixels.shape[2] != 4 or pixels.dtype != np.uint8 or 0 in pixels.shape:
        raise ImageError(f"decoded to {pixels.shape} {pixels.dtype}, expected (H, W, 4) uint8")
    alpha = pixels[..., 3]
    opaque = bool((alpha == 255).all())
    check_stop()
    translucent = not opaque and bool(alpha.any())
    check_stop()
    height, width = pixels.shape[:2]
    texels = Texels(padded_levels([pixels]).reshape(height, -1, 4), width, opaque, translucent)
    _decoded.put(image, texels, texels.rows.nbytes)
    return texels


def row_stride(width: int) -> int:
    """Return the number of texels from one row to the next."""
    return width + 1 + min(width // 64, MAX_CONFLICT_PADDING)


def padded_levels(levels: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Return the mip levels of a texture, each (H, W, 4) uint8, with padded rows one after the other, (n, 4) uint8."""
    texels = np.zeros((sum(level.shape[0] * row_stride(level.shape[1]) for level in levels), 4), np.uint8)
    begin = 0
    for level in levels:
        height, width = level.shape[:2]
        end = begin + height * row_stride(width)
        rows = texels[begin:end].reshape(height, -1, 4)
        rows[:, :width], rows[:, width] = level, level[:, 0]
        begin = end
    return texels


def is_decoded(image: Image) -> bool:
    """Return True if the decoded image is cached."""
    return _decoded.get(image) is not None
