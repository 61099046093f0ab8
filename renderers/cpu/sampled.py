"""Anti-aliasing of the looks that shade whole visibility buffers, by samples on visibility."""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.cpu import edges as at
from renderers.cpu.pools import Scratch
from renderers.cpu.visibility import BAND_ROWS, Rasterizer
from renderers.drawlist import DrawList
from renderers.pointers import address_of
from renderers.port import Look
from renderers.samples import sample_cameras
from renderers.shading import EntryPainter, Painter, ShadingScene, paint
from renderers.simd import LANES

_GAP: Final = 1040
"""Values between arrays of a band, for the sake of ``resolve.LAYER_GAP``; also what is read behind them."""


class SampledBands:
    """Draws bands of an opaque scene with 4 or 8 samples a pixel, mixed as they are shown, as VTK mixes them.

    Every pixel is shaded once for each surface that its samples see (see ``edges``), at the pixel's centre.
    """

    def __init__(
        self,
        painter: Painter,
        scratch: Scratch,
        threads: int,
        camera: Camera,
        look: Look,
        color: NDArray[np.uint8],
        *,
        stride: int,
    ) -> None:
        """
        Args:
            painter: of the whole picture ``color``. scratch: must live as long as bands are drawn.
            threads: how many at most draw at the same time.
            stride: values from one row of records to the next.
        """
        self._painter = painter
        self._camera = camera
        self._stride = stride
        self._color = address_of(color, np.uint8)
        red, green, blue = look.background
        self._background = red | green << 8 | blue << 16
        room = (look.samples - 1) * camera.width
        samples = BAND_ROWS * stride * LANES
        parts = {  # values of 4 bytes
            at.E_SAMPLE_IDS: samples,
            at.E_SAMPLE_INV_Z: samples,
            at.E_IDS: BAND_ROWS * stride,
            at.E_COUNTS: BAND_ROWS,
            at.E_RECORDS: BAND_ROWS * room,
            at.E_PLACES: BAND_ROWS * room,
            at.E_WEIGHTS: BAND_ROWS * room // 4,
            at.E_MIXED: BAND_ROWS,
            at.E_MIXES: BAND_ROWS * stride,
        }
        size = sum(parts.values()) + BAND_ROWS * room * 3 // 4 + _GAP * (len(parts) + 1)
        memory = scratch.take("samples", threads * size, np.int32)[1]
        self._tables = np.zeros((threads, at.E_COLUMNS), np.int64)
        self._free: deque[tuple[int, NDArray[np.int64], int, EntryPainter]] = deque()
        for k, table in enumerate(self._tables):
            place = memory + 4 * size * k
            for column, values in parts.items():
                table[column] = place
                place += 4 * (values + _GAP)
            table[at.E_ROOM] = room
            further = EntryPainter(painter, room, int(table[at.E_PLACES]), int(table[at.E_COUNTS]), place)
            self._free.append((address_of(table, np.int64), table, place, further))

    def draw(self, job: int, lens: int, band: int) -> None:
        """Raster, shade and mix one band; ``job``, ``lens``: addresses of a ``FrameJob``'s tables."""
        own = self._free.pop()  # never empty: as many as threads
        edges, table, colors, further = own
        at.draw_samples(job, lens, band, edges)
        self._painter.band(band, int(table[at.E_IDS]) - 4 * band * BAND_ROWS * self._stride)
        further.band(band, int(table[at.E_RECORDS]))
        begin, width = band * BAND_ROWS, self._camera.width
        end = min(begin + BAND_ROWS, self._camera.height)
        at.mix_edges(edges, self._stride, width, begin, end, colors, self._background, self._color)
        self._free.append(own)


def paint_each_sample(
    rasterizer: Rasterizer,
    scene: DrawList,
    shading: ShadingScene,
    camera: Camera,
    look: Look,
    color: NDArray[np.uint8],
) -> None:
    """As ``renderers.shading.paint`` for translucent scenes with ``look.samples`` samples a pixel: drawn wholly at
    every sample position, mixed as they are shown."""
    total = np.zeros(color.shape, np.uint16)
    for each in sample_cameras(camera, look.samples):
        paint(rasterizer, scene, shading, each, look, color)
        total += color
    color[:] = (total + look.samples // 2) // look.samples
