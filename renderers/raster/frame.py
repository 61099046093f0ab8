"""One rasterization: fills a RasterFrame for the kernels, and makes the task that threads share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.compiler.kernel_calls import YIELD_ADDRESS, kernel_address
from renderers.compiler.pointers import address_of, aligned_parts
from renderers.compiler.simd import LANES
from renderers.msaa import SampleBand, lanes_of_mask, sample_offsets
from renderers.raster.coverage import draw_band
from renderers.raster.frame_phases import run_phases
from renderers.raster.frame_setup import set_up_frame
from renderers.raster.layout import CHUNK_SIZE, CHUNK_WORDS, FRAGMENT_CAPACITY, Chunk, Draw, Primitive, RasterFrame
from renderers.raster.msaa.edges import draw_samples, find_edges
from renderers.raster.resolve import resolve_band
from renderers.raster.resolve_normals import resolve_normals
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
        outputs: Sequence[int] = (0, 0, 0, 0),
        has_layer: bool = False,
        bands: NDArray[np.int32] | None = None,
    ) -> None:
        """
        Args:
            threads: maximum number of threads that work on it together. Results do not depend on it.
            select, cull_back: addresses of arrays as in ``Rasterizer.visibility``; 0: None.
            keep_back_faces: culled faces appear in the outputs, but not in what is shaded.
            opaque: only the nearest surface of every pixel is wanted, so that hidden back faces need not be drawn.
            samples: 1, 4 or 8 per pixel; several are for ``sampled_task``.
            outputs: addresses of depth, label, instance and normal, written after a band is rasterized; 0: not wanted.
                The images must outlive the job's tasks.
            has_layer: ``layers`` will set a layer of the whole image. Without it, each thread has one of a band.
            bands: bands of the image to draw; None: all.
        """
        count, vertices, primitives = prepared.instances.counts
        self.stride = -(-camera.width // LANES) * LANES
        """Pixels from one row of the layer to the next."""
        band_bytes = 0 if has_layer or samples > 1 else 8 * BAND_ROWS * self.stride
        sizes = _work_sizes(count, vertices, primitives)
        if band_bytes:
            sizes["band_memory_base"] = threads * band_bytes
        work_memory, work_addresses = aligned_parts(sizes)
        self.poses_address = work_addresses["X_camera_mesh"]
        """Address of ``X_camera_mesh``."""
        chunks, chunk_memory = (
            work_memory[work_addresses[name] - address_of(work_memory, np.uint8) :][: sizes[name]]
            for name in ("chunks", "chunk_memory")
        )
        self._chunks, self._chunk_memory = chunks.view(Chunk.dtype), chunk_memory.view(np.int32)
        self.X_camera_mesh: NDArray[np.float64] = work_memory[: 128 * count].view(np.float64).reshape(-1, 4, 4)
        """(I, 4, 4) float64 as in ``Visibility``."""
        # The task and what its kernels read must outlive them.
        self._keep: list[object] = [prepared, work_memory, bands]
        # Not in ``work_memory``: late helper threads read it after the job is gone.
        memory = np.zeros(RasterFrame.nbytes // 8, np.int64)
        self._frame, self._frame_address = memory.view(RasterFrame.dtype), address_of(memory, np.int64)
        depth, label, instance, normal = outputs
        self._band_count = band_count(camera.height)
        self._frame[0] = RasterFrame.record(
            stride=self.stride,
            sample_count=samples,
            max_threads=threads,
            is_selected=select,
            cull_back=cull_back,
            skip_hidden_back_faces=opaque,
            keep_back_faces=keep_back_faces,
            width=camera.width,
            height=camera.height,
            drawn_bands=address_of(bands, np.int32),
            drawn_band_count=self._band_count if bands is None else len(bands),
            fx=camera.fx,
            fy=camera.fy,
            cx=camera.cx,
            cy=camera.cy,
            near=camera.near,
            inv_z_far=1.0 / camera.far,
            X_world_camera=camera.X_world_camera.ravel(),
            X_world_mesh=prepared.X_world_mesh_at,
            instance_count=count,
            depth_out=depth,
            label_out=label,
            instance_out=instance,
            normal_out=normal,
            band_memory_bytes=band_bytes,
            stop=current_stop().address,
            transform_kernel=kernel_address(transform),
            setup_kernel=kernel_address(setup),
            draw_kernel=kernel_address(draw_band) if samples == 1 else 0,
            resolve_kernel=kernel_address(resolve_band) if any(outputs) else 0,
            normals_kernel=kernel_address(resolve_normals) if normal else 0,
            yield_function=YIELD_ADDRESS,
            **prepared.instances.tables,
            **work_addresses,
            **(_sample_fields(samples)[0] if samples > 1 else {}),
        )
        self._useful_threads: int = set_up_frame(self._frame_address)

    def layers(
        self,
        layer: Visibility,
        behind: Visibility | None = None,
        in_front_of: Visibility | None = None,
        id_limits: NDArray[np.int32] | None = None,
        *,
        latest: bool = False,
    ) -> None:
        """Set the layer, and those that bound it as in ``Rasterizer.visibility``. Their rows have ``stride`` pixels."""
        frame = self._frame
        for name, each in (("layer", layer), ("near_bound", behind), ("far_bound", in_front_of)):
            if each is not None:
                frame[f"{name}_ids"] = self._address(each.ids, np.int32)
                frame[f"{name}_inv_z"] = self._address(each.inv_z, np.float32)
        if id_limits is not None:
            frame["id_limits"] = self._address(id_limits, np.int32)
        frame["highest_id_wins"] = latest

    def _address(self, array: NDArray[Any], dtype: type[np.generic]) -> int:
        """Return the address of an array (H, W), or of a copy whose rows are whole vectors; kept as long as the job."""
        if array.shape[1] != self.stride:
            array = np.pad(array, ((0, 0), (0, self.stride - array.shape[1])))
        self._keep.append(array)
        return address_of(array, dtype)

    def resolver(self, visible: Visibility) -> Callable[[int], None]:
        """Return a function that writes the outputs of a band, by its index, from a finished layer."""
        self.layers(visible)
        height = len(visible.ids)

        def resolve(band: int) -> None:
            first_row = band * BAND_ROWS
            resolve_band(self._frame_address, first_row, min(first_row + BAND_ROWS, height), 0)

        return resolve

    def task(self, shade_job: int = 0) -> Task:
        """Return the work for threads to share.

        Args:
            shade_job: address of HeadlightInputs: every band is shaded while it is in the cache; 0: none.
        """
        frame = self._frame
        if shade_job:
            frame["shade_kernel"], frame["shade_job"] = kernel_address(shade_rows), shade_job
        return Task(frame, self._frame_address, self._useful_threads)

    def touched_bands(self) -> NDArray[np.int32]:
        """Return the bands that primitives touch, after a task with any ``bands``."""
        chunks = self._chunks[: int(self._frame["chunk_count"][0])]
        memory = self._chunk_memory[: len(chunks) * CHUNK_WORDS].reshape(-1, CHUNK_WORDS)
        bins = memory[:, :CHUNK_SIZE][np.arange(CHUNK_SIZE) < chunks["primitive_count"][:, None]]
        pixels = memory[:, CHUNK_SIZE : CHUNK_SIZE + FRAGMENT_CAPACITY]
        pixel_bands = pixels[np.arange(FRAGMENT_CAPACITY) < chunks["fragment_count"][:, None]] // (
            BAND_ROWS * self.stride
        )
        first, last = np.append(bins & 0xFFFF, pixel_bands), np.append(bins >> 16, pixel_bands)
        begun, ended = (np.bincount(each, minlength=self._band_count + 1) for each in (first, last + 1))
        return np.flatnonzero(np.cumsum(begun - ended)).astype(np.int32)

    def sampled_task(self, bands: int, memory: object, shader: SampledShader) -> Task:
        """``task`` for several samples per pixel; ``bands``: address of a SampleBand for each thread, in ``memory``."""
        self._keep += [memory, shader]
        frame = self._frame
        frame["draw_kernel"], frame["edges_kernel"] = kernel_address(draw_samples), kernel_address(find_edges)
        frame["shade_kernel"], frame["shade_job"] = shader.kernel, shader.job
        frame["band_memory_base"], frame["band_memory_bytes"] = bands, SampleBand.nbytes
        return Task(frame, self._frame_address, self._useful_threads)


def _work_sizes(instances: int, vertices: int, primitives: int) -> dict[str, int]:
    """Return the bytes of the frame's arrays, by field of RasterFrame."""
    chunks = -(-primitives // CHUNK_SIZE)
    return {
        "X_camera_mesh": 128 * instances,
        "draws": (instances + 1) * Draw.nbytes,
        "vertices": 16 * vertices,
        "primitives": chunks * CHUNK_SIZE * Primitive.nbytes,
        "chunks": chunks * Chunk.nbytes,
        "chunk_memory": 4 * chunks * CHUNK_WORDS,
    }


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """A frame's work, for every thread that takes part.

    What it works on must live until the frame is finished. Threads that come later read the RasterFrame only.
    """

    frame: NDArray[np.void]
    """(1,) RasterFrame."""
    address: int
    """Address of ``frame``."""
    threads: int
    """Maximum number of threads that can share the work."""

    def __call__(self) -> None:
        """Take part until the frame is finished."""
        run_phases(self.address, True)

    def help(self) -> None:
        """Take part until no unit of work is left to take."""
        run_phases(self.address, False)


@cache
def _sample_fields(samples: int) -> tuple[dict[str, int], object]:
    """Return the fields of RasterFrame for several samples per pixel, and the arrays that they point to."""
    offsets, lanes = sample_offsets(samples), lanes_of_mask()
    fields = {
        "sample_reach": int(np.abs(offsets).max()),
        "sample_offsets": address_of(offsets, np.int32),
        "lanes_of_mask": address_of(lanes, np.int32),
    }
    return fields, (offsets, lanes)
