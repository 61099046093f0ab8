"""One rasterization: the tables that kernels read, and their phases."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import accumulate
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.cpu import layout as at
from renderers.cpu import work as at_work
from renderers.cpu.crew import Phase
from renderers.cpu.pools import Scratch
from renderers.cpu.resolve import LAYER_GAP, draw_band
from renderers.cpu.scene import PreparedScene
from renderers.cpu.setup import setup
from renderers.cpu.transform import place, transform
from renderers.cpu.visibility import BAND_ROWS, Visibility, band_count
from renderers.cpu.work import work
from renderers.native import YIELD_ADDRESS, kernel_address
from renderers.pointers import address_of
from renderers.port import Frame
from renderers.samples import lanes_of_masks, sample_offsets
from renderers.shading.kernels import shade_rows
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
        opaque: bool = False,
        samples: int = 1,
    ) -> None:
        """
        Args:
            select, cull_back: as in ``Rasterizer.visibility``.
            keep_backs: culled faces are seen in the outputs, but not in what is shaded.
            opaque: only the nearest surface of every pixel is wanted, whatever it is, so that the backs of solid meshes
                need not be drawn.
            samples: 1, 4 or 8 a pixel; when there are several, bands are drawn by ``phases``' ``draw``.
        """
        count = len(prepared.labels)
        bands = band_count(camera.height)
        with np.errstate(all="ignore"):  # poses that are not finite draw nothing
            self.X_camera_mesh: NDArray[np.float64] = np.matmul(camera.X_camera_world, prepared.X_world_mesh)
        known, X, sizes, bounds = prepared.table, self.X_camera_mesh, prepared.sizes, prepared.bounds
        if select is not None:
            known, X, sizes, bounds = _selected(known, select), X[select], sizes[select], bounds[select]
            cull_back = None if cull_back is None else cull_back[select]
        drawn = len(X)
        # All tables in one array: to ask an array for its address takes as long as to fill most of them.
        lens_at, table_at, lengths_at, task_at, end = accumulate(
            (at.J_COLUMNS, at.L_COLUMNS, known.size, at.M_COLUMNS * drawn, at_work.W_COLUMNS)
        )
        own = np.zeros(end, dtype=np.int64)
        self._job_address = address = address_of(own, np.int64)
        self._lens_address = address + 8 * lens_at
        self._task, self._task_address = own[task_at:], address + 8 * task_at
        lens = (camera.fx, camera.fy, camera.cx, camera.cy, camera.near, camera.far)
        own[lens_at:table_at].view(np.float64)[:] = lens
        table = own[table_at:lengths_at].reshape(known.shape)
        table[:] = known
        X_address = address_of(X, np.float64)
        place(
            X_address,
            address_of(sizes, np.float64),
            address_of(cull_back, np.bool_),
            address_of(bounds, np.float64) if opaque else 0,
            self._lens_address,
            address + 8 * table_at,
            address + 8 * lengths_at,
            drawn,
        )

        self._vertices = int(table[-1, at.T_VERTEX])
        self._elements = int(table[-1, at.T_ELEMENT])
        self._chunks = -(-self._elements // at.CHUNK)
        self._bands = bands
        self.small = samples * camera.width * camera.height + 4 * self._elements < SMALL_WORK
        """Not worth a second thread."""

        padded = self._chunks * at.CHUNK
        self._split = keep_backs and bool(table[-1, at.T_CULL])
        lists = 2 * bands if self._split else bands

        job = self._job = own[:lens_at]
        job[at.J_WIDTH] = camera.width
        job[at.J_HEIGHT] = camera.height
        job[at.J_STRIDE] = self._stride = -(-camera.width // LANES) * LANES
        job[at.J_BANDS] = bands
        job[at.J_LISTS] = lists
        job[at.J_CHUNKS] = self._chunks
        job[at.J_VERTICES] = self._vertices
        job[at.J_ELEMENTS] = self._elements
        job[at.J_INSTANCES] = drawn
        job[at.J_TABLE] = address + 8 * table_at
        job[at.J_LENGTHS] = address + 8 * lengths_at
        for column, name, values, dtype in (
            (at.J_VERTEX, "vertices", 4 * self._vertices, np.float32),
            (at.J_RECORDS, "records", padded * at.RECORD_BYTES // 8, np.float64),
            (at.J_SMALL, "small", padded * at.SMALL_BANDS, np.uint16),
            (at.J_TALL, "tall", padded, np.uint16),
            (at.J_MICRO, "micro", padded * at.MICRO_PER_ELEMENT * 4, np.int32),
            (at.J_RANGES, "ranges", 4 * self._chunks, np.int32),
            (at.J_OFFSETS, "offsets", self._chunks * (2 * lists + 4), np.int32),
        ):
            job[column] = scratch.take(name, values, dtype)[1]
        job[at.J_ALL_INSTANCES] = count
        job[at.J_FIRST_RECORD : at.J_ALL_MESHES + 1] = prepared.addresses
        job[at.J_ALL_X] = X_address if select is None else address_of(self.X_camera_mesh, np.float64)
        job[at.J_SETUP] = kernel_addresses()[1]
        job[at.J_SELF] = address
        job[at.J_LENS] = self._lens_address
        self._scratch = scratch
        self._wanted = False
        self._keep: list[object] = [prepared, own]
        if samples > 1:
            offsets = sample_offsets(samples)
            job[at.J_MARGIN] = np.abs(offsets).max()
            job[at.J_SAMPLES] = address_of(offsets, np.int32)
            job[at.J_LANES] = address_of(lanes_of_masks(), np.int32)
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
            job[at.J_IDS] = self._scratch.take("ids", count, np.int32)[1]
            job[at.J_INV_Z] = self._scratch.take("inv_z", count, np.float32)[1]
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
        self._wanted = any(job[at.J_DEPTH : at.J_NORMAL + 1])
        self._keep += (frame.depth, frame.label, frame.instance, frame.normal)

    def phases(self, threads: int, draw: Callable[[int, int, int], None]) -> tuple[Phase, Phase, Phase]:
        """Transform, setup, and what else is done with the bands. Results do not depend on ``threads``.

        Args:
            draw: called for every band, with the addresses of job and lens.
        """
        job, lens = self._job_address, self._lens_address
        vertices, chunks = self._per_unit(threads)
        return (
            Phase(
                -(-self._vertices // vertices),
                lambda u: transform(job, lens, u * vertices, min((u + 1) * vertices, self._vertices)),
            ),
            Phase(
                -(-self._chunks // chunks),
                lambda u: setup(job, lens, u * chunks, min((u + 1) * chunks, self._chunks)),
            ),
            Phase(self._bands, lambda band: draw(job, lens, band)),
        )

    def _per_unit(self, threads: int) -> tuple[int, int]:
        """Vertices and chunks of a unit of work."""
        units = UNITS_PER_THREAD * threads if threads > 1 else 1
        return max(-(-self._vertices // units), MIN_VERTICES), max(-(-self._chunks // units), 1)

    def task(self, threads: int, shade_job: int = 0) -> Task:
        """What ``threads`` threads at most may do together. Results do not depend on ``threads``.

        Args:
            shade_job: address of a painter's job: every band is shaded while it is in the cache. 0: none.
        """
        job = self._job
        vertices, chunks = self._per_unit(threads)
        layers, values = 0, 0
        if job[at.J_IDS] == 0:
            values = 2 * BAND_ROWS * self._stride + 2 * LAYER_GAP
            layers = self._scratch.take("layers", threads * values, np.int32)[1]
        transforming, setting_up, drawing, shading = kernel_addresses()
        task = self._task
        task[at_work.W_THREADS :] = 0
        task[: at_work.W_UNITS + at_work.PHASES] = (
            self._job_address,
            self._lens_address,
            transforming,
            setting_up,
            drawing,
            shading if shade_job else 0,
            shade_job,
            self._vertices,
            vertices,
            self._chunks,
            chunks,
            job[at.J_HEIGHT],
            4 * self._stride,
            layers,
            4 * values,
            self._wanted,
            self._split,
            YIELD_ADDRESS,
            -(-self._vertices // vertices),
            -(-self._chunks // chunks),
            self._bands,
        )
        most = max(-(-self._vertices // vertices), -(-self._chunks // chunks), self._bands)
        return Task(self, self._task_address, 1 if self.small else min(threads, most))

    @property
    def stride(self) -> int:
        """Values of a row of the layer."""
        return self._stride


class Task:
    """A frame's work, for every thread that takes part; keeps alive what it works on."""

    def __init__(self, job: FrameJob, address: int, threads: int) -> None:
        self._job = job
        self._address = address
        self.threads = threads
        """How many may be of use."""

    def __call__(self) -> None:
        """Take part until the frame is finished."""
        work(self._address)


@cache
def kernel_addresses() -> tuple[int, int, int, int]:
    """Of transform, setup, draw_band and shade_rows."""
    return kernel_address(transform), kernel_address(setup), kernel_address(draw_band), kernel_address(shade_rows)


def _selected(table: NDArray[np.int64], select: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The table of a part of the instances; records keep their numbers."""
    counts = np.diff(table[:, [at.T_VERTEX, at.T_ELEMENT]], axis=0)[select]
    part = np.zeros((len(counts) + 1, at.T_COLUMNS), dtype=np.int64)
    part[:-1] = table[:-1][select]
    part[0, [at.T_VERTEX, at.T_ELEMENT]] = 0
    np.cumsum(counts[:, 0], out=part[1:, at.T_VERTEX])
    np.cumsum(counts[:, 1], out=part[1:, at.T_ELEMENT])
    return part
