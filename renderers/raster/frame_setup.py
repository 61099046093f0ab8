"""Setup of a frame: poses, draws and units of work, computed from the parameters that FrameJob has set."""

from typing import Final

from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import I64, Address
from renderers.raster.instance_transforms import collect_draws, compute_camera_poses
from renderers.raster.layout import CHUNK_SIZE, RasterFrame
from renderers.visibility_buffer import BAND_ROWS

MIN_VERTICES: Final = 4096
"""Minimum number of vertices of a unit of work: about 10 us, a few times what handing out a unit costs."""
UNITS_PER_THREAD: Final = 8
"""Units of work per thread and phase, so that one slow unit or late thread does not hold up the others."""
SMALL_WORK: Final = 60_000
"""Samples plus 4 x primitives below which a frame takes less time than waking another thread."""


@kernel(releases_gil=False)
def set_up_frame(frame_address: Address) -> I64:
    """Compute the last fields of a RasterFrame; return the maximum number of threads that can share the frame."""
    frame = RasterFrame(frame_address)
    compute_camera_poses(frame)
    keeps_back_faces = collect_draws(frame) > 0 and frame.keep_back_faces != 0
    threads, vertices, primitives = frame.max_threads, frame.vertex_count, frame.primitive_count
    frame.band_count, frame.chunk_count = _quotient_up(frame.height, BAND_ROWS), _quotient_up(primitives, CHUNK_SIZE)
    frame.first_back_bin = frame.band_count if keeps_back_faces else 0
    max_units = UNITS_PER_THREAD * threads if threads > 1 else 1
    frame.vertices_per_unit = max(_quotient_up(vertices, max_units), MIN_VERTICES)
    frame.chunks_per_unit = max(_quotient_up(frame.chunk_count, max_units), 1)
    units = frame.unit_counts
    units[0] = _quotient_up(vertices, frame.vertices_per_unit)
    units[1] = _quotient_up(frame.chunk_count, frame.chunks_per_unit)
    units[2] = frame.drawn_band_count
    if frame.sample_count * frame.width * frame.height + 4 * primitives < SMALL_WORK:
        return 1
    return min(threads, max(units[0], units[1], units[2], 1))


@inlined
def _quotient_up(a: I64, b: I64) -> I64:
    """Return a / b, rounded up."""
    return (a + b - 1) // b
