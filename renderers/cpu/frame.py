"""One rasterization: the tables that kernels read, and their phases."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.cpu import layout as at
from renderers.cpu.crew import Phase
from renderers.cpu.pools import Scratch
from renderers.cpu.resolve import BACKS, EVERYTHING, FRONTS, LAYER_GAP, draw_band
from renderers.cpu.scene import PreparedScene
from renderers.cpu.setup import setup
from renderers.cpu.transform import transform
from renderers.cpu.visibility import BAND_ROWS, Visibility, band_count
from renderers.pointers import address_of
from renderers.port import Frame
from renderers.samples import sample_offsets
from renderers.simd import LANES

MIN_VERTICES: Final = 4096
"""Fewest vertices of a unit of work: about 10 us, a few times what handing out a unit costs."""
UNITS_PER_THREAD: Final = 8
"""Units of work per thread and phase, so that one slow unit or late thread does not leave the others waiting."""
SMALL_WORK: Final = 60_000
"""Pixels plus 4 x elements below which a frame takes less time than waking another thread."""


class FrameJob:
    """Binds a prepared scene, a camera and arrays together for the kernels; lives as long as they run."""

    def __init__(
        self,
        prepared: PreparedScene,
        camera: Camera,
        scratch: Scratch,
        *,
        select: NDArray[np.bool_] | None = None,
        cull_back: NDArray[np.bool_] | None = None,
        keep_backs: bool = False,
        samples: int = 1,
    ) -> None:
        """
        Args:
            select, cull_back: as in ``Rasterizer.visibility``.
            keep_backs: culled faces are seen in the outputs, but not in what is shaded.
            samples: 1, 4 or 8 a pixel; when there are several, bands are drawn by ``phases``' ``draw``.
        """
        count = len(prepared.labels)
        bands = band_count(camera.height)
        with np.errstate(all="ignore"):  # poses that are not finite draw nothing
            self.X_camera_mesh: NDArray[np.float64] = np.matmul(camera.X_camera_world, prepared.X_world_mesh)
        table, X, sizes = prepared.table, self.X_camera_mesh, prepared.sizes
        if select is not None:
            table, X, sizes = _selected(table, select), X[select], sizes[select]
        drawn = len(X)
        if cull_back is not None:
            table = table.copy()
            table[:-1, at.T_CULL] = np.where(cull_back if select is None else cull_back[select], _front(X), 0)
        lengths = np.empty((drawn, at.M_COLUMNS))
        lengths[:, : at.M_SIZE] = X.reshape(drawn, 16)[:, :12]
        lengths[:, at.M_SIZE] = sizes

        self._vertices = int(table[-1, at.T_VERTEX])
        self._elements = int(table[-1, at.T_ELEMENT])
        self._chunks = -(-self._elements // at.CHUNK)
        self._bands = bands
        self.small = samples * camera.width * camera.height + 4 * self._elements < SMALL_WORK
        """Not worth a second thread."""

        padded = self._chunks * at.CHUNK
        vertices = scratch.take("vertices", 4 * self._vertices, np.float32)
        records = scratch.take("records", padded * at.RECORD_BYTES // 8, np.float64)
        small = scratch.take("small", padded * at.SMALL_BANDS, np.uint16)
        tall = scratch.take("tall", padded, np.uint16)
        micro = scratch.take("micro", padded * at.MICRO_PER_ELEMENT * 3, np.int32)
        self._split = keep_backs and cull_back is not None
        lists = 2 * bands if self._split else bands
        offsets = scratch.take("offsets", self._chunks * (2 * lists + 4), np.int32)

        job = self._job = np.zeros(at.J_COLUMNS, dtype=np.int64)
        job[at.J_WIDTH] = camera.width
        job[at.J_HEIGHT] = camera.height
        job[at.J_STRIDE] = self._stride = -(-camera.width // LANES) * LANES
        job[at.J_BANDS] = bands
        job[at.J_LISTS] = lists
        job[at.J_CHUNKS] = self._chunks
        job[at.J_VERTICES] = self._vertices
        job[at.J_ELEMENTS] = self._elements
        job[at.J_INSTANCES] = drawn
        job[at.J_TABLE] = address_of(table, np.int64)
        job[at.J_LENGTHS] = address_of(lengths, np.float64)
        job[at.J_VERTEX] = address_of(vertices, np.float32)
        job[at.J_RECORDS] = address_of(records, np.float64)
        job[at.J_SMALL] = address_of(small, np.uint16)
        job[at.J_TALL] = address_of(tall, np.uint16)
        job[at.J_MICRO] = address_of(micro, np.int32)
        job[at.J_OFFSETS] = address_of(offsets, np.int32)
        job[at.J_ALL_INSTANCES] = count
        job[at.J_FIRST_RECORD] = address_of(prepared.first_record, np.int64)
        job[at.J_ALL_LABELS] = address_of(prepared.labels, np.uint32)
        job[at.J_ALL_IDS] = address_of(prepared.instance_ids, np.int32)
        job[at.J_ALL_MESHES] = address_of(prepared.attributes, np.int64)
        job[at.J_ALL_X] = address_of(self.X_camera_mesh, np.float64)
        self._lens = np.array((camera.fx, camera.fy, camera.cx, camera.cy, camera.near, camera.far), dtype=np.float64)
        self._scratch = scratch
        self._keep: list[object] = [prepared, table, lengths]
        if samples > 1:
            offsets = sample_offsets(samples)
            job[at.J_MARGIN] = np.abs(offsets).max()
            job[at.J_SAMPLES] = address_of(offsets, np.int32)
            self._keep.append(offsets)

    def layers(
        self, ids: NDArray[np.int32], inv_z: NDArray[np.float32], beyond: Visibility | None, before: Visibility | None
    ) -> None:
        """Say where the layer goes and which layers it lies between; all (H, W) as in ``Visibility``. When this is not
        called, the layer is not kept.

        Kernels work on whole vectors: where the width is not a multiple of eight, on padded copies.
        """
        job = self._job
        height, width = ids.shape
        if self._stride == width:
            job[at.J_IDS] = address_of(ids, np.int32)
            job[at.J_INV_Z] = address_of(inv_z, np.float32)
        else:
            count = height * self._stride
            job[at.J_IDS] = address_of(self._scratch.take("ids", count, np.int32), np.int32)
            job[at.J_INV_Z] = address_of(self._scratch.take("inv_z", count, np.float32), np.float32)
            job[at.J_PLAIN_IDS] = address_of(ids, np.int32)
            job[at.J_PLAIN_INV_Z] = address_of(inv_z, np.float32)
        if beyond is not None:
            job[at.J_BEYOND_IDS] = address_of(self._padded(beyond.ids), np.int32)
            job[at.J_BEYOND_INV_Z] = address_of(self._padded(beyond.inv_z), np.float32)
        if before is not None:
            job[at.J_BEFORE_IDS] = address_of(self._padded(before.ids), np.int32)
            job[at.J_BEFORE_INV_Z] = address_of(self._padded(before.inv_z), np.float32)
        self._keep += (ids, inv_z)

    def _padded(self, array: NDArray[Any]) -> NDArray[Any]:
        """The array, or a copy whose rows are whole vectors; kept as long as the job."""
        if array.shape[1] != self._stride:
            array = np.pad(array, ((0, 0), (0, self._stride - array.shape[1])))
        self._keep.append(array)
        return array

    def outputs(self, frame: Frame) -> None:
        """Say which pictures are filled after a band is rasterized."""
        job = self._job
        job[at.J_DEPTH] = address_of(frame.depth, np.float32)
        job[at.J_LABEL] = address_of(frame.label, np.uint32)
        job[at.J_INSTANCE] = address_of(frame.instance, np.int32)
        job[at.J_NORMAL] = address_of(frame.normal, np.float32)
        self._keep += (frame.depth, frame.label, frame.instance, frame.normal)

    def phases(
        self,
        threads: int,
        shade: Callable[[int, int], None] | None = None,
        draw: Callable[[int, int, int], None] | None = None,
    ) -> tuple[Phase, Phase, Phase]:
        """Transform, setup, and raster with resolve. Results do not depend on ``threads``.

        Args:
            shade: called for every band, with the address that the records of the picture's first row would have; rows
                are ``stride`` values apart.
            draw: called for every band in place of raster and resolve, with the addresses of job and lens.
        """
        job, lens = address_of(self._job, np.int64), address_of(self._lens, np.float64)
        units = UNITS_PER_THREAD * threads if threads > 1 else 1
        vertices = max(-(-self._vertices // units), MIN_VERTICES)
        chunks = max(-(-self._chunks // units), 1)
        return (
            Phase(
                -(-self._vertices // vertices),
                lambda u: transform(job, lens, u * vertices, min((u + 1) * vertices, self._vertices)),
            ),
            Phase(
                -(-self._chunks // chunks),
                lambda u: setup(job, lens, u * chunks, min((u + 1) * chunks, self._chunks)),
            ),
            Phase(
                self._bands,
                self._bander(job, lens, threads, shade) if draw is None else lambda band: draw(job, lens, band),
            ),
        )

    def _bander(
        self, job: int, lens: int, threads: int, shade: Callable[[int, int], None] | None
    ) -> Callable[[int], object]:
        """What is done with a band."""
        if self._job[at.J_IDS] != 0:
            return lambda band: draw_band(job, lens, band, 0, EVERYTHING)
        values = 2 * BAND_ROWS * self._stride + 2 * LAYER_GAP
        layers = address_of(self._scratch.take("layers", threads * values, np.int32), np.int32)
        free = deque(layers + 4 * values * k for k in range(threads))
        geometry = any(self._job[k] != 0 for k in (at.J_DEPTH, at.J_LABEL, at.J_INSTANCE, at.J_NORMAL))

        def work(band: int) -> None:
            layer = free.pop()  # never empty: as many threads as layers
            if shade is None:
                draw_band(job, lens, band, layer, EVERYTHING)
            else:
                draw_band(job, lens, band, layer, FRONTS if self._split or not geometry else EVERYTHING)
                shade(band, layer - 4 * band * BAND_ROWS * self._stride)
                if self._split:
                    draw_band(job, lens, band, layer, BACKS)
            free.append(layer)

        return work

    @property
    def stride(self) -> int:
        """Values of a row of the layer."""
        return self._stride


def _selected(table: NDArray[np.int64], select: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The table of a part of the instances; records keep their numbers."""
    counts = np.diff(table[:, [at.T_VERTEX, at.T_ELEMENT]], axis=0)[select]
    part = np.zeros((len(counts) + 1, at.T_COLUMNS), dtype=np.int64)
    part[:-1] = table[:-1][select]
    part[0, [at.T_VERTEX, at.T_ELEMENT]] = 0
    np.cumsum(counts[:, 0], out=part[1:, at.T_VERTEX])
    np.cumsum(counts[:, 1], out=part[1:, at.T_ELEMENT])
    return part


def _front(X: NDArray[np.float64]) -> NDArray[np.int64]:
    """(n,) +1 or -1: the sign of the screen area (y down) of triangles that face away.

    In the optical frame a triangle that faces the camera runs counter-clockwise for the viewer, which is a negative
    area with y down; a mirrored transform turns that round.
    """
    a, b, c = X[:, 0], X[:, 1], X[:, 2]
    with np.errstate(all="ignore"):
        determinant = (
            a[:, 0] * (b[:, 1] * c[:, 2] - b[:, 2] * c[:, 1])
            + a[:, 1] * (b[:, 2] * c[:, 0] - b[:, 0] * c[:, 2])
            + a[:, 2] * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
        )
    return np.where(determinant < 0.0, -1, 1)
