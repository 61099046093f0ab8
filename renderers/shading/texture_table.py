"""The table of a draw list's textures, which the sampler reads."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.pointers import address_of
from renderers.drawlist import Image, Texture, Wrap, image_named
from renderers.shading.mipmaps import MAX_LEVELS, mip_chain
from renderers.shading.textures import is_decoded, texels_of

WRAP_REPEAT: Final = 0
WRAP_CLAMP: Final = 1
WRAP_MIRROR: Final = 2
_WRAPS: Final = {Wrap.REPEAT: WRAP_REPEAT, Wrap.CLAMP_TO_EDGE: WRAP_CLAMP, Wrap.MIRRORED_REPEAT: WRAP_MIRROR}
MIPS_NONE: Final = 0
MIPS_NEAREST: Final = 1
MIPS_LINEAR: Final = 2

# Columns of the integer table.
TI_WRAP_S: Final = 0
TI_WRAP_T: Final = 1
TI_MAG_LINEAR: Final = 2
TI_MIN_LINEAR: Final = 3
TI_MIPS: Final = 4  # MIPS_NONE, MIPS_NEAREST or MIPS_LINEAR
TI_LEVELS: Final = 5
TI_UV_SET: Final = 6
TI_SRGB: Final = 7  # 1: the colour channels are decoded to linear light
TI_LEVEL: Final = 8  # 4 columns per level: address, width, height, texels from one row to the next
TI_COLUMNS: Final = TI_LEVEL + 4 * MAX_LEVELS
TF_COLUMNS: Final = 6
"""Columns of the float table: ``Texture.uv_transform``."""

Parallel = Callable[[int, Callable[[int], object]], None]
"""``parallel(units, work)`` calls work(0) .. work(units - 1) from several threads and raises the first error."""


class TextureTable:
    """Collects the textures of one draw list. Every pair of texture and colour space gets a row."""

    def __init__(self, *, mipmaps: bool = False) -> None:
        """
        Args:
            mipmaps: minify as the samplers say. False: always the magnification filter on the first level.
        """
        self._mipmaps = mipmaps
        self._rows: dict[tuple[Texture, bool], int] = {}
        self.keep: list[NDArray[np.uint8]] = []
        """Arrays that the addresses of ``as_tables`` point into."""

    def row(self, texture: Texture, srgb: bool) -> int:
        """Return the row of a texture.

        Args:
            srgb: decode its colour channels to linear light.
        """
        return self._rows.setdefault((texture, srgb), len(self._rows))

    def as_tables(self, parallel: Parallel | None = None) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Return (n, TI_COLUMNS) int64 and (n, TF_COLUMNS) float32, at least one row each. Decodes the images.

        Args:
            parallel: runs several decoders at a time; None: one after the other.

        Raises:
            ImageError: an image cannot be decoded; the message names it.
        """
        count = max(len(self._rows), 1)
        integers = np.zeros((count, TI_COLUMNS), np.int64)
        floats = np.zeros((count, TF_COLUMNS), np.float32)
        _decode({id(texture.image): texture for texture, _ in self._rows}, parallel)
        for (texture, srgb), row in self._rows.items():
            sampler = texture.sampler
            texels = texels_of(texture.image)
            levels = [texels.rows]
            min_linear, mips = sampler.mag_linear, MIPS_NONE
            if self._mipmaps:
                levels += mip_chain(texture.image, srgb)
                min_linear = sampler.min_linear
                if sampler.mipmaps and len(levels) > 1:
                    mips = MIPS_LINEAR if sampler.mip_linear else MIPS_NEAREST
            integers[row, :TI_LEVEL] = (
                _WRAPS[sampler.wrap_s],
                _WRAPS[sampler.wrap_t],
                sampler.mag_linear,
                min_linear,
                mips,
                len(levels),
                texture.uv_set,
                srgb,
            )
            for k, level in enumerate(levels):
                height, stride = level.shape[:2]
                column, width = TI_LEVEL + 4 * k, stride if k else texels.width
                integers[row, column : column + 4] = address_of(level, np.uint8), width, height, stride
            self.keep += levels
            with np.errstate(over="ignore"):  # a posted texture transform beyond float32 is infinite
                floats[row] = texture.uv_transform or (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
        return integers, floats


def _decode(textures: dict[int, Texture], parallel: Parallel | None) -> None:
    """Decode the images of the textures that are not in the cache."""
    missing = [texture for texture in textures.values() if not is_decoded(texture.image)]

    def decode(number: int) -> None:
        with image_named(missing[number].name):
            texels_of(missing[number].image)

    if parallel is not None and len(missing) > 1:
        parallel(len(missing), decode)
    else:
        for number in range(len(missing)):
            decode(number)


def is_opaque(image: Image) -> bool:
    """Return True if the image has no transparent texel."""
    return texels_of(image).opaque
