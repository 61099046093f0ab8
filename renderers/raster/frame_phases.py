"""A frame's phases, from vertices to finished bands: one call by each thread that works on it."""

from __future__ import annotations

from typing import Final

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import atomic_add_one, call_kernel, is_set, load_acquire, yield_at
from renderers.compiler.kernel_types import I64, Address
from renderers.compiler.pointers import address
from renderers.raster.layout import PHASES, RasterFrame
from renderers.visibility_buffer import BAND_ROWS

_SPINS: Final = 200
"""Checks of another thread's progress before the thread yields: some microseconds."""


@device_function
def _draw_band(frame: RasterFrame, first_row: I64, end_row: I64, memory: Address) -> None:
    """Draw, shade and resolve one band.

    Args:
        memory: address of the thread's own memory for a band; 0: the frame has a layer of the whole image.
    """
    call_kernel(frame.draw_kernel, (address(frame), first_row, end_row, memory, 0))
    if frame.shade_kernel != 0:
        call_kernel(frame.shade_kernel, (frame.shade_job, memory, first_row, end_row))
    if frame.first_back_bin != 0:
        call_kernel(frame.draw_kernel, (address(frame), first_row, end_row, memory, 1))
    if frame.resolve_kernel != 0:
        call_kernel(frame.resolve_kernel, (address(frame), first_row, end_row, memory))


@device_function
def _draw_sample_band(frame: RasterFrame, first_row: I64, end_row: I64, memory: Address) -> None:
    """Draw and shade one band with several samples per pixel; ``memory``: address of the thread's SampleBand."""
    call_kernel(frame.draw_kernel, (address(frame), first_row, end_row, memory))
    call_kernel(frame.edges_kernel, (address(frame), first_row, end_row, memory))
    call_kernel(frame.shade_kernel, (frame.shade_job, memory, frame.stride, first_row, end_row))


@inlined
def _do_unit(frame: RasterFrame, phase: I64, unit: I64, memory: Address) -> None:
    """Do a unit of work.

    Args:
        phase: 0: transform; 1: setup; 2: bands.
        unit: its index in the phase.
        memory: as for ``_draw_band`` or ``_draw_sample_band``.
    """
    if phase == 0:
        begin = unit * frame.vertices_per_unit
        end = min(begin + frame.vertices_per_unit, frame.vertex_count)
        call_kernel(frame.transform_kernel, (address(frame), begin, end))
    elif phase == 1:
        begin = unit * frame.chunks_per_unit
        end = min(begin + frame.chunks_per_unit, frame.chunk_count)
        call_kernel(frame.setup_kernel, (address(frame), begin, end))
    else:
        first_row = unit * BAND_ROWS
        end_row = min(first_row + BAND_ROWS, frame.height)
        if frame.edges_kernel != 0:
            _draw_sample_band(frame, first_row, end_row, memory)
        else:
            _draw_band(frame, first_row, end_row, memory)


@kernel
def run_phases(frame_address: Address, until_finished: bool) -> None:
    """Work on a frame together with other threads. A thread may come late, even when nothing is left to do.

    With ``band_memory``, at most ``max_threads`` calls in all: each takes a part of it.

    Args:
        frame_address: address of a RasterFrame.
        until_finished: return when the frame is finished; otherwise as soon as no unit of work is left.
    """
    frame = RasterFrame(frame_address)
    memory = frame.band_memory
    if memory != 0:
        memory += atomic_add_one(frame.threads_started, 0) * frame.band_memory_bytes
    for phase in range(PHASES):
        units = frame.units[phase]
        unit = atomic_add_one(frame.units_taken, phase)
        while unit < units:
            if not is_set(frame.stop):  # otherwise it is counted, so that no thread waits for it, but not done
                _do_unit(frame, phase, unit, memory)
            atomic_add_one(frame.units_done, phase)
            unit = atomic_add_one(frame.units_taken, phase)
        if phase == PHASES - 1 and not until_finished:
            return
        spins = 0
        while load_acquire(frame.units_done, phase) < units:  # other threads work on the last units
            spins += 1
            if spins > _SPINS and frame.yield_function != 0:
                yield_at(frame.yield_function)
