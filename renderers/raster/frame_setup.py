"""What comes before a frame's phases: everything that kernels read, from one short list of what is asked for.

One thread does it while the others wait, with caches that the last frame has gone through, so that a line of Python
takes microseconds here and the smallest frames a few hundred.
"""

from __future__ import annotations

from typing import Final

from renderers.compiler.jit import kernel
from renderers.compiler.pointers import i64_at
from renderers.raster import frame_phases as task_at
from renderers.raster.instance_transforms import look_from, place
from renderers.raster.layout import (
    CHUNK,
    J_ALL_IDS,
    J_ALL_INSTANCES,
    J_ALL_LABELS,
    J_ALL_MESHES,
    J_ALL_X,
    J_BANDS,
    J_CHUNKS,
    J_COLUMNS,
    J_ELEMENTS,
    J_FIRST_RECORD,
    J_HEIGHT,
    J_LENGTHS,
    J_LENS,
    J_LISTS,
    J_MICRO,
    J_OFFSETS,
    J_RANGES,
    J_RECORDS,
    J_SELF,
    J_SETUP,
    J_SMALL,
    J_STOP,
    J_STRIDE,
    J_TABLE,
    J_TALL,
    J_VERTEX,
    J_VERTICES,
    J_WIDTH,
    M_COLUMNS,
    T_COLUMNS,
)
from renderers.visibility_buffer import BAND_ROWS

MIN_VERTICES: Final = 4096
"""Fewest vertices of a unit of work: about 10 us, a few times what handing out a unit costs."""
UNITS_PER_THREAD: Final = 8
"""Units of work per thread and phase, so that one slow unit or late thread does not leave the others waiting."""
SMALL_WORK: Final = 60_000
"""Samples plus 4 x elements below which a frame takes less time than waking another thread."""

# One array holds a frame's tables: to ask an array for its address takes as long as to fill most of them. It begins
# with the job and what is asked for; then come, for all instances, the poses (I, 4, 4) float64, J_LENGTHS and J_TABLE.
# Places and sizes in values of 8 bytes.
ASKED: Final = J_COLUMNS

# What is asked for, int64 but for lens and pose.
A_WIDTH: Final = 0
A_HEIGHT: Final = 1
A_SAMPLES: Final = 2
A_THREADS: Final = 3  # at most
A_SELECT: Final = 4  # addresses as for ``place``
A_CULL: Final = 5
A_OPAQUE: Final = 6  # whether the backs of solid meshes need not be drawn
A_BACKS: Final = 7  # whether culled faces are kept apart, not left out
A_COUNT: Final = 8  # instances; with what follows PreparedCast.asked
A_TABLE: Final = 9
A_SIZES: Final = 10
A_BOUNDS: Final = 11
A_FIRST_RECORD: Final = 12
A_LABELS: Final = 13
A_IDS: Final = 14
A_MESHES: Final = 15
A_ROOM: Final = 16  # addresses of J_VERTEX, J_RECORDS, J_SMALL, J_TALL, J_MICRO, J_RANGES and J_OFFSETS
A_TRANSFORM: Final = 23  # addresses of kernels
A_SETUP: Final = 24
A_YIELD: Final = 25
A_STRIDE: Final = 26  # J_STRIDE
A_LENS: Final = 27  # (L_COLUMNS,) float64
A_POSED: Final = 33  # whether the poses are filled already
A_TASK: Final = 34  # address of W_COLUMNS int64, all 0: the frame's task
A_STOP: Final = 35  # J_STOP
A_POINTS: Final = 36  # address of (A_COUNT, 4, 4) float64, world from mesh
A_POSE: Final = A_POINTS + 1  # (4, 4) float64, world from camera
A_COLUMNS: Final = A_POSE + 16

POSES: Final = ASKED + A_COLUMNS
PER_INSTANCE: Final = 16 + M_COLUMNS + T_COLUMNS
FIXED: Final = POSES + T_COLUMNS
"""Values of the array apart from PER_INSTANCE of each."""


