"""Tables that kernels read: what is at which place, and the constants of the fixed-point grid."""

from __future__ import annotations

from typing import Final

SUBPIXEL: Final = 256
"""Vertices are snapped to 1/256 pixel, as GPUs and Mesa's llvmpipe do; edge functions of snapped vertices are exact."""
HALF: Final = 128
"""Offset of a pixel's centre, 1/256 pixel."""
GUARD: Final = 32760.0
"""Pixels: triangles with a vertex further than this from pixel (0, 0) are clipped. Below 2^15 pixels, 2^23 grid units,
edge functions stay below 2^50 (exact in float64 and int64) and snapped coordinates are exact in float32."""
MAX_SIDE: Final = 16384
"""Largest image side that the guard band leaves room for."""
MAX_POINT: Final = 1024
"""Largest point size and line width, pixels; larger ones are drawn with this."""

CHUNK: Final = 1024
"""Elements whose survivors share one set of band lists. Independent of the number of threads: the order of records in
the lists, and with it every tie, is too."""
SMALL_BANDS: Final = 4
"""A record that touches more bands than this goes to its chunk's list of tall records, once."""

# The job: int64 values, mostly addresses.
J_WIDTH: Final = 0
J_HEIGHT: Final = 1
J_BANDS: Final = 2
J_CHUNKS: Final = 3
J_VERTICES: Final = 4
J_ELEMENTS: Final = 5
J_INSTANCES: Final = 6  # drawn ones
J_TABLE: Final = 7  # (drawn + 1, T_COLUMNS) int64
J_LENGTHS: Final = 8  # (drawn, M_COLUMNS) float64
J_VERTEX: Final = 9  # (vertices, 4) float32: x, y (pixels), 1/z, unused
J_PLAIN_IDS: Final = 10  # (height, width) int32, float32: copies without padding; 0: not wanted
J_PLAIN_INV_Z: Final = 11
J_RECORDS: Final = 12  # (chunks * CHUNK, 64 bytes)
J_SMALL: Final = 13  # (chunks, SMALL_BANDS * CHUNK) uint16
J_TALL: Final = 14  # (chunks, CHUNK) uint16
J_OFFSETS: Final = 15  # (chunks, 2 lists + 4) int32: starts in SMALL and MICRO by list, ends of tall ones
# (in J_RANGES, chunks by 4 int32: first and last band with anything of the chunk, and with back faces kept apart)
J_IDS: Final = 16  # (height, stride) int32; 0: nobody wants the layer itself, only the outputs
J_INV_Z: Final = 17  # (height, stride) float32
J_BEYOND_IDS: Final = 18  # (height, stride); 0: no such layer
J_BEYOND_INV_Z: Final = 19
J_BEFORE_IDS: Final = 20
J_BEFORE_INV_Z: Final = 21
J_DEPTH: Final = 22  # outputs; 0: not wanted
J_LABEL: Final = 23
J_INSTANCE: Final = 24
J_NORMAL: Final = 25
J_ALL_INSTANCES: Final = 26
J_FIRST_RECORD: Final = 27  # (all + 1,) int64
J_ALL_LABELS: Final = 28  # (all,) uint32
J_ALL_IDS: Final = 29  # (all,) int32
J_ALL_MESHES: Final = 30  # (all, A_COLUMNS) int64
J_ALL_X: Final = 31  # (all, 4, 4) float64, camera from mesh
J_STRIDE: Final = 32  # width rounded up to whole vectors
J_MICRO: Final = 33  # (chunks, MICRO_PER_ELEMENT * CHUNK, 4) int32: pixel, bits of the float32 1/z, record number, list
J_LISTS: Final = 34  # bands; twice as many where back faces are kept apart: theirs follow
J_MARGIN: Final = 35  # grid units from a pixel's centre to its outermost sample, each way; 0: one sample
J_SAMPLES: Final = 36  # (2, 8) int32: offsets of a pixel's samples across and down, grid units
J_SAMPLE_IDS: Final = 37  # (slots, 8) int32, float32: what each sample sees
J_SAMPLE_INV_Z: Final = 38
J_RANGES: Final = 39
J_SETUP: Final = 40  # addresses: the kernel that sets up what was put off, this job, the lens
J_SELF: Final = 41
J_LENS: Final = 42
J_FAR: Final = 43  # (height, stride) float32: bounds of the 1/z of a pixel's samples
J_NEAR: Final = 44
J_LANES: Final = 45  # (256, 8) int32: the lanes of each mask, the lowest first
J_SLOTS: Final = 46  # (height, stride) int32: which slot of the samples a pixel has, -1: none
J_OWNERS: Final = 47  # (height, stride) int32: the place of a pixel's record among all, see ``multisample``
J_STOP: Final = 48  # address of an int64: not 0 when the frame is not wanted any more, see ``stop.StopFlag``
J_COLUMNS: Final = 49

# The lens: float64 values.
L_FX: Final = 0
L_FY: Final = 1
L_CX: Final = 2
L_CY: Final = 3
L_NEAR: Final = 4
L_FAR: Final = 5
L_COLUMNS: Final = 6

