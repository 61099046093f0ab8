"""One rasterization: the tables that kernels read, and their phases."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from struct import Struct
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.cpu import layout as at
from renderers.cpu import work as at_work
from renderers.cpu.pools import Scratch
from renderers.cpu.poses import look_from, place
from renderers.cpu.resolve import LAYER_GAP, draw_band
from renderers.cpu.scene import PreparedScene
from renderers.cpu.setup import setup
from renderers.cpu.transform import transform
from renderers.cpu.visibility import BAND_ROWS, SampledShader, Visibility, band_count
from renderers.cpu.work import work
from renderers.native import YIELD_ADDRESS, kernel_address
from renderers.pointers import address_of, table
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

_LENS_AT: Final = at.J_COLUMNS
_TABLE: Final = at.J_COLUMNS + at.L_COLUMNS
"""Where a frame's tables begin in the array that holds them all, in values of 8 bytes."""
_JOB, _LENS, _OUTPUTS = Struct(f"{at.J_COLUMNS}q"), Struct(f"{at.L_COLUMNS}d"), Struct("4q")
_POSE: Final = Struct("16d")
_TASK: Final = Struct(f"{at_work.W_COLUMNS}q")


class FrameJob:
    """Binds a prepared scene, a camera and arrays together for the kernels; lives as long as they run."""

    def __init__(
        self,
        prepared: PreparedScene,
        camera: Camera,
        scratch: Scratch,
        *,
        select: int = 0,
        cull_back: int = 0,
        keep_backs: bool = False,
        opaque: bool = False,
        samples: int = 1,
    ) -> None:
        """
        Args:
            select, cull_back: as in ``Rasterizer.visibility``, their addresses; 0: None.
            keep_backs: culled faces are seen in the outputs, but not in what is shaded.
            opaque: only the nearest surface of every pixel is wanted, whatever it is, so that the backs of solid meshes
                need not be drawn.
            samples: 1, 4 or 8 a pixel; when there are several, they are for ``sampled_task``.
        """
        count, width, height = len(prepared.labels), camera.width, camera.height
        # All tables in one array: to ask an array for its address takes as long as to fill most of them. Most of what
        # Python does here it does with cold caches, the last frame having gone through them: a line takes microseconds.
        lengths_at = _TABLE + at.T_COLUMNS * (count + 1)
        poses_at = lengths_at + at.M_COLUMNS * count
        task_at = poses_at + 16 * count
        own, memory, address = table(task_at + at_work.W_COLUMNS)
        self._own, self._memory, self._address = own, memory, address
        self._task_at = task_at
        self._count, self._height = count, height
        self._poses_at = poses_at
        self.poses_address = meshes = address + 8 * poses_at
        """Of ``X_camera_mesh``."""
        _LENS.pack_into(memory, 8 * _LENS_AT, camera.fx, camera.fy, camera.cx, camera.cy, camera.near, camera.far)
        self.lens_address = lens = address + 8 * _LENS_AT
        """Of fx, fy, cx, cy and the clipping planes, float64."""
        memory[at.J_TABLE], memory[at.J_LENGTHS], memory[at.J_LENS] = (
            address + 8 * _TABLE,
            address + 8 * lengths_at,
            lens,
        )
        known, points, sizes, bounds = prepared.placed_at
        _POSE.pack_into(memory, 8 * task_at, *camera.X_world_camera.ravel().tolist())  # where the task will be
        if not look_from(address + 8 * task_at, points, meshes, count):
            with np.errstate(all="ignore"):  # poses that are not finite draw nothing
                self.X_camera_mesh[:] = np.matmul(camera.X_camera_world, prepared.X_world_mesh)
        apart = place(address, known, meshes, sizes, bounds if opaque else 0, select, cull_back, count)

        self._vertices, self._elements, drawn = memory[at.J_VERTICES : at.J_INSTANCES + 1].tolist()
        self._chunks = chunks = -(-self._elements // at.CHUNK)
        self._bands = bands = band_count(height)
        self.stride = stride = -(-width // LANES) * LANES
        """Values of a row of the layer."""
        self.small = samples * width * height + 4 * self._elements < SMALL_WORK
        """Not worth a second thread."""
        self._split = keep_backs and apart > 0
        lists = 2 * bands if self._split else bands

        job = [0] * at.J_COLUMNS
        job[at.J_WIDTH] = width
        job[at.J_HEIGHT] = height
        job[at.J_STRIDE] = stride
        job[at.J_BANDS] = bands
        job[at.J_LISTS] = lists
        job[at.J_CHUNKS] = chunks
        job[at.J_VERTICES] = self._vertices
        job[at.J_ELEMENTS] = self._elements
        job[at.J_INSTANCES] = drawn
        job[at.J_TABLE] = address + 8 * _TABLE
        job[at.J_LENGTHS] = address + 8 * lengths_at
        (
            job[at.J_VERTEX],
            job[at.J_RECORDS],
            job[at.J_SMALL],
            job[at.J_TALL],
            job[at.J_MICRO],
            job[at.J_RANGES],
            job[at.J_OFFSETS],
        ) = _room(scratch, self._vertices, chunks, lists)
        job[at.J_ALL_INSTANCES] = count
        job[at.J_FIRST_RECORD : at.J_ALL_MESHES + 1] = prepared.resolved_at
        job[at.J_ALL_X] = meshes
        job[at.J_SETUP] = kernel_addresses()[1]
        job[at.J_SELF] = address
        job[at.J_LENS] = lens
        _JOB.pack_into(memory, 0, *job)
        self._scratch = scratch
        self._wanted = False
        self._keep: list[object] = [prepared]
        if samples > 1:
            offsets = sample_offsets(samples)
            own[at.J_MARGIN] = np.abs(offsets).max()
            own[at.J_SAMPLES] = address_of(offsets, np.int32)
            own[at.J_LANES] = address_of(lanes_of_masks(), np.int32)
            self._keep.append(offsets)

    @property
    def X_camera_mesh(self) -> NDArray[np.float64]:
        """(I, 4, 4) float64: as in ``Visibility``."""
        poses = self._own[self._poses_at : self._task_at]
        return poses.view(np.float64).reshape(self._count, 4, 4)

    def layers(
        self, ids: NDArray[np.int32], inv_z: NDArray[np.float32], beyond: Visibility | None, before: Visibility | None
    ) -> None:
        """Say where the layer goes and which layers it lies between; all (H, W) as in ``Visibility``. When this is not
        called, the layer is not kept.

        Kernels work on whole vectors: where the width is not a multiple of eight, on padded copies.
        """
        job = self._own
        height, width = ids.shape
        if self.stride == width:
            job[at.J_IDS] = address_of(ids, np.int32)
            job[at.J_INV_Z] = address_of(inv_z, np.float32)
        else:
            count = height * self.stride
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
        if array.shape[1] != self.stride:
            array = np.pad(array, ((0, 0), (0, self.stride - array.shape[1])))
        self._keep.append(array)
        return array

    def outputs(self, frame: Frame, places: Sequence[int]) -> None:
        """Say which pictures are filled after a band is rasterized.

        Args:
            places: addresses of depth, label, instance and normal; 0: not wanted.
        """
        _OUTPUTS.pack_into(self._memory, 8 * at.J_DEPTH, *places)
        self._wanted = any(places)
        self._keep += (frame.depth, frame.label, frame.instance, frame.normal)

    def _per_unit(self, threads: int) -> tuple[int, int]:
        """Vertices and chunks of a unit of work."""
        units = UNITS_PER_THREAD * threads if threads > 1 else 1
        return max(-(-self._vertices // units), MIN_VERTICES), max(-(-self._chunks // units), 1)

    def task(self, threads: int, shade_job: int = 0) -> Task:
        """What ``threads`` threads at most may do together. Results do not depend on ``threads``.

        Args:
            shade_job: address of a painter's job: every band is shaded while it is in the cache. 0: none.
        """
        layers, values = 0, 0
        if self._memory[at.J_IDS] == 0:
            values = 2 * BAND_ROWS * self.stride + 2 * LAYER_GAP
            layers = self._scratch.take("layers", threads * values, np.int32)[1]
        _, _, drawing, shading = kernel_addresses()
        return self._shared(threads, drawing, shading if shade_job else 0, shade_job, layers, 4 * values, 0)

    def sampled_task(
        self, threads: int, draw: int, find: int, memory: NDArray[np.int64], shader: SampledShader
    ) -> Task:
        """As ``task``, of several samples a pixel.

        Args:
            draw, find: addresses of ``edges.draw_samples`` and ``edges.find_edges``.
            memory: (threads, E_COLUMNS) int64, of each thread.
        """
        self._keep += (memory, shader)
        layers, values = address_of(memory, np.int64), memory.strides[0]
        return self._shared(threads, draw, shader.kernel, shader.job, layers, values, find)

    def _shared(
        self, threads: int, draw: int, shade: int, shade_job: int, layers: int, layer_bytes: int, find: int
    ) -> Task:
        """The task, with what differs between one sample and several filled in, see ``work``."""
        vertices, chunks = self._per_unit(threads)
        transforming, setting_up, _, _ = kernel_addresses()
        units = -(-self._vertices // vertices), -(-self._chunks // chunks), self._bands
        task = [0] * at_work.W_COLUMNS
        task[: at_work.W_UNITS + at_work.PHASES] = (
            self._address,
            self.lens_address,
            transforming,
            setting_up,
            draw,
            shade,
            shade_job,
            self._vertices,
            vertices,
            self._chunks,
            chunks,
            self._height,
            4 * self.stride,
            layers,
            layer_bytes,
            self._wanted,
            self._split,
            YIELD_ADDRESS,
            find,
            self.stride,
            *units,
        )
        _TASK.pack_into(self._memory, 8 * self._task_at, *task)
        return Task(self, self._address + 8 * self._task_at, 1 if self.small else min(threads, max(units)))


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


def _room(scratch: Scratch, vertices: int, chunks: int, lists: int) -> tuple[int, ...]:
    """Addresses of J_VERTEX, J_RECORDS, J_SMALL, J_TALL, J_MICRO, J_RANGES and J_OFFSETS."""
    padded = chunks * at.CHUNK
    return scratch.room(
        (vertices, chunks, lists),
        lambda: (
            ("vertices", 4 * vertices, np.float32),
            ("records", padded * at.RECORD_BYTES // 8, np.float64),
            ("small", padded * at.SMALL_BANDS, np.uint16),
            ("tall", padded, np.uint16),
            ("micro", padded * at.MICRO_PER_ELEMENT * 4, np.int32),
            ("ranges", 4 * chunks, np.int32),
            ("offsets", chunks * (2 * lists + 4), np.int32),
        ),
    )