@kernel("int64(int64)", brief=True)
def begin(address):
    """Fill a frame's tables but for what ``FrameJob.layers``, ``outputs`` and samples need, and how it is drawn.

    Args:
        address: of the array, of which what is asked for is filled.

    Returns how many threads may be of use; 0 where the camera's pose is not affine or has no inverse: the poses must be
    filled otherwise, and this be called again.
    """
    job, ask = i64_at(address), i64_at(address + 8 * ASKED)
    task = i64_at(ask[A_TASK])
    for column in range(J_COLUMNS):
        job[column] = 0
    count, width, height = ask[A_COUNT], ask[A_WIDTH], ask[A_HEIGHT]
    poses = address + 8 * POSES
    lens, lengths = address + 8 * (ASKED + A_LENS), poses + 8 * 16 * count
    if ask[A_POSED] == 0 and look_from(address + 8 * (ASKED + A_POSE), ask[A_POINTS], poses, count) == 0:
        return 0
    job[J_SELF], job[J_LENS], job[J_LENGTHS], job[J_TABLE] = address, lens, lengths, lengths + 8 * M_COLUMNS * count
    apart = place(
        address,
        ask[A_TABLE],
        poses,
        ask[A_SIZES],
        ask[A_BOUNDS] if ask[A_OPAQUE] != 0 else 0,
        ask[A_SELECT],
        ask[A_CULL],
        count,
    )
    split = ask[A_BACKS] != 0 and apart > 0
    bands = (height + BAND_ROWS - 1) // BAND_ROWS
    chunks = (job[J_ELEMENTS] + CHUNK - 1) // CHUNK
    job[J_WIDTH], job[J_HEIGHT], job[J_STRIDE] = width, height, ask[A_STRIDE]
    job[J_BANDS], job[J_LISTS], job[J_CHUNKS] = bands, 2 * bands if split else bands, chunks
    job[J_VERTEX], job[J_RECORDS], job[J_SMALL] = ask[A_ROOM], ask[A_ROOM + 1], ask[A_ROOM + 2]
    job[J_TALL], job[J_MICRO], job[J_RANGES] = ask[A_ROOM + 3], ask[A_ROOM + 4], ask[A_ROOM + 5]
    job[J_OFFSETS] = ask[A_ROOM + 6]
    job[J_SETUP] = ask[A_SETUP]
    job[J_ALL_INSTANCES], job[J_ALL_X] = count, poses
    job[J_FIRST_RECORD], job[J_ALL_LABELS] = ask[A_FIRST_RECORD], ask[A_LABELS]
    job[J_ALL_IDS], job[J_ALL_MESHES] = ask[A_IDS], ask[A_MESHES]
    job[J_STOP] = task[task_at.W_STOP] = ask[A_STOP]

    threads = ask[A_THREADS]
    units = UNITS_PER_THREAD * threads if threads > 1 else 1
    vertices = max((job[J_VERTICES] + units - 1) // units, MIN_VERTICES)
    per_unit = max((chunks + units - 1) // units, 1)
    task[task_at.W_JOB], task[task_at.W_LENS] = address, lens
    task[task_at.W_TRANSFORM], task[task_at.W_SETUP], task[task_at.W_YIELD] = (
        ask[A_TRANSFORM],
        ask[A_SETUP],
        ask[A_YIELD],
    )
    task[task_at.W_VERTICES], task[task_at.W_VERTICES_PER_UNIT] = job[J_VERTICES], vertices
    task[task_at.W_CHUNKS], task[task_at.W_CHUNKS_PER_UNIT] = chunks, per_unit
    task[task_at.W_HEIGHT], task[task_at.W_STRIDE], task[task_at.W_SPLIT] = height, job[J_STRIDE], split
    transforms, setups = (job[J_VERTICES] + vertices - 1) // vertices, (chunks + per_unit - 1) // per_unit
    task[task_at.W_UNITS], task[task_at.W_UNITS + 1], task[task_at.W_UNITS + 2] = transforms, setups, bands
    if ask[A_SAMPLES] * width * height + 4 * job[J_ELEMENTS] < SMALL_WORK:
        return 1
    return min(threads, max(transforms, setups, bands))
