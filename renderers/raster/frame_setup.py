"""Setup of a frame: poses, draws and units of work, computed from the parameters that FrameJob has set."""

from __future__ import annotations

from typing import Final

from renderers.compiler.jit import kernel
from renderers.raster.instance_transforms import collect_draws, compute_camera_poses
from renderers.raster.layout import CHUNK_SIZE, frame_at, task_at
from renderers.visibility_buffer import BAND_ROWS

MIN_VERTICES: Final = 4096
"""Minimum number of vertices of a unit of work: about 10 us, a few times what handing out a unit costs."""
UNITS_PER_THREAD: Final = 8
"""Units of work per thread and phase, so that one slow unit or late thread does not hold up the others."""
SMALL_WORK: Final = 60_000
"""Samples plus 4 x primitives below which a frame takes less time than waking another thread."""


@kernel("int64(int64)", releases_gil=False)
def set_up_frame(frame_address):
    """Compute the last fields of a FRAME and of its TASK.

    Returns:
        Maximum number of threads that can share the frame; 0 if the camera's pose is not affine or has no inverse. Then
        the caller has to fill ``X_camera_mesh`` and set ``poses_ready``, and call again.
    """
    frame = frame_at(frame_address)
    task = task_at(frame.task)
    if frame.poses_ready == 0 and not compute_camera_poses(frame):
        return 0
    culling_draws = collect_draws(frame)
    keeps_back_faces = frame.keep_back_faces != 0 and culling_draws > 0
    bands = (frame.height + BAND_ROWS - 1) // BAND_ROWS
    chunks = (frame.primitive_count + CHUNK_SIZE - 1) // CHUNK_SIZE
    frame.band_count, frame.chunk_count, frame.first_back_bin = bands, chunks, bands if keeps_back_faces else 0

    threads, vertices = frame.max_threads, frame.vertex_count
    max_units = UNITS_PER_THREAD * threads if threads > 1 else 1
    vertices_per_unit = max((vertices + max_units - 1) // max_units, MIN_VERTICES)
    chunks_per_unit = max((chunks + max_units - 1) // max_units, 1)
    transform_units = (vertices + vertices_per_unit - 1) // vertices_per_unit
    setup_units = (chunks + chunks_per_unit - 1) // chunks_per_unit
    task.vertex_count, task.vertices_per_unit = vertices, vertices_per_unit
    task.chunk_count, task.chunks_per_unit = chunks, chunks_per_unit
    task.keeps_back_faces = keeps_back_faces
    task.units[0], task.units[1], task.units[2] = transform_units, setup_units, bands
    if frame.samples * frame.width * frame.height + 4 * frame.primitive_count < SMALL_WORK:
        return 1
    return min(threads, max(transform_units, setup_units, bands))
