"""A frame's phases, from the vertices to the finished bands, in one call of each thread that works on it."""

from __future__ import annotations

from typing import Final

from renderers.compiler.device_function import inlined, inner
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import call_kernel, is_set, shared_number, take_number, yield_at
from renderers.compiler.pointers import i64_at
from renderers.raster.resolve import BACKS, EVERYTHING, FRONTS
from renderers.visibility_buffer import BAND_ROWS

PHASES: Final = 3
"""Transform, setup, bands."""

# The task: int64 values.
W_JOB: Final = 0  # address of the job, see layout
W_LENS: Final = 1
W_TRANSFORM: Final = 2  # addresses of the kernels
W_SETUP: Final = 3
W_YIELD: Final = 4
W_VERTICES: Final = 5
W_VERTICES_PER_UNIT: Final = 6
W_CHUNKS: Final = 7
W_CHUNKS_PER_UNIT: Final = 8
W_HEIGHT: Final = 9
W_STRIDE: Final = 10  # records of a row of a layer
W_SPLIT: Final = 11  # whether back faces are kept apart
W_DRAW: Final = 12
W_SHADE: Final = 13  # 0: nothing is shaded; with several samples a kernel as ``edges.shade_mixed``
W_SHADE_JOB: Final = 14
W_LAYERS: Final = 15  # address of a layer of one band for each thread; 0: the layer is where the job says; with
W_LAYER_BYTES: Final = 16  # several samples of each thread's ``samples.E_COLUMNS`` addresses
W_FIND: Final = 17  # address of ``edges.find_edges``; 0: one sample
W_GEOMETRY: Final = 18  # whether other pictures than colour are wanted
W_UNITS: Final = 19  # PHASES values
W_STOP: Final = 22  # J_STOP of the job
W_THREADS: Final = 23  # how many have begun; from here on written while threads work
W_TAKEN: Final = 24  # PHASES values: units taken
W_ENDED: Final = 27  # PHASES values: units done
W_COLUMNS: Final = 30

HALVED: Final = 2
"""Bands at the end of a picture that are two units of work each, with one sample a pixel."""
HALVED_SAMPLES: Final = 1
"""The same with several samples."""
_PATIENCE: Final = 200
"""Looks at another thread's progress before the core is offered to others: some microseconds."""


@inlined
def unit_rows(unit, bands, halved, height):
    """The rows of a unit of work: a band, of the last ``halved`` ones a half. None where the end is not behind the
    begin.

    A band takes a tenth of a frame where pictures are small: threads that end at different times wait for half of it.
    """
    whole = max(bands - halved, 0)
    first = unit * BAND_ROWS
    if unit >= whole:
        first = whole * BAND_ROWS + (unit - whole) * (BAND_ROWS // 2)
    return first, min(first + (BAND_ROWS if unit < whole else BAND_ROWS // 2), height)


@inner
def _band(task, first, last, layer):
    """Draw and shade rows of one band."""
    job, lens, draw = task[W_JOB], task[W_LENS], task[W_DRAW]
    if task[W_SHADE] == 0:
        call_kernel(draw, (job, lens, first, last, layer, EVERYTHING))
        return
    split = task[W_SPLIT] != 0
    call_kernel(draw, (job, lens, first, last, layer, FRONTS if split or task[W_GEOMETRY] == 0 else EVERYTHING))
    call_kernel(task[W_SHADE], (task[W_SHADE_JOB], layer - 4 * first * task[W_STRIDE], first, last))
    if split:
        call_kernel(draw, (job, lens, first, last, layer, BACKS))


@inner
def _samples(task, first, last, memory):
    """Draw and shade rows of one band with several samples a pixel."""
    call_kernel(task[W_DRAW], (task[W_JOB], task[W_LENS], first, last, memory))
    call_kernel(task[W_FIND], (task[W_JOB], first, last, memory))
    call_kernel(task[W_SHADE], (task[W_SHADE_JOB], memory, task[W_STRIDE], first, last))


@kernel("void(int64, boolean)")
def work(task_at, stay):
    """Take part in a frame; any number of threads, each at any time, even when nothing is left.

    Args:
        task_at: address of W_COLUMNS int64.
        stay: whether to stay until the frame is finished, not only until there is nothing left to do. Threads that
            leave at the same time wait for each other's turn with the interpreter.
    """
    task = i64_at(task_at)
    layer = task[W_LAYERS]
    if layer != 0:
        layer += take_number(task, W_THREADS) * task[W_LAYER_BYTES]
    halved = HALVED if task[W_FIND] == 0 else HALVED_SAMPLES
    for phase in range(PHASES):
        units = task[W_UNITS + phase]
        if phase == 2:
            units += min(units, halved)
        unit = take_number(task, W_TAKEN + phase)
        while unit < units:
            if is_set(task[W_STOP]):
                pass  # units that are left are counted, so that no thread waits for them, but not done
            elif phase == 0:
                begin = unit * task[W_VERTICES_PER_UNIT]
                end = min(begin + task[W_VERTICES_PER_UNIT], task[W_VERTICES])
                call_kernel(task[W_TRANSFORM], (task[W_JOB], task[W_LENS], begin, end))
            elif phase == 1:
                begin = unit * task[W_CHUNKS_PER_UNIT]
                end = min(begin + task[W_CHUNKS_PER_UNIT], task[W_CHUNKS])
                call_kernel(task[W_SETUP], (task[W_JOB], task[W_LENS], begin, end))
            else:
                first, last = unit_rows(unit, task[W_UNITS + 2], halved, task[W_HEIGHT])
                if first < last and task[W_FIND] != 0:
                    _samples(task, first, last, layer)
                elif first < last:
                    _band(task, first, last, layer)
            take_number(task, W_ENDED + phase)
            unit = take_number(task, W_TAKEN + phase)
        if phase == PHASES - 1 and not stay:
            return
        looks = 0
        while shared_number(task, W_ENDED + phase) < units:  # the last units are under way in other threads
            looks += 1
            if looks > _PATIENCE and task[W_YIELD] != 0:
                yield_at(task[W_YIELD])
