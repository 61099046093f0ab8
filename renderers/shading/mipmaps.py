"""Mip levels of images."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.cache import Cache
from renderers.color import linear_values_from_srgb, srgb_values_from_linear
from renderers.compiler.device_function import device_function
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.drawlist import Image
from renderers.shading.textures import texels_of
from renderers.stop import current_stop

MAX_LEVELS: Final = 15
"""Maximum number of levels: those of an image of 16384 texels. Larger images end with more than one texel."""
MAX_MIP_BYTES: Final = 512 << 20
"""Maximum number of bytes of the levels that are kept, without the first: those of 24 images of 4096 x 4096."""

_LINEAR_STEPS: Final = 65535


def _tables() -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
    """Tables from bytes of sRGB to linear light in 65535 steps, and back."""
    linear = linear_values_from_srgb(np.arange(256) / 255.0)
    shown = srgb_values_from_linear(np.arange(_LINEAR_STEPS + 1) / _LINEAR_STEPS)
    return np.round(linear * _LINEAR_STEPS).astype(np.uint16), np.round(shown * 255.0).astype(np.uint8)


_TO_LINEAR, _FROM_LINEAR = _tables()
_SAME: Final = np.round(np.arange(256) * (_LINEAR_STEPS / 255.0)).astype(np.uint16)
_BACK: Final = np.round(np.arange(_LINEAR_STEPS + 1) * (255.0 / _LINEAR_STEPS)).astype(np.uint8)


_chains: Cache[Image, dict[bool, tuple[NDArray[np.uint8], ...]]] = Cache(MAX_MIP_BYTES, weak=True)


def mip_chain(image: Image, srgb: bool) -> tuple[NDArray[np.uint8], ...]:
    """Return the image's mip levels without the first, from the cache if possible; see ``make_chain``.

    Args:
        srgb: average colours in linear light. Alpha is always averaged as it is.

    Raises:
        ImageError: the image cannot be decoded. The message does not name the image.
    """
    chains = _chains.get(image) or {}
    chain = chains.get(srgb)
    if chain is None:
        chain = make_chain(texels_of(image).rgba, srgb)
        chains = {**chains, srgb: chain}
        _chains.put(image, chains, sum(level.nbytes for each in chains.values() for level in each))
    return chain


def make_chain(rgba: NDArray[np.uint8], srgb: bool) -> tuple[NDArray[np.uint8], ...]:
    """Return the mip levels of (H, W, 4) uint8 after the first, each half the size of the one before, to one texel.

    A texel is the mean of the area it covers. Sizes round down.

    Raises:
        Exception: the current ``StopFlag`` was set.
    """
    levels, stop = [rgba], current_stop()
    there, back = (_TO_LINEAR, _FROM_LINEAR) if srgb else (_SAME, _BACK)
    while len(levels) < MAX_LEVELS and max(levels[-1].shape[:2]) > 1:
        height, width = (max(side // 2, 1) for side in levels[-1].shape[:2])
        smaller = np.empty((height, width, 4), np.uint8)
        halve(_read_only(levels[-1]), smaller, there, back, stop.address)
        stop.check()
        levels.append(smaller)
    return tuple(levels[1:])


def _read_only(texels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a read-only view: images are read-only, and another type would be compiled while serving."""
    view = texels.view()
    view.flags.writeable = False
    return view


@device_function
def _covered(index, size, smaller):
    """Return the first source texel and the weights of it and the next two, in units of 1 / smaller.

    A texel of the smaller level covers size / smaller texels: two, or up to one more where the size is odd.
    """
    begin = index * size
    first = begin // smaller
    end = begin + size
    w0 = min((first + 1) * smaller, end) - begin
    w1 = max(min((first + 2) * smaller, end) - (first + 1) * smaller, 0)
    w2 = max(end - (first + 2) * smaller, 0)
    return first, w0, w1, w2


@kernel("void(Array(uint8, 3, 'C', readonly=True), uint8[:,:,::1], uint16[::1], uint8[::1], int64)")
def halve(source, out, there, back, stop_at):
    """Fill a level from the one before.

    Args:
        there, back: tables that convert colours to the space where means are taken and back.
        stop_at: address of a ``StopFlag``, checked once per row: the first level of 8192 x 8192 texels takes a second.
    """
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
