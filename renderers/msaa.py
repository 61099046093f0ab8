"""Multisample anti-aliasing: positions of the samples, and the struct that holds a band's samples.

Scenes of opaque surfaces are rasterized with all samples at once (``renderers.raster.msaa``). Each surface is shaded
once per pixel. Scenes with translucent surfaces are rendered once per sample position, by cameras whose principal
points differ.
"""

from dataclasses import replace
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.compiler.kernel_types import F32, I32, I64, U8, Pointer
from renderers.compiler.structs import Struct

_SAMPLE_POSITIONS: Final[dict[int, tuple[tuple[int, int], ...]]] = {
    1: ((0, 0),),
    4: ((-2, -6), (6, -2), (-6, 2), (2, 6)),
    8: ((1, -3), (-1, 3), (5, 1), (-3, -5), (-5, 5), (-7, -1), (3, 7), (7, -7)),
}
"""Offsets (x, y) from the pixel's centre in 1/16 pixel, by number of samples: Direct3D's standard patterns."""


class SampleBand(Struct):
    """Memory of one thread for a band with several samples per pixel. Index 0 is the band's first pixel.

    A *slot* holds the eight samples of a pixel whose samples differ. A pixel is *mixed* if its samples see several
    surfaces, or a surface and none. One of the surfaces is shaded for the pixel itself (``ids``). The others are its
    *entries*."""

    sample_ids: Pointer[I32]  # (slots, 8)
    sample_inv_z: Pointer[F32]  # (slots, 8)
    first_row: I64  # row of the image that the band begins with
    ids: Pointer[I32]  # (BAND_ROWS, stride): primitive id that is shaded for the pixel, -1: none
    max_entries: I64  # maximum number of entries of a row
    counts: Pointer[I32]  # (BAND_ROWS,): number of entries of each row
    entry_ids: Pointer[I32]  # (BAND_ROWS, max_entries): primitive ids of the entries
    entry_columns: Pointer[I32]  # (BAND_ROWS, max_entries): columns of their pixels in the image
    entry_weights: Pointer[U8]  # (BAND_ROWS, max_entries): number of samples that see them, of 8
    mixed_counts: Pointer[I32]  # (BAND_ROWS,): number of mixed pixels of each row
    mixed: Pointer[I32]  # (BAND_ROWS, stride): column << 8 | samples that see ``ids`` << 4 | that see none
    entry_colors: Pointer[U8]  # (BAND_ROWS, max_entries, 3): RGB of the entries, filled by shading
    far: Pointer[F32]  # (BAND_ROWS, stride): smallest 1/z of a pixel's samples
    near: Pointer[F32]  # (BAND_ROWS, stride): largest 1/z of a pixel's samples
    slots: Pointer[I32]  # (BAND_ROWS, stride): slot of the pixel's samples, -1: none
    owners: Pointer[I32]  # (BAND_ROWS, stride): index of the primitive that covers the pixel


def sample_cameras(camera: Camera, samples: int) -> tuple[Camera, ...]:
    """Return one camera per sample position; ``camera`` itself for a single sample.

    Raises:
        ValueError: ``samples`` is not 1, 4 or 8.
    """
    offsets = _SAMPLE_POSITIONS.get(samples)
    if offsets is None:
        raise ValueError(f"samples must be 1, 4 or 8, not {samples}")
    if samples == 1:
        return (camera,)
    return tuple(replace(camera, cx=camera.cx - x / 16.0, cy=camera.cy - y / 16.0) for x, y in offsets)


def sample_offsets(samples: int) -> NDArray[np.int32]:
    """Return (2, 8) int32: x and y of the samples' offsets from the pixel's centre, in 1/256 pixel. Four are repeated.

    Raises:
        ValueError: ``samples`` is not 4 or 8.
    """
    if samples not in (4, 8):
        raise ValueError(f"samples must be 4 or 8, not {samples}")
    return np.ascontiguousarray(16 * np.array(_SAMPLE_POSITIONS[samples] * (8 // samples), np.int32).T)


@cache
def lanes_of_mask() -> NDArray[np.int32]:
    """Return (256, 8) int32: for each mask of eight lanes, its set lanes in ascending order, padded with 0."""
    masks, bits = np.arange(256)[:, None], np.arange(8)
    return np.ascontiguousarray(np.sort(np.where(masks >> bits & 1, bits, 8), axis=1) % 8, np.int32)
