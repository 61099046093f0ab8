"""A frame's phases, from vertices to finished bands: one call by each thread that works on it.

    phase       unit of work                        kernel
    TRANSFORM   some vertices                       transform.transform
    SETUP       some chunks of 1,024 primitives     setup.setup
    BANDS       a band of 32 rows                   draw_kernel, shade_kernel, resolve_kernel; with several samples:
                                                    draw_kernel, edges_kernel, shade_kernel

Threads take units by an atomic counter until none is left, and wait for the last units of others before the next phase.
"""

from typing import Final

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import atomic_add_one, call_kernel, is_set, load_acquire, yield_at
from renderers.compiler.kernel_types import I64, Address, i64
from renderers.compiler.pointers import address
from renderers.raster.layout import BANDS, COLOR_FACES, KEPT_BACK_FACES, PHASE_COUNT, SETUP, TRANSFORM, RasterFrame
from renderers.visibility_buffer import BAND_ROWS

_SPINS_BEFORE_YIELD: Final = 200
"""Checks of another thread's progress before the thread yields: some microseconds."""


@kernel
def run_phases(frame_address: Address, until_finished: bool) -> None:
    """Work on a frame together with other threads. A call that comes late finds nothing left to do.

    The RasterFrame must live until all calls have returned. What it points to must live until the frame is finished.
    Each call takes the next ``band_memory_bytes`` of ``band_memory_base``, which has room for ``max_threads`` calls.

    Args:
        until_finished: return when the frame is finished; otherwise as soon as no band is left to take.
    """
    frame = RasterFrame(frame_address)
    band_memory = frame.band_memory_base
    if band_memory != 0:
        band_memory += atomic_add_one(frame.threads_started, 0) * frame.band_memory_bytes
    for phase in range(PHASE_COUNT):
        _do_units(frame, phase, band_memory)
        if phase != BANDS or until_finished:
            _wait_for_other_threads(frame, phase)


@inlined
def _do_units(frame: RasterFrame, phase: I64, band_memory: Address) -> None:
    """Do units of a phase until none is left."""
    unit = atomic_add_one(frame.units_taken, phase)
    while unit < frame.unit_counts[phase]:
        if not is_set(frame.stop):  # units of a stopped frame are only counted, so that no thread waits for them
            _run_unit(frame, phase, unit, band_memory)
        atomic_add_one(frame.units_done, phase)
        unit = atomic_add_one(frame.units_taken, phase)


@inlined
def _wait_for_other_threads(frame: RasterFrame, phase: I64) -> None:
    """Return once all units of a phase are done."""
    spins = 0
    while load_acquire(frame.units_done, phase) < frame.unit_counts[phase]:
        spins += 1
        if spins > _SPINS_BEFORE_YIELD and frame.yield_function != 0:
            yield_at(frame.yield_function)


@inlined
def _run_unit(frame: RasterFrame, phase: I64, unit: I64, band_memory: Address) -> None:
    """Do one unit of a phase."""
    if phase == TRANSFORM:
        begin = unit * frame.vertices_per_unit
        end = min(begin + frame.vertices_per_unit, frame.vertex_count)
        call_kernel(frame.transform_kernel, (address(frame), begin, end))
    elif phase == SETUP:
        begin = unit * frame.chunks_per_unit
        end = min(begin + frame.chunks_per_unit, frame.chunk_count)
        call_kernel(frame.setup_kernel, (address(frame), begin, end))
    else:
        band = i64(frame.drawn_bands[unit]) if address(frame.drawn_bands) != 0 else unit
        first_row = band * BAND_ROWS
        end_row = min(first_row + BAND_ROWS, frame.height)
        if frame.sample_count > 1:
            _draw_and_shade_samples(frame, first_row, end_row, band_memory)
        else:
            _draw_shade_resolve(frame, first_row, end_row, band_memory)


@device_function
def _draw_shade_resolve(frame: RasterFrame, first_row: I64, end_row: I64, band_memory: Address) -> None:
    """Draw, shade and resolve one band; ``band_memory``: as for ``set_band_layer``."""
    call_kernel(frame.draw_kernel, (address(frame), first_row, end_row, band_memory, COLOR_FACES))
    if frame.shade_kernel != 0:
        # Shading has a job of its own, and reads the primitive ids, with which band_memory begins: frames that shade
        # have no layer of the whole image.
        call_kernel(frame.shade_kernel, (frame.shade_job, band_memory, first_row, end_row))
    if frame.first_back_bin != 0:  # depth and labels show kept back faces; the colour, shaded before, does not
        call_kernel(frame.draw_kernel, (address(frame), first_row, end_row, band_memory, KEPT_BACK_FACES))
    if frame.resolve_kernel != 0:
        call_kernel(frame.resolve_kernel, (address(frame), first_row, end_row, band_memory))


@device_function
def _draw_and_shade_samples(frame: RasterFrame, first_row: I64, end_row: I64, band_memory: Address) -> None:
    """Draw and shade one band with several samples per pixel, whose only output is colour.

    ``band_memory`` is the address of a SampleBand.
    """
    call_kernel(frame.draw_kernel, (address(frame), first_row, end_row, band_memory))
    call_kernel(frame.edges_kernel, (address(frame), first_row, end_row, band_memory))
    call_kernel(frame.shade_kernel, (frame.shade_job, band_memory, frame.stride, first_row, end_row))
