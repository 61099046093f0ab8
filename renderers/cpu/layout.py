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
J_X: Final = 9  # (vertices,) float32
J_Y: Final = 10
J_W: Final = 11
J_RECORDS: Final = 12  # (chunks * CHUNK, 64 bytes)
J_SMALL: Final = 13  # (chunks, SMALL_BANDS * CHUNK) uint16
J_TALL: Final = 14  # (chunks, CHUNK) uint16
J_OFFSETS: Final = 15  # (chunks, bands + 2) int32: starts in SMALL by band, then the number of tall records
J_IDS: Final = 16
J_INV_Z: Final = 17
J_BEYOND_IDS: Final = 18  # 0: no such layer
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
J_COLUMNS: Final = 32

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
T_CULL: Final = 6  # 0: both sides; +1, -1: triangles whose screen area has this sign are culled
T_COLUMNS: Final = 7
M_SIZE: Final = 12  # after the 3 rows of camera from mesh: point size or line width
M_COLUMNS: Final = 13

# What resolve reads of every instance's mesh.
A_TOPOLOGY: Final = 0
A_POSITIONS: Final = 1
A_ELEMENTS: Final = 2
A_NORMALS: Final = 3
A_COLUMNS: Final = 4

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
"""R_XY: first column and row, and those after the last."""
