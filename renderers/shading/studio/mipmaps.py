"""Images with their mip levels, and the table by which kernels find them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.cache import Cache
from renderers.color import linear_values_from_srgb, srgb_values_from_linear
from renderers.compiler.device_function import inner
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import address_of
from renderers.drawlist import Image, Texture, Wrap, image_named
from renderers.shading.textures import texels_of
from renderers.stop import current_stop

MAX_LEVELS: Final = 15
"""Of an image of 16384 texels, the rasterizer's own limit; larger ones end with more than one texel."""
MAX_MIP_BYTES: Final = 512 << 20
"""Levels that are kept: those of 24 images of 4096 x 4096. The images themselves are kept elsewhere."""

# Columns of the integer table.
TI_WRAP_S: Final = 0
TI_WRAP_T: Final = 1
TI_MAG_LINEAR: Final = 2
TI_MIN_LINEAR: Final = 3
TI_MIPS: Final = 4  # 0: the first level only, 1: the nearest level, 2: between two levels
TI_LEVELS: Final = 5
TI_UV_SET: Final = 6
TI_SRGB: Final = 7
TI_LEVEL: Final = 8  # three columns a level: address, width, height
TI_COLUMNS: Final = TI_LEVEL + 3 * MAX_LEVELS
TF_COLUMNS: Final = 6
"""The float table holds ``Texture.uv_transform``."""
WRAPS: Final = {Wrap.REPEAT: 0, Wrap.CLAMP_TO_EDGE: 1, Wrap.MIRRORED_REPEAT: 2}

_LINEAR_STEPS: Final = 65535


def _tables() -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
    """Bytes of sRGB to linear light in 65535 steps, and back."""
    linear = linear_values_from_srgb(np.arange(256) / 255.0)
    shown = srgb_values_from_linear(np.arange(_LINEAR_STEPS + 1) / _LINEAR_STEPS)
    return np.round(linear * _LINEAR_STEPS).astype(np.uint16), np.round(shown * 255.0).astype(np.uint8)


