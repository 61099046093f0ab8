"""Anti-aliasing by samples on visibility: each pixel's samples are rasterized, and what they see is shaded once.

Opaque pictures of Drake's looks are rasterized with all samples at once (``renderers.cpu.multisample``). Elsewhere
every sample position is a visibility buffer of its own, drawn by a camera whose principal point is moved. A pixel that
sees one element in all samples is shaded once; only those at edges are shaded for each element they see.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.jit import kernel

SampleCount = Literal[1, 4, 8]

_SIXTEENTHS: Final[dict[int, tuple[tuple[int, int], ...]]] = {
    1: ((0, 0),),
    4: ((-2, -6), (6, -2), (-6, 2), (2, 6)),
    8: ((1, -3), (-1, 3), (5, 1), (-3, -5), (-5, 5), (-7, -1), (3, 7), (7, -7)),
}
"""Offsets from the pixel's centre in 1/16 pixel: Direct3D's standard patterns, which most GPUs use."""


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
    offsets = _SIXTEENTHS[samples] * (8 // samples)
    return np.ascontiguousarray(16 * np.array(offsets, np.int32).T)


def distinct(planes: Sequence[NDArray[np.int32]]) -> tuple[NDArray[np.int32], NDArray[np.uint8]]:
    """What the samples see, each element once.

    Args:
        planes: (H, W) int32 records of each sample, -1 for nothing.

    Returns:
        (n, H, W) int32: the k-th different record of every pixel in the order of the samples, -1 for none. (n, H, W)
        uint8: how many of its samples see it. Samples that see nothing count nowhere.
    """
    layers = np.full((len(planes), *planes[0].shape), -1, np.int32)
    counts = np.zeros(layers.shape, np.uint8)
    _distinct(np.stack(planes), layers, counts)
    used = 1
    while used < len(layers) and bool((layers[used] >= 0).any()):
        used += 1
    return layers[:used], counts[:used]


@kernel("void(int32[:,:,::1], int32[:,:,::1], uint8[:,:,::1])")
def _distinct(planes, layers, counts):  # type: ignore[no-untyped-def]
    """``layers`` holds -1 and ``counts`` 0 when called."""
    n, height, width = planes.shape
    differ = np.empty(width, np.int32)
    seen = np.empty(n, np.int32)
    for y in range(height):
        first, top, count = planes[0, y], layers[0, y], counts[0, y]
        for x in range(width):  # in vectors
            top[x] = first[x]
            count[x] = n if first[x] >= 0 else 0
            differ[x] = 0
        for k in range(1, n):
            plane = planes[k, y]
            for x in range(width):
                differ[x] |= plane[x] ^ first[x]
        for x in range(width):
            if differ[x] == 0:
                continue
            top[x], count[x] = -1, 0
            used = 0
            for k in range(n):
                record = planes[k, y, x]
                if record < 0:
                    continue
                slot = 0
                while slot < used and seen[slot] != record:
                    slot += 1
                if slot == used:
                    seen[used] = record
                    layers[used, y, x] = record
                    used += 1
                counts[slot, y, x] += 1


def mix(
    colors: NDArray[np.uint8],
    counts: NDArray[np.uint8],
    samples: int,
    background: tuple[int, int, int],
    out: NDArray[np.uint8],
) -> None:
    """The mean of what the samples see: (n, H, W, 3) colours by (n, H, W) counts of ``distinct``, the background for
    the rest."""
    _mix(colors, counts, samples, np.array(background, np.uint8), out)


@kernel("void(uint8[:,:,:,::1], uint8[:,:,::1], int64, uint8[::1], uint8[:,:,::1])")
def _mix(colors, counts, samples, background, out):  # type: ignore[no-untyped-def]
    n, height, width = counts.shape
    for y in range(height):
        for x in range(width):
            if counts[0, y, x] == samples:
                out[y, x, 0], out[y, x, 1], out[y, x, 2] = colors[0, y, x, 0], colors[0, y, x, 1], colors[0, y, x, 2]
                continue
            rest = samples
            for k in range(n):
                rest -= counts[k, y, x]
            for c in range(3):
                total = rest * np.int64(background[c])
                for k in range(n):
                    total += np.int64(counts[k, y, x]) * np.int64(colors[k, y, x, c])
                out[y, x, c] = np.uint8((total + samples // 2) // samples)
