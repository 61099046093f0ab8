"""Anti-aliasing of the looks that shade whole visibility buffers, by samples on visibility."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers import msaa as at
from renderers.camera import Camera
from renderers.compiler.kernel_calls import kernel_address
from renderers.compiler.pointers import Table, address_of, table
from renderers.compiler.simd import LANES
from renderers.drawlist import DrawList
from renderers.interface import Look
from renderers.msaa import sample_cameras
from renderers.raster.buffer_pool import Scratch
from renderers.raster.msaa.edges import draw_samples, find_edges, shade_mixed
from renderers.shading import Painter, ShadingScene, paint
from renderers.shading.headlight.shade_rows import shade_rows
from renderers.visibility_buffer import BAND_ROWS, Rasterizer, SampledShader

_GAP: Final = 1040
"""Values between arrays of a band, for the sake of ``resolve.LAYER_GAP``; also what is read behind them."""


def edge_memory(scratch: Scratch, threads: int, camera: Camera, samples: int, stride: int) -> int:
    """Address of (threads, E_COLUMNS) int64, see ``samples``: working memory of the bands that threads draw at the same
    time.

    Args:
        scratch: must live as long as bands are drawn.
        stride: values from one row of records to the next.
    """
    sizes = threads, camera.width, samples, stride
    return scratch.made(sizes, lambda: _edge_tables(scratch, *sizes))[1]


def _edge_tables(
    scratch: Scratch, threads: int, width: int, samples: int, stride: int
) -> tuple[NDArray[np.int64], int]:
    """``edge_memory``'s, and their address."""
    room = (samples - 1) * width
    parts = {  # values of 4 bytes
        at.E_SAMPLE_IDS: BAND_ROWS * stride * LANES,
        at.E_SAMPLE_INV_Z: BAND_ROWS * stride * LANES,
        at.E_IDS: BAND_ROWS * stride,
        at.E_FAR: BAND_ROWS * stride,
        at.E_NEAR: BAND_ROWS * stride,
        at.E_SLOTS: BAND_ROWS * stride,
        at.E_OWNERS: BAND_ROWS * stride,
        at.E_COUNTS: BAND_ROWS,
        at.E_RECORDS: BAND_ROWS * room,
        at.E_PLACES: BAND_ROWS * room,
        at.E_WEIGHTS: BAND_ROWS * room // 4,
        at.E_MIXED: BAND_ROWS,
        at.E_MIXES: BAND_ROWS * stride,
        at.E_COLORS: BAND_ROWS * room * 3 // 4,
    }
    size = sum(parts.values()) + _GAP * len(parts)
    place = scratch.take("samples", threads * size, np.int32)[1]
    tables = np.empty((threads, at.E_COLUMNS), np.int64)
    tables[:, at.E_ROOM] = room
    for column, values in parts.items():
        tables[:, column] = range(place, place + threads * 4 * size, 4 * size)
        place += 4 * (values + _GAP)
    return tables, address_of(tables, np.int64)


@cache
def edge_kernels() -> tuple[int, int]:
    """Addresses of draw_samples and find_edges."""
    return kernel_address(draw_samples), kernel_address(find_edges)


@cache
def _shading_kernels() -> tuple[int, int]:
    """Addresses of shade_mixed and shade_rows."""
    return kernel_address(shade_mixed), kernel_address(shade_rows)


def mixed_bands(painter: Painter, table: Callable[[int], Table] = table) -> SampledShader:
    """For ``Rasterizer.sampled``: shades and mixes bands of an opaque scene as they are shown, as VTK mixes them.

    Args:
        painter: of the whole picture. table: gives working memory, which nobody else uses while this is.
    """
    mixing, shading = _shading_kernels()
    own, memory, address = table(2)
    memory[0], memory[1] = shading, painter.job
    return SampledShader(mixing, address, (own, painter))


def paint_each_sample(
    rasterizer: Rasterizer,
    scene: DrawList,
    shading: ShadingScene,
    camera: Camera,
    look: Look,
    color: NDArray[np.uint8],
) -> None:
    """As ``renderers.shading.passes`` for translucent scenes with ``look.samples`` samples a pixel: drawn wholly at
    every sample position, mixed as they are shown."""
    total = np.zeros(color.shape, np.uint16)
    for each in sample_cameras(camera, look.samples):
        paint(rasterizer, scene, shading, each, look, color)
        total += color
    color[:] = (total + look.samples // 2) // look.samples
