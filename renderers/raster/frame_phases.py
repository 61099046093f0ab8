"""A frame's phases, from vertices to finished bands: one call by each thread that works on it."""

from __future__ import annotations

from typing import Final

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import atomic_add_one, call_kernel, is_set, load_acquire, yield_at
from renderers.raster.layout import PHASES, task_at
from renderers.raster.resolve import ALL_FACES, BACK_FACES, FRONT_FACES
from renderers.visibility_buffer import BAND_ROWS

HALVED_BANDS: Final = 2
"""Bands at the end of an image that are two units of work each, with one sample per pixel."""
HALVED_SAMPLE_BANDS: Final = 1
"""The same with several samples."""
_SPINS: Final = 200
"""Checks of another thread's progress before the thread yields: some microseconds."""


@inlined
def unit_rows(unit, bands, halved, height):
    """Return first row and end of a unit of work: a band, or half of one of the last ``halved`` bands.

    A band takes a tenth of a small frame; half of that is lost when one thread waits for another. ``end <= first`` if
    the unit has no rows.
    """
    whole = max(bands - halved, 0)
    first = unit * BAND_ROWS
    if unit >= whole:
        first = whole * BAND_ROWS + (unit - whole) * (BAND_ROWS // 2)
    return first, min(first + (BAND_ROWS if unit < whole else BAND_ROWS // 2), height)


@device_function
def _draw_band(task, first_row, end_row, memory):
    """Draw and shade rows of one band."""
    frame, draw = task.frame, task.draw_kernel
    if task.shade_kernel == 0:
        call_kernel(draw, (frame, first_row, end_row, memory, ALL_FACES))
        return
    keeps_back_faces = task.keeps_back_faces != 0
    faces = FRONT_FACES if keeps_back_faces or task.has_outputs == 0 else ALL_FACES
    call_kernel(draw, (frame, first_row, end_row, memory, faces))
    call_kernel(task.shade_kernel, (task.shade_job, memory, first_row, end_row))
    if keeps_back_faces:
        call_kernel(draw, (frame, first_row, end_row, memory, BACK_FACES))


@device_function
def _draw_sample_band(task, first_row, end_row, memory):
    """Draw and shade rows of one band with several samples per pixel."""
    call_kernel(task.draw_kernel, (task.frame, first_row, end_row, memory))
    call_kernel(task.edges_kernel, (task.frame, first_row, end_row, memory))
    call_kernel(task.shade_kernel, (task.shade_job, memory, task.stride, first_row, end_row))


@kernel("void(int64, boolean)")
def run_phases(task_address, until_finished):
    """Work on a frame, from any number of threads at any time, even when nothing is left to do.

    Args:
        task_address: address of a TASK.
        until_finished: return when the frame is finished; otherwise as soon as no unit of work is left.
    """
    task = task_at(task_address)
    memory = task.band_memory
    if memory != 0:
        memory += atomic_add_one(task.threads_started, 0) * task.band_memory_bytes
    halved = HALVED_BANDS if task.edges_kernel == 0 else HALVED_SAMPLE_BANDS
    for phase in range(PHASES):
        units = task.units[phase]
        if phase == 2:
            units += min(units, halved)
        unit = atomic_add_one(task.units_taken, phase)
        while unit < units:
            if is_set(task.stop):
                pass  # the remaining units are counted, so that no thread waits for them, but not done
            elif phase == 0:
                begin = unit * task.vertices_per_unit
                end = min(begin + task.vertices_per_unit, task.vertex_count)
                call_kernel(task.transform_kernel, (task.frame, begin, end))
            elif phase == 1:
                begin = unit * task.chunks_per_unit
                end = min(begin + task.chunks_per_unit, task.chunk_count)
                call_kernel(task.setup_kernel, (task.frame, begin, end))
            else:
                first_row, end_row = unit_rows(unit, task.units[2], halved, task.height)
                if first_row < end_row and task.edges_kernel != 0:
                    _draw_sample_band(task, first_row, end_row, memory)
                elif first_row < end_row:
                    _draw_band(task, first_row, end_row, memory)
            atomic_add_one(task.units_done, phase)
            unit = atomic_add_one(task.units_taken, phase)
        if phase == PHASES - 1 and not until_finished:
            return
        spins = 0
        while load_acquire(task.units_done, phase) < units:  # other threads work on the last units
            spins += 1
            if spins > _SPINS and task.yield_function != 0:
                yield_at(task.yield_function)