# One row per drawn instance, and one more with the totals in T_VERTEX and T_ELEMENT.
T_VERTEX: Final = 0  # first vertex among the drawn instances' vertices
T_ELEMENT: Final = 1  # first element among the drawn instances' elements
T_POSITIONS: Final = 2
T_ELEMENTS: Final = 3
T_TOPOLOGY: Final = 4
T_RECORD: Final = 5  # record of element 0
T_CULL: Final = 6  # 0: both sides; +1, -1: triangles whose screen area has this sign are culled, or kept apart
T_HIDDEN: Final = 7  # 0; +1, -1: triangles whose screen area has this sign are hidden by others of their mesh
T_CLUSTERS: Final = 8  # of its mesh's triangles, see ``clusters``; 0: not known
T_COLUMNS: Final = 9
M_SIZE: Final = 12  # after the 3 rows of camera from mesh: point size or line width
M_COLUMNS: Final = 13

# Of every instance's mesh, float64, see solid: middle and half sides of its box; half a side below 0: not solid.
B_MIDDLE: Final = 0
B_HALF: Final = 3
B_COLUMNS: Final = 6

# What resolve reads of every instance's mesh.
A_TOPOLOGY: Final = 0
A_POSITIONS: Final = 1
A_ELEMENTS: Final = 2
A_NORMALS: Final = 3
A_COLUMNS: Final = 4

SMALL_WIDTH: Final = 64
SMALL_HEIGHT: Final = 128
"""Triangles whose box holds at most this many pixel centres across and down have edge functions that fit int32:
2 x 256^2 x (64 + 8) x 128 < 2^31."""
SMALL_RATIO: Final = 4.0
"""Triangles whose farthest vertex is more than this times as far as the nearest go the large path, where 1/z is
evaluated in float64: near grazing walls float32 would lose digits at the far end."""
TINY: Final = 4
"""Triangles whose box holds at most TINY x TINY pixel centres are solved in setup, which leaves their pixels."""
MICRO_PER_ELEMENT: Final = 4
"""Room for pixels of tiny triangles, per element of a chunk; when it is used up, the others become records."""
MICRO_VALUES: Final = 4
"""Of each of these pixels, while its chunk is set up, in arrays of their own: its place, the highest bit set where a
back face is kept apart; the bits of 1/z; the record number; its list."""
MICRO_LISTS: Final = 3
MICRO_ROOM: Final = MICRO_PER_ELEMENT * CHUNK + 8
"""int32 of such an array."""

# A record is 64 bytes: 8 int32, 3 float64, 2 float32. Offsets are counted in values of the respective type.
RECORD_BYTES: Final = 64
R_XY: Final = 0  # int32: x0 y0 x1 y1 x2 y2, grid units (see R_KIND for others)
R_ID: Final = 6  # int32: record number
R_KIND: Final = 7  # int32
R_DX: Final = 4  # float64: change of 1/z per column, per row, and 1/z at the box's first pixel centre
R_DY: Final = 5
R_BASE: Final = 6
R_LOW: Final = 14  # float32: bounds of 1/z over the element, so that slivers never extrapolate
R_HIGH: Final = 15

KIND_TRIANGLE: Final = 0
KIND_CLIPPED: Final = 1
"""A triangle that crosses the near plane or the guard band. R_XY: first column and row of its box, drawn instance."""
KIND_LINE: Final = 2
"""R_XY: both ends, half the width in grid units."""
KIND_POINT: Final = 3
"""R_XY: first column and row, and those after the last; where a pixel has samples, grid units instead."""
KIND_SMALL: Final = 4
"""A triangle within SMALL_WIDTH x SMALL_HEIGHT: S_EDGES and on instead of R_XY and R_DX .. R_BASE."""

KIND_LATER: Final = 5
"""Up to eight back faces that are kept apart, neighbours in their mesh, of which only the box and the nearest 1/z are
known: nearly all are hidden, and those that are not are set up when their band is drawn. S_BOX, S_SIZE and R_HIGH are
those of all of them."""
G_ELEMENT: Final = 0  # int32: first element, which of the eight, drawn instance
G_LANES: Final = 1
G_DRAWN: Final = 2
LATER_SIDE: Final = 12
"""Pixels across and down that a group may take: large triangles cost less to set up than to keep, and scattered ones
would be set up by every band of their box."""

# What J_SETUP is asked for, int64: the address of a KIND_LATER record; addresses of room for 8 records, 8 spans, the
# pixels of 8 tiny triangles, a column of 16 x 8 int32, and MICRO_VALUES x MICRO_ROOM int32; the answer, how many
# records and pixels there are.
Q_GROUP: Final = 0
Q_RECORDS: Final = 1
Q_SPANS: Final = 2
Q_MICRO: Final = 3
Q_SCRATCH: Final = 4
Q_PIXELS: Final = 5
Q_COUNT: Final = 6
Q_MICROS: Final = 7

# A small triangle's record: 16 values of 4 bytes; R_ID, R_KIND, R_LOW and R_HIGH as above. The third edge's steps are
# minus the sum of the others'.
S_EDGES: Final = 0  # int32: the 3 edge functions at the box's first pixel centre; covered where all are >= 0
S_RIGHT: Final = 3  # int32: change per column of the first two
S_DOWN: Final = 5  # int32: change per row of the first
S_DOWN_SECOND: Final = 8  # int32: change per row of the second
S_BOX: Final = 9  # int32: first column (low half, signed) and row (high half) of the box, perhaps off the picture
S_SIZE: Final = 10  # int32: columns (low half) and rows (high half)
S_BASE: Final = 11  # float32: 1/z at the box's first pixel centre, change per column, per row
S_DX: Final = 12
S_DY: Final = 13
