"""Decoded textures and the table by which kernels find them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.cache import Cache
from renderers.compiler.pointers import address_of
from renderers.drawlist import Image, ImageError, Texture, Wrap, image_named
from renderers.stop import check_stop

WRAP_REPEAT: Final = 0
WRAP_CLAMP: Final = 1
WRAP_MIRROR: Final = 2
_WRAP: Final = {Wrap.REPEAT: WRAP_REPEAT, Wrap.CLAMP_TO_EDGE: WRAP_CLAMP, Wrap.MIRRORED_REPEAT: WRAP_MIRROR}

# Columns of the integer table.
TI_ADDRESS: Final = 0
TI_WIDTH: Final = 1
TI_HEIGHT: Final = 2
TI_WRAP_S: Final = 3
TI_WRAP_T: Final = 4
TI_LINEAR: Final = 5
TI_UV_SET: Final = 6
TI_TRANSFORMED: Final = 7
TI_STRIDE: Final = 8  # texels from one row to the next
TI_COLUMNS: Final = 9
TF_COLUMNS: Final = 6
"""The float table holds ``Texture.uv_transform``."""


@dataclass(frozen=True, slots=True)
class Texels:
    """An image ready to be sampled."""

    rows: NDArray[np.uint8]
    """(H, at least W, 4) uint8, C-contiguous, straight alpha, as stored (not linearised)."""
    width: int
    opaque: bool
    """Whether every alpha is 255."""

    @property
    def rgba(self) -> NDArray[np.uint8]:
        """(H, W, 4) uint8, C-contiguous; a copy where the rows are longer."""
        return np.ascontiguousarray(self.rows[:, : self.width])


MAX_TEXEL_BYTES: Final = 1 << 30
"""Decoded pictures that are kept: sixteen of 4096 x 4096. A small file can hold a large picture, so that whoever keeps
the files cannot bound this."""

_decoded: Cache[Image, Texels] = Cache(MAX_TEXEL_BYTES, weak=True)


def texels_of(image: Image) -> Texels:
    """The image's texels, decoded once while the ``Image`` is alive and was used lately.

    Two threads that ask for a new image at once may both decode it; the later result is kept.

    Raises:
        ImageError: it cannot be decoded, or what came out is no (H, W, 4) uint8 picture; without the image's name.
    """
    known = _decoded.get(image)
    if known is not None:
        return known
    check_stop()
    pixels = image.decode()
    check_stop()
    if pixels.ndim != 3 or pixels.shape[2] != 4 or pixels.dtype != np.uint8 or 0 in pixels.shape:
        raise ImageError(f"decoded to {pixels.shape} {pixels.dtype}, expected (H, W, 4) uint8")
    opaque = bool((pixels[..., 3] == 255).all())
    check_stop()
    fresh = Texels(_spread(pixels), pixels.shape[1], opaque)
    _decoded.put(image, fresh, fresh.rows.nbytes)
    return fresh


_ALIKE: Final = 1024
"""Texels: rows whose length is a multiple of this (4096 bytes) begin in the same set of every cache, so that a column
of texels has room for a dozen lines only."""
_LINE: Final = 16
"""Texels of a cache line."""


def _spread(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The rows, each a cache line longer where they would get in each other's way: rows a power of two apart share a
    few sets of the cache when a texture stands on its side. Behind a single row or column lies what a square of four
    texels at the first one reaches, which ``mixing`` copies for pixels that are found elsewhere, too."""
    height, width = pixels.shape[:2]
    if height == 1 or width == 1:
        flat = np.zeros((height * width + width + 1, 4), np.uint8)
        flat[: height * width] = pixels.reshape(-1, 4)
        return flat[: height * width].reshape(pixels.shape)
    if width % _ALIKE:
        return np.ascontiguousarray(pixels)
    rows = np.empty((height, width + _LINE, 4), np.uint8)
    rows[:, :width] = pixels
    rows[:, width:] = 0
    return rows


Parallel = Callable[[int, Callable[[int], object]], None]
"""``parallel(units, work)`` calls work(0) .. work(units - 1) from several threads and raises the first error."""


class TextureTable:
    """Collects the textures of one draw list; each gets a row."""

    def __init__(self) -> None:
        self._rows: dict[Texture, int] = {}
        self.keep: list[Texels] = []
        """What the addresses point into, after ``as_tables``."""

    def row(self, texture: Texture) -> int:
        """The row of a texture."""
        return self._rows.setdefault(texture, len(self._rows))

    def as_tables(self, parallel: Parallel | None = None) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """(n, TI_COLUMNS) int64 and (n, TF_COLUMNS) float32, at least one row each.

        Args:
            parallel: decodes images that were not used lately at the same time; None: one after the other.

        Raises:
            ImageError: see ``texels_of``; the message names the image.
        """
        if not self._rows:
            return np.zeros((1, TI_COLUMNS), np.int64), np.zeros((1, TF_COLUMNS), np.float32)
        found = _decode({id(texture.image): texture for texture in self._rows}, parallel)
        integers: list[tuple[int, ...]] = []
        for texture in self._rows:
            texels = found[id(texture.image)]
            self.keep.append(texels)
            height, stride = texels.rows.shape[:2]
            sampler = texture.sampler
            # Without mip levels there is no footprint to decide by: the magnification filter is used throughout.
            integers.append(
                (
                    address_of(texels.rows, np.uint8),
                    texels.width,
                    height,
                    _WRAP[sampler.wrap_s],
                    _WRAP[sampler.wrap_t],
                    int(sampler.mag_linear),
                    texture.uv_set,
                    int(texture.uv_transform is not None),
                    stride,
                )
            )
        with np.errstate(over="ignore"):  # a posted texture transform beyond float32 is infinite
            transforms = [texture.uv_transform or (1.0, 0.0, 0.0, 0.0, 1.0, 0.0) for texture in self._rows]
            floats = np.array(transforms, dtype=np.float32)
        return np.array(integers, dtype=np.int64), floats


def _decode(textures: dict[int, Texture], parallel: Parallel | None) -> dict[int, Texels]:
    """The texels of the textures' images, by the same keys."""
    found = {key: texels for key, texture in textures.items() if (texels := _decoded.get(texture.image)) is not None}
    missing = [key for key in textures if key not in found]

    def decode(number: int) -> None:
        texture = textures[missing[number]]
        with image_named(texture.name):
            found[missing[number]] = texels_of(texture.image)

    if parallel is not None and len(missing) > 1:
        parallel(len(missing), decode)
    else:
        for number in range(len(missing)):
            decode(number)
    return found
