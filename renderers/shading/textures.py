"""Decoded images of textures, cached."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.cache import WeakCache
from renderers.drawlist import Image, ImageError
from renderers.stop import check_stop

_CONFLICTING_WIDTH: Final = 1024
"""Texels. Rows whose length is a multiple of this begin in the same set of a processor's cache."""
_CACHE_LINE: Final = 16
"""Size of a cache line, texels."""


@dataclass(frozen=True, slots=True, eq=False)
class Texels:
    """A decoded image."""

    rows: NDArray[np.uint8]
    """(H, W or more, 4) uint8, C-contiguous, straight alpha, as stored (not linearised)."""
    width: int
    """W, columns of the image. Further columns of ``rows`` are padding."""
    opaque: bool
    """True if every alpha is 255."""
    translucent: bool
    """True if an alpha is neither 0 nor 255, or if both occur, as in ``vtkTexture::IsTranslucent``."""

    @property
    def rgba(self) -> NDArray[np.uint8]:
        """(H, W, 4) uint8, C-contiguous; a copy where the rows are padded."""
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
    texels = Texels(_padded(pixels), pixels.shape[1], opaque, translucent)
    _decoded.put(image, texels, texels.rows.nbytes)
    return texels


def _padded(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the rows of an image, each padded by a cache line if they would evict each other from the cache.

    Padding halves the time of frames that show such a texture rotated by 90 degrees.
    """
    height, width = pixels.shape[:2]
    if width % _CONFLICTING_WIDTH:
        return np.ascontiguousarray(pixels)
    rows = np.zeros((height, width + _CACHE_LINE, 4), np.uint8)
    rows[:, :width] = pixels
    return rows


def is_decoded(image: Image) -> bool:
    """Return True if the decoded image is cached."""
    return _decoded.get(image) is not None
