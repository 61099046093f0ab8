"""One rasterization: the tables that kernels read, and their phases."""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import Array, addressof, c_int64
from functools import cache
from struct import Struct
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.compiler.kernel_calls import YIELD_ADDRESS, kernel_address
from renderers.compiler.pointers import address_of
from renderers.compiler.simd import LANES
from renderers.interface import Frame
from renderers.msaa import E_COLUMNS, lanes_of_masks, sample_offsets
from renderers.raster import frame_phases as at_work
from renderers.raster import frame_setup as at_begin
from renderers.raster import layout as at
from renderers.raster.buffer_pool import Scratch
from renderers.raster.frame_phases import work
from renderers.raster.frame_setup import begin
from renderers.raster.resolve import LAYER_GAP, draw_band, row_stride
from renderers.raster.scene import PreparedScene
from renderers.raster.setup import setup
from renderers.raster.transform import transform
from renderers.shading.headlight.shade_rows import shade_rows
from renderers.stop import current_stop
from renderers.visibility_buffer import BAND_ROWS, SampledShader, Visibility, band_count

_ASKED: Final = Struct(f"{at_begin.A_LENS}q{at.L_COLUMNS}dq")
"""All to A_POSED."""
_PLACED: Final = Struct("4q16d")
"""A_POSED, A_TASK, A_STOP, A_POINTS, A_POSE."""
_OUTPUTS: Final = Struct("4q")
_Words: Final = c_int64 * at_work.W_COLUMNS
_DRAWN: Final = Struct(f"{at_work.W_GEOMETRY + 1 - at_work.W_DRAW}q")


