"""One rasterization: fills a FRAME and its TASK for the kernels, and makes the task that threads share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.compiler.kernel_calls import YIELD_ADDRESS, kernel_address
from renderers.compiler.pointers import address_of
from renderers.compiler.simd import LANES
from renderers.interface import Frame
from renderers.msaa import SAMPLE_BAND, lane_lists, sample_offsets
from renderers.raster.buffers import Buffers
from renderers.raster.frame_phases import run_phases
from renderers.raster.frame_setup import set_up_frame
from renderers.raster.layout import CHUNK, CHUNK_SIZE, CHUNK_VALUES, DRAW, FRAME, PRIMITIVE, TASK
from renderers.raster.resolve import draw_band, resolve_layer, resolve_normals
from renderers.raster.scene import PreparedScene
from renderers.raster.setup import setup
from renderers.raster.transform import transform
from renderers.shading.headlight.shade_rows import shade_rows
from renderers.stop import current_stop
from renderers.visibility_buffer import BAND_ROWS, SampledShader, Visibility, band_count


class FrameJob:
    """A prepared scene, a camera and output arrays, bound together for the kernels. Must outlive their calls."""

    def __init__(
        self,
        prepared: PreparedScene,
        camera: Camera,
        threads: int,
        *,
        select: int = 0,
        cull_back: int = 0,
        keep_back_faces: bool = False,
        opaque: bool = False,
        samples: int = 1,
    ) -> None:
        """
        Args:
            threads: maximum number of threads that work on it together. Results do not depend on it.
            select, cull_back: addresses of arrays as in ``Rasterizer.visibility``; 0: None.
            keep_back_faces: culled faces appear in the outputs, but not in what is shaded.
            opaque: only the nearest surface of every pixel is wanted, so that hidden back faces need not be drawn.
            samples: 1, 4 or 8 per pixel; several are for ``sampled_task``.
        """
        width, height = camera.width, camera.height
        instances = prepared.instances
        count, vertices, primitives = instances.counts
        self.stride = -(-width // LANES) * LANES
        """Pixels from one row of the layer to the next."""
        self.threads = threads
        self.buffers = Buffers()
        """Memory that lives as long as the job."""
        allocate = self.buffers.allocate
        # The task and what its kernels read must outlive them.
        self._keep: list[object] = [prepared, camera]
        poses, self.poses_address = allocate(16 * count, np.float64)
        """Address of ``X_camera_mesh``."""
        self.X_camera_mesh: NDArray[np.float64] = poses.reshape(-1, 4, 4)
        """(I, 4, 4) float64 as in ``Visibility``."""
        self._task, self._task_address = self._new_task(height)
        frame, self._frame_address = allocate(FRAME.size // 8, np.int64)
        self._frame = frame.view(FRAME.dtype)
        reach, offsets, lanes = _sample_tables(samples)[:3] if samples > 1 else (0, 0, 0)
        values: dict[str, Any] = {
            "width": width,
            "height": height,
            "stride": self.stride,
            "samples": samples,
            "max_threads": threads,
            "fx": camera.fx,
            "fy": camera.fy,
            "cx": camera.cx,
            "cy": camera.cy,
            "near": camera.near,
            "far": camera.far,
            "instance_count": count,
            "instances": instances.instances_at,
            "first_ids": instances.first_ids_at,
            "labels": instances.labels_at,
            "instance_ids": instances.instance_ids_at,
            "select": select,
            "cull_back": cull_back,
            "skip_hidden_back_faces": opaque,
            "keep_back_faces": keep_back_faces,
            "X_world_mesh": prepared.X_world_mesh_at,
            "X_world_camera": camera.X_world_camera.ravel(),
            "X_camera_mesh": self.poses_address,
            "task": self._task_address,
            "stop": current_stop().address,
            "draws": allocate((count + 1) * DRAW.size // 8, np.int64)[1],
            "sample_reach": reach,
            "sample_offsets": offsets,
            "lane_lists": lanes,
            **_work_buffers(self.buffers, vertices, -(-primitives // CHUNK_SIZE)),
        }
        self._frame[0] = FRAME.record(**values)
        self._task["frame"] = self._frame_address
        useful_threads: int = set_up_frame(self._frame_address)
        if useful_threads == 0:
            with np.errstate(all="ignore"):  # poses that are not finite draw nothing
                self.X_camera_mesh[:] = np.matmul(camera.X_camera_world, prepared.X_world_mesh)
            self._frame["poses_ready"] = 1
            useful_threads = set_up_frame(self._frame_address)
        self._useful_threads = useful_threads

    def _new_task(self, height: int) -> tuple[NDArray[np.void], int]:
        """Return a TASK and its address, in fresh memory: late helper threads read it after the job is gone."""
        memory = np.zeros(TASK.size // 8, np.int64)
        task = memory.view(TASK.dtype)
        task["height"], task["stride"] = height, self.stride
        task["stop"], task["yield_function"] = current_stop().address, YIELD_ADDRESS
        task["transform_kernel"], task["setup_kernel"] = kernel_addresses()[:2]
        return task, address_of(memory, np.int64)

    def layers(
        self,
        ids: NDArray[np.int32],
        inv_z: NDArray[np.float32],
        beyond: Visibility | None,
        before: Visibility | None,
        earlier: NDArray[np.int32] | None,
        *,
        latest: bool,
    ) -> None:
        """Set the arrays that get the layer, and the layers that bound it; all (H, W) as in ``Visibility``.

        Kernels work on whole vectors: where the width is not a multiple of eight, on padded copies.
        """
        frame = self._frame
        height, width = ids.shape
        if self.stride == width:
            frame["layer_ids"] = address_of(ids, np.int32)
            frame["layer_inv_z"] = address_of(inv_z, np.float32)
        else:
            count = height * self.stride
            frame["layer_ids"] = self.buffers.allocate(count, np.int32)[1]
            frame["layer_inv_z"] = self.buffers.allocate(count, np.float32)[1]
            frame["unpadded_ids"] = address_of(ids, np.int32)
            frame["unpadded_inv_z"] = address_of(inv_z, np.float32)
        if beyond is not None:
            frame["beyond_ids"] = address_of(self._padded(beyond.ids), np.int32)
            frame["beyond_inv_z"] = address_of(self._padded(beyond.inv_z), np.float32)
        if before is not None:
            frame["before_ids"] = address_of(self._padded(before.ids), np.int32)
            frame["before_inv_z"] = address_of(self._padded(before.inv_z), np.float32)
        if earlier is not None:
            frame["earlier_ids"] = address_of(self._padded(earlier), np.int32)
        frame["takes_latest"] = latest
        self._keep += (ids, inv_z)

    def _padded(self, array: NDArray[Any]) -> NDArray[Any]:
        """Return the array, or a copy whose rows are whole vectors; kept as long as the job."""
        if array.shape[1] != self.stride:
            array = np.pad(array, ((0, 0), (0, self.stride - array.shape[1])))
        self._keep.append(array)
        return array

    def outputs(self, images: Frame, addresses: Sequence[int]) -> None:
        """Set the outputs that are written after a band is rasterized.

        Args:
            images: must outlive the job's tasks.
            addresses: of depth, label, instance and normal; 0: not wanted.
        """
        frame = self._frame
        frame["depth"], frame["label"], frame["instance"], frame["normal"] = addresses
        if addresses[3]:
            frame["normals_kernel"] = _normals_address()
        self._task["has_outputs"] = any(addresses)
        self._keep.append(images)

    def resolver(self, visible: Visibility) -> Callable[[int], None]:
        """Return a function that writes the outputs of a band, by its index, from a finished layer."""
        ids = address_of(self._padded(visible.ids), np.int32)
        inv_z = address_of(self._padded(visible.inv_z), np.float32)
        height = len(visible.ids)

        def resolve(band: int) -> None:
            first_row = band * BAND_ROWS
            resolve_layer(self._frame_address, ids, inv_z, first_row, min(first_row + BAND_ROWS, height))

        return resolve

    def task(self, shade_job: int = 0) -> Task:
        """Return the work for threads to share.

        Args:
            shade_job: address of a HEADLIGHT_JOB: every band is shaded while it is in the cache; 0: none.
        """
        memory, values = 0, 0
        if self._frame["layer_ids"][0] == 0:
            values = 2 * BAND_ROWS * self.stride
            memory = self.buffers.allocate(self.threads * values, np.int32)[1]
        _, _, draw_kernel, shade_kernel = kernel_addresses()
        task = self._task
        task["draw_kernel"] = draw_kernel
        task["shade_kernel"], task["shade_job"] = shade_kernel if shade_job else 0, shade_job
        task["band_memory"], task["band_memory_bytes"] = memory, 4 * values
        return Task(task, self._task_address, self._useful_threads)

    def sampled_task(self, draw_kernel: int, edges_kernel: int, memory: int, shader: SampledShader) -> Task:
        """``task`` for several samples per pixel.

        Args:
            draw_kernel, edges_kernel: addresses of ``edges.draw_samples`` and ``edges.find_edges``.
            memory: address of a SAMPLE_BAND for each thread; lives as long as the job.
        """
        self._keep.append(shader)
        task = self._task
        task["draw_kernel"], task["edges_kernel"] = draw_kernel, edges_kernel
        task["shade_kernel"], task["shade_job"] = shader.kernel, shader.job
        task["band_memory"], task["band_memory_bytes"] = memory, SAMPLE_BAND.size
        return Task(task, self._task_address, self._useful_threads)


class Task:
    """A frame's work, for every thread that takes part.

    What it works on must live until the frame is finished. Threads that come later read the TASK only.
    """

    def __init__(self, task: NDArray[np.void], address: int, threads: int) -> None:
        """
        Args:
            task: a TASK, at ``address``.
            threads: maximum number of threads that can share the work.
        """
        self._task = task
        self._address = address
        self.threads = threads

    def __call__(self) -> None:
        """Take part until the frame is finished."""
        run_phases(self._address, True)

    def help(self) -> None:
        """Take part until no unit of work is left to take."""
        run_phases(self._address, False)


@cache
def _sample_tables(samples: int) -> tuple[int, int, int, object]:
    """Return FRAME's ``sample_reach``, ``sample_offsets`` and ``lane_lists``, and the arrays they point to."""
    offsets, lanes = sample_offsets(samples), lane_lists()
    return int(np.abs(offsets).max()), address_of(offsets, np.int32), address_of(lanes, np.int32), (offsets, lanes)


@cache
def kernel_addresses() -> tuple[int, int, int, int]:
    """Return the addresses of transform, setup, draw_band and shade_rows."""
    return kernel_address(transform), kernel_address(setup), kernel_address(draw_band), kernel_address(shade_rows)


@cache
def _normals_address() -> int:
    return kernel_address(resolve_normals)


def _work_buffers(buffers: Buffers, vertices: int, chunks: int) -> dict[str, int]:
    """Return the addresses of the memory that FRAME's kernels fill, by field."""
    sizes: tuple[tuple[str, int, type[np.generic]], ...] = (
        ("vertices", 4 * vertices, np.float32),
        ("primitives", chunks * CHUNK_SIZE * PRIMITIVE.size // 8, np.float64),
        ("chunks", chunks * CHUNK.size // 8, np.int64),
        ("chunk_memory", chunks * CHUNK_VALUES, np.int32),
    )
    return {name: buffers.allocate(count, dtype)[1] for name, count, dtype in sizes}
