"""Anti-aliasing by samples on visibility: each pixel's samples are rasterized, and what they see is shaded once.

Opaque pictures are rasterized with all samples at once (``renderers.raster.msaa.coverage``), and only pixels at
edges are shaded for each surface that they see (``renderers.raster.msaa.edges``). Translucent ones are drawn at every
sample position by a camera whose principal point is moved.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera

_SIXTEENTHS: Final[dict[int, tuple[tuple[int, int], ...]]] = {
    1: ((0, 0),),
    4: ((-2, -6), (6, -2), (-6, 2), (2, 6)),
    8: ((1, -3), (-1, 3), (5, 1), (-3, -5), (-5, 5), (-7, -1), (3, 7), (7, -7)),
}
"""Offsets from the pixel's centre in 1/16 pixel: Direct3D's standard patterns, which most GPUs use."""


# A band's working memory, int64 addresses. Rows are the band's own, J_STRIDE or E_ROOM values apart.
E_SAMPLE_IDS: Final = 0  # (slots, 8) int32
E_SAMPLE_INV_Z: Final = 1  # (slots, 8) float32
E_IDS: Final = 2  # (BAND_ROWS, J_STRIDE) int32: the record that is shaded for the pixel, -1: none
E_ROOM: Final = 3  # entries that a row has room for
E_COUNTS: Final = 4  # (BAND_ROWS,) int32: entries of each row
E_RECORDS: Final = 5  # (BAND_ROWS, E_ROOM) int32: entries: further records of pixels
E_PLACES: Final = 6  # (BAND_ROWS, E_ROOM) int32: their columns
E_WEIGHTS: Final = 7  # (BAND_ROWS, E_ROOM) uint8: samples that see them, of 8
E_MIXED: Final = 8  # (BAND_ROWS,) int32: pixels of each row that are mixed
E_MIXES: Final = 9  # (BAND_ROWS, J_STRIDE) int32: column << 8 | samples of the pixel's own record << 4 | of nothing
E_COLORS: Final = 10  # (BAND_ROWS, E_ROOM, 3) uint8: for whoever shades the entries
E_FAR: Final = 11  # (BAND_ROWS, J_STRIDE) float32
E_NEAR: Final = 12
E_SLOTS: Final = 13  # (BAND_ROWS, J_STRIDE) int32
E_OWNERS: Final = 14  # (BAND_ROWS, J_STRIDE) int32
E_COLUMNS: Final = 15


def sample_cameras(camera: Camera, samples: int) -> tuple[Camera, ...]:
    """A camera for each sample position; the same one for a single sample.

    Raises:
        ValueError: ``samples`` is not 1, 4 or 8.
    """
    offsets = _SIXTEENTHS.get(samples)
    if offsets is None:
        raise ValueError(f"samples must be 1, 4 or 8, not {samples}")
    if samples == 1:
        return (camera,)
    return tuple(replace(camera, cx=camera.cx - x / 16.0, cy=camera.cy - y / 16.0) for x, y in offsets)


def sample_offsets(samples: int) -> NDArray[np.int32]:
    """(2, 8) int32: the samples' offsets from the pixel's centre across and down, 1/256 pixel; four come twice.

    Raises:
        ValueError: ``samples`` is not 4 or 8.
    """
    if samples not in (4, 8):
        raise ValueError(f"samples must be 4 or 8, not {samples}")
    return np.ascontiguousarray(16 * np.array(_SIXTEENTHS[samples] * (8 // samples), np.int32).T)


@cache
def lanes_of_masks() -> NDArray[np.int32]:
    """(256, 8) int32: the bits that are set in each mask of eight, the lowest first; 0 behind them."""
    masks, bits = np.arange(256)[:, None], np.arange(8)
    return np.ascontiguousarray(np.sort(np.where(masks >> bits & 1, bits, 8), axis=1) % 8, np.int32)