class FrameJob:
    """Binds a prepared scene, a camera and arrays together for the kernels; lives as long as they run."""

    def __init__(
        self,
        prepared: PreparedScene,
        camera: Camera,
        scratch: Scratch,
        threads: int,
        *,
        select: int = 0,
        cull_back: int = 0,
        keep_backs: bool = False,
        opaque: bool = False,
        samples: int = 1,
        kept: bool = False,
    ) -> None:
        """
        Args:
            threads: how many at most may work on it together. Results do not depend on it.
            select, cull_back: as in ``Rasterizer.visibility``, their addresses; 0: None.
            keep_backs: culled faces are seen in the outputs, but not in what is shaded.
            opaque: only the nearest surface of every pixel is wanted, whatever it is, so that the backs of solid meshes
                need not be drawn.
            samples: 1, 4 or 8 a pixel; when there are several, they are for ``sampled_task``.
            kept: ``layers`` will say where the layer goes.
        """
        width, height = camera.width, camera.height
        count, vertices, elements = prepared.cast.counts
        own, memory, address = scratch.table("frame", at_begin.FIXED + at_begin.PER_INSTANCE * count)
        self._own, self._memory, self._address, self._count = own, memory, address, count
        # Fresh memory: helpers that are late look at it when others already use the scratch.
        self._words = _Words()
        self.poses_address = address + 8 * at_begin.POSES
        """Of ``X_camera_mesh``."""
        self.stride = row_stride(width) if samples == 1 and not kept else -(-width // LANES) * LANES
        """Values of a row of the layer."""
        self._threads, self._scratch, self._wanted = threads, scratch, False
        self._keep: list[object] = [prepared]
        transforming, setting_up, _, _ = kernel_addresses()
        _ASKED.pack_into(
            memory,
            8 * at_begin.ASKED,
            width,
            height,
            samples,
            threads,
            select,
            cull_back,
            opaque,
            keep_backs,
            *prepared.cast.asked,
            *_room(scratch, vertices, -(-elements // at.CHUNK), band_count(height)),
            transforming,
            setting_up,
            YIELD_ADDRESS,
            self.stride,
            camera.fx,
            camera.fy,
            camera.cx,
            camera.cy,
            camera.near,
            camera.far,
            0,
        )
        useful = _begin(memory, address, self._words, prepared, camera)
        if useful == 0:
            with np.errstate(all="ignore"):  # poses that are not finite draw nothing
                self.X_camera_mesh[:] = np.matmul(camera.X_camera_world, prepared.X_world_mesh)
            memory[at_begin.ASKED + at_begin.A_POSED] = 1
            useful = begin(address)
        self._useful = useful
        if samples > 1:
            memory[at.J_MARGIN], memory[at.J_SAMPLES], memory[at.J_LANES], _ = _sample_tables(samples)

    @property
    def X_camera_mesh(self) -> NDArray[np.float64]:
        """(I, 4, 4) float64: as in ``Visibility``; the scratch's."""
        poses = self._own[at_begin.POSES : at_begin.POSES + 16 * self._count]
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

    def task(self, shade_job: int = 0) -> Task:
        """What threads may do together.

        Args:
            shade_job: address of a painter's job: every band is shaded while it is in the cache. 0: none.
        """
        layers, values = 0, 0
        if self._memory[at.J_IDS] == 0:
            values = 2 * BAND_ROWS * self.stride + 2 * LAYER_GAP
            layers = self._scratch.take("layers", self._threads * values, np.int32)[1]
        _, _, drawing, shading = kernel_addresses()
        return self._drawn(drawing, shading if shade_job else 0, shade_job, layers, 4 * values, 0)

    def sampled_task(self, draw: int, find: int, memory: int, shader: SampledShader) -> Task:
        """As ``task``, of several samples a pixel.

        Args:
            draw, find: addresses of ``edges.draw_samples`` and ``edges.find_edges``.
            memory: address of (threads, E_COLUMNS) int64, of each thread; lives as long as the scratch.
        """
        self._keep.append(shader)
        return self._drawn(draw, shader.kernel, shader.job, memory, 8 * E_COLUMNS, find)

    def _drawn(self, *how: int) -> Task:
        """The task, with what differs between one sample and several: W_DRAW and on."""
        _DRAWN.pack_into(self._words, 8 * at_work.W_DRAW, *how, self._wanted)
        return Task(self._words, self._useful)


def _begin(
    memory: memoryview,
    address: int,
    words: Array[c_int64],
    prepared: PreparedScene,
    camera: Camera,
) -> int:
    """``begin`` with what is different in every frame."""
    place, pose = 8 * (at_begin.ASKED + at_begin.A_POSED), camera.X_world_camera.ravel().tolist()
    stop = current_stop().address  # alive as long as the caller, who waits for the frame
    _PLACED.pack_into(memory, place, 0, addressof(words), stop, prepared.points, *pose)
    useful: int = begin(address)
    return useful


class Task:
    """A frame's work, for every thread that takes part. What it works on must live until the frame is finished; those
    who come later look at the words only."""

    def __init__(self, words: Array[c_int64], threads: int) -> None:
        """
        Args:
            words: the task, see ``work``.
            threads: how many may be of use.
        """
        self._words = words
        self._address = addressof(words)
        self.threads = threads

    def __call__(self) -> None:
        """Take part until the frame is finished."""
        work(self._address, True)

    def help(self) -> None:
        """Take part until there is nothing left to do."""
        work(self._address, False)


@cache
def _sample_tables(samples: int) -> tuple[int, int, int, object]:
    """J_MARGIN, J_SAMPLES and J_LANES, and what they point to."""
    offsets, lanes = sample_offsets(samples), lanes_of_masks()
    return int(np.abs(offsets).max()), address_of(offsets, np.int32), address_of(lanes, np.int32), (offsets, lanes)


@cache
def kernel_addresses() -> tuple[int, int, int, int]:
    """Addresses of transform, setup, draw_band and shade_rows."""
    return kernel_address(transform), kernel_address(setup), kernel_address(draw_band), kernel_address(shade_rows)


def _room(scratch: Scratch, vertices: int, chunks: int, bands: int) -> tuple[int, ...]:
    """Addresses of J_VERTEX, J_RECORDS, J_SMALL, J_TALL, J_MICRO, J_RANGES and J_OFFSETS, whoever is drawn."""
    padded = chunks * at.CHUNK
    return scratch.room(
        (vertices, chunks, bands),
        lambda: (
            ("vertices", 4 * vertices, np.float32),
            ("records", padded * at.RECORD_BYTES // 8, np.float64),
            ("small", padded * at.SMALL_BANDS, np.uint16),
            ("tall", padded, np.uint16),
            ("micro", padded * at.MICRO_PER_ELEMENT * 4, np.int32),
            ("ranges", 4 * chunks, np.int32),
            ("offsets", chunks * (4 * bands + 4), np.int32),
        ),
    )