_TO_LINEAR, _FROM_LINEAR = _tables()
_SAME: Final = np.round(np.arange(256) * (_LINEAR_STEPS / 255.0)).astype(np.uint16)
_BACK: Final = np.round(np.arange(_LINEAR_STEPS + 1) * (255.0 / _LINEAR_STEPS)).astype(np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class MipChain:
    """An image at half the size of the level before, down to one texel."""

    levels: tuple[NDArray[np.uint8], ...]
    """(h, w, 4) uint8 RGBA each, C-contiguous, as stored; the first is the image."""

    @property
    def nbytes(self) -> int:
        """Of what was made here."""
        return sum(level.nbytes for level in self.levels[1:])


_chains: Cache[Image, dict[bool, MipChain]] = Cache(MAX_MIP_BYTES, weak=True)


def mip_chain(image: Image, srgb: bool) -> MipChain:
    """The image's levels, made once while it is alive and was used lately.

    Args:
        srgb: average in linear light; alpha is always averaged as it is.

    Raises:
        ImageError: it cannot be decoded; without the image's name.
    """
    chains = _chains.get(image) or {}
    known = chains.get(srgb)
    if known is None:
        known = make_chain(texels_of(image).rgba, srgb)
        chains = {**chains, srgb: known}
        _chains.put(image, chains, sum(chain.nbytes for chain in chains.values()))
    return known


def make_chain(rgba: NDArray[np.uint8], srgb: bool) -> MipChain:
    """Levels of (H, W, 4) uint8: each texel is the mean of what it covers of the level before; sizes round down.

    Raises:
        Exception: the current ``StopFlag`` was set.
    """
    levels, stop = [rgba], current_stop()
    there, back = (_TO_LINEAR, _FROM_LINEAR) if srgb else (_SAME, _BACK)
    while len(levels) < MAX_LEVELS and max(levels[-1].shape[:2]) > 1:
        height, width = (max(side // 2, 1) for side in levels[-1].shape[:2])
        smaller = np.empty((height, width, 4), np.uint8)
        _halve(_read_only(levels[-1]), smaller, there, back, stop.address)
        stop.check()
        levels.append(smaller)
    return MipChain(tuple(levels))


def _read_only(texels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Images are read-only, levels are not: to Numba two types, of which the second would be compiled while serving."""
    view = texels.view()
    view.flags.writeable = False
    return view


@inner
def _covered(index, size, smaller):
    """First source texel and the weights of it and the next two, in units of 1 / smaller: a texel of the smaller level
    covers size / smaller texels, two or (where the size is odd) up to a half on either side more."""
    begin = index * size
    first = begin // smaller
    end = begin + size
    w0 = min((first + 1) * smaller, end) - begin
    w1 = max(min((first + 2) * smaller, end) - (first + 1) * smaller, 0)
    w2 = max(end - (first + 2) * smaller, 0)
    return first, w0, w1, w2


@kernel("void(Array(uint8, 3, 'C', readonly=True), uint8[:,:,::1], uint16[::1], uint8[::1], int64)")
def _halve(source, out, there, back, stop_at):
    """A level from the one before; ``there`` and ``back`` convert colours to where means are taken and back. The
    ``StopFlag`` at ``stop_at`` is looked at once a row: the first level of 8192 x 8192 texels takes a second."""
    height, width = source.shape[0], source.shape[1]
    rows, columns = out.shape[0], out.shape[1]
    for y in range(rows):
        if is_set(stop_at):
            break
        j, v0, v1, v2 = _covered(y, height, rows)
        for x in range(columns):
            i, h0, h1, h2 = _covered(x, width, columns)
            red = green = blue = alpha = np.int64(0)
            for dj in range(3):
                v = v0 if dj == 0 else (v1 if dj == 1 else v2)
                if v == 0:
                    continue
                for di in range(3):
                    h = h0 if di == 0 else (h1 if di == 1 else h2)
                    if h == 0:
                        continue
                    weight = v * h
                    red += weight * there[source[j + dj, i + di, 0]]
                    green += weight * there[source[j + dj, i + di, 1]]
                    blue += weight * there[source[j + dj, i + di, 2]]
                    alpha += weight * source[j + dj, i + di, 3]
            total = np.int64(height) * width
            half = total // 2
            out[y, x, 0] = back[(red + half) // total]
            out[y, x, 1] = back[(green + half) // total]
            out[y, x, 2] = back[(blue + half) // total]
            out[y, x, 3] = np.uint8((alpha + half) // total)


class MipTable:
    """Collects the textures of one draw list; each use of one as sRGB or not gets a row."""

    def __init__(self) -> None:
        self._rows: dict[tuple[Texture, bool], int] = {}
        self._integers: list[list[int]] = []
        self._floats: list[tuple[float, ...]] = []
        self.keep: list[MipChain] = []
        """What the addresses point into."""

    def row(self, texture: Texture, srgb: bool) -> int:
        """The row of a texture, decoding its image at the first time.

        Raises:
            ImageError: see ``mip_chain``; the message names the image.
        """
        known = self._rows.get((texture, srgb))
        if known is not None:
            return known
        with image_named(texture.name):
            chain = mip_chain(texture.image, srgb)
        self.keep.append(chain)
        sampler = texture.sampler
        row = [
            WRAPS[sampler.wrap_s],
            WRAPS[sampler.wrap_t],
            int(sampler.mag_linear),
            int(sampler.min_linear),
            (2 if sampler.mip_linear else 1) if sampler.mipmaps else 0,
            len(chain.levels),
            texture.uv_set,
            int(srgb),
        ]
        for level in chain.levels:
            row += (address_of(level, np.uint8), level.shape[1], level.shape[0])
        self._integers.append(row + [0] * (TI_COLUMNS - len(row)))
        self._floats.append(texture.uv_transform or (1.0, 0.0, 0.0, 0.0, 1.0, 0.0))
        result = self._rows[texture, srgb] = len(self._integers) - 1
        return result

    def as_tables(self) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """(n, TI_COLUMNS) int64 and (n, TF_COLUMNS) float32, at least one row each."""
        if not self._integers:
            return np.zeros((1, TI_COLUMNS), np.int64), np.zeros((1, TF_COLUMNS), np.float32)
        with np.errstate(over="ignore"):  # a posted texture transform beyond float32 is infinite
            floats = np.array(self._floats, np.float32)
        return np.array(self._integers, np.int64), floats
