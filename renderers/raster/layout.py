"""Structs that the rasterizer's kernels read and write, and the constants of the fixed-point grid."""

from __future__ import annotations

from typing import Final

from renderers.compiler.structs import F32, F64, I32, I64, U16, U32, Struct, array_of, pointer_to

SUBPIXEL: Final = 256
"""Grid units per pixel. Vertices are snapped to the grid, as on GPUs; edge functions of snapped vertices are exact."""
HALF: Final = SUBPIXEL // 2
"""Grid units from a pixel's edge to its centre."""
GUARD_BAND: Final = 32760.0
"""Pixels: triangles with a vertex farther than this from pixel (0, 0) are clipped. Below 2^15 pixels, 2^23 grid units,
edge functions stay below 2^50, exact in float64 and int64, and snapped coordinates are exact in float32."""
MAX_SIDE: Final = 16384
"""Maximum image width and height, pixels, for which the guard band leaves room."""
MAX_POINT: Final = 1024
"""Maximum point size and line width, pixels; larger ones are drawn with this."""

CHUNK: Final = 1024
"""Primitives that share one set of bins. Independent of the number of threads, and with it the order of drawing."""
MAX_BINS: Final = 4
"""A primitive that touches more bands than this goes to its chunk's list of tall primitives, once."""
TINY: Final = 4
"""Triangles of at most TINY x TINY pixel centres are rasterized in setup, which emits their pixels."""
TINY_PIXELS: Final = 4
"""Room for pixels of tiny triangles, per primitive of a chunk. Beyond it, they are binned as small ones."""
SMALL_WIDTH: Final = 64
SMALL_HEIGHT: Final = 128
"""Triangles of at most this many pixel centres across and down have edge functions that fit int32:
2 x 256^2 x (64 + 8) x 128 < 2^31."""
SMALL_RATIO: Final = 4.0
"""Triangles whose farthest vertex is more than this times as far as the nearest are not small: their 1/z is evaluated
in float64, since float32 would lose digits at the far end."""
MAX_DEFERRED_SIDE: Final = 12
"""Maximum width and height, pixels, of a group of deferred back faces. Large triangles cost less to set up than to
keep, and every band that a group touches sets it up again."""

# Topology of a mesh: vertices of a primitive.
LINES: Final = 2
TRIANGLES: Final = 3

INSTANCE: Final = Struct(
    "Instance",
    {
        "positions": pointer_to(F32),  # (N, 3): vertices to transform, which may be fewer than the mesh's own
        "indices": pointer_to(U32),  # (M, topology) into these
        "clusters": I64,  # address, see cluster_culling; 0: none
        "topology": I64,
        "first_vertex": I64,  # among all instances' vertices
        "first_primitive": I64,  # among all instances' primitives: the primitive id of its first
        "size": F64,  # point size or line width, pixels
        "box_center": array_of(F64, 3),  # of convex meshes, see convex_culling
        "box_half": array_of(F64, 3),  # below 0: not convex
        "mesh_positions": pointer_to(F32),  # the mesh's own arrays
        "mesh_indices": pointer_to(U32),
        "mesh_normals": I64,  # address of (N, 3) float32; 0: none
    },
)
"""An instance of the draw list, independent of camera and pose. The table ends with one more row that holds the totals
in ``first_vertex`` and ``first_primitive``."""

DRAW: Final = Struct(
    "Draw",
    {
        "positions": pointer_to(F32),  # as in INSTANCE
        "indices": pointer_to(U32),
        "clusters": I64,
        "topology": I64,
        "size": F64,
        "first_vertex": I64,  # among the drawn vertices
        "first_primitive": I64,  # among the drawn primitives
        "first_id": I64,  # primitive id of its first primitive
        "culled": I64,  # +1, -1: triangles whose area on screen has this sign are culled, or kept apart; 0: none
        "hidden": I64,  # +1, -1: triangles of this sign are hidden by others of their mesh; 0: none
        "X_camera_mesh": array_of(F64, 12),  # the first three rows
    },
)
"""An instance that is drawn in a frame. The table ends with one more row for the totals, as INSTANCE's."""

FRAME: Final = Struct(
    "Frame",
    {
        # Set by FrameJob.
        "width": I64,  # pixels
        "height": I64,
        "stride": I64,  # pixels from one row of a visibility layer to the next
        "samples": I64,  # per pixel
        "max_threads": I64,
        "fx": F64,  # camera intrinsics, pixels
        "fy": F64,
        "cx": F64,
        "cy": F64,
        "near": F64,  # metres
        "far": F64,
        "instance_count": I64,
        "instances": INSTANCE,  # (instance_count + 1)
        "first_ids": pointer_to(I64),  # (instance_count + 1): first primitive id of every instance, and the total
        "labels": pointer_to(I32),  # (instance_count,): bits of uint32 labels
        "instance_ids": pointer_to(I32),  # (instance_count,)
        "selected": I64,  # address of (instance_count,) bool: instances to draw; 0: all
        "culled": I64,  # address of (instance_count,) bool: instances whose back faces are culled; 0: none
        "skip_hidden": I64,  # not 0: back faces of convex meshes need not be drawn
        "keep_backs": I64,  # not 0: culled faces are kept apart, for the outputs that show them
        "X_world_mesh": pointer_to(F64),  # (instance_count, 4, 4)
        "X_world_camera": array_of(F64, 16),
        "X_camera_mesh": pointer_to(F64),  # (instance_count, 4, 4)
        "poses_ready": I64,  # not 0: X_camera_mesh is filled
        "task": I64,  # address of a TASK
        "stop": I64,  # address of an int64 that is not 0 once the frame should end, see renderers.stop
        "draws": DRAW,  # (draw_count + 1)
        "vertices": pointer_to(F32),  # (vertex_count, 4): x, y in pixels, 1/z, unused
        "binned": I64,  # address of (chunk_count * CHUNK) BINNED or SMALL_TRIANGLE or DEFERRED_BACKS
        "bins": pointer_to(U16),  # (chunk_count, MAX_BINS * CHUNK): primitives of a chunk, bin by bin
        "tall": pointer_to(U16),  # (chunk_count, CHUNK)
        "bin_starts": pointer_to(I32),  # (chunk_count, 2 * bin_count + 4), see bin_starts_of
        "chunk_bands": pointer_to(I32),  # (chunk_count, 4): first and last band touched, and the same of kept backs
        "tiny_pixels": pointer_to(I32),  # (chunk_count, TINY_PIXELS * CHUNK, 4): pixel, bits of 1/z, primitive id, bin
        "transform_kernel": I64,  # addresses
        "setup_kernel": I64,
        "normals_kernel": I64,
        "yield_function": I64,
        "layer_ids": I64,  # address of (height, stride) int32 and float32; 0: only the outputs are wanted
        "layer_inv_z": I64,
        "unpadded_ids": I64,  # address of (height, width) copies of the layer; 0: none
        "unpadded_inv_z": I64,
        "beyond_ids": I64,  # address of the layer (height, stride) that primitives must lie behind; 0: none
        "beyond_inv_z": I64,
        "before_ids": I64,  # address of the layer that primitives must lie in front of; 0: none
        "before_inv_z": I64,
        "depth": I64,  # addresses of outputs; 0: not wanted
        "label": I64,
        "instance": I64,
        "normal": I64,
        "sample_reach": I64,  # grid units from a pixel's centre to its outermost sample, each way; 0: one sample
        "sample_offsets": pointer_to(I32),  # (2, 8): offsets of the samples across and down, grid units
        "lane_lists": pointer_to(I32),  # (256, 8), see msaa.lane_lists
        # Computed by frame_setup.
        "draw_count": I64,
        "vertex_count": I64,
        "primitive_count": I64,
        "chunk_count": I64,
        "band_count": I64,
        "bin_count": I64,  # band_count, or twice that where back faces are kept apart: theirs follow
    },
)
"""A rasterization: its parameters and the memory that it works in."""

PHASES: Final = 3
"""Phases of a frame: transform, setup, bands."""

TASK: Final = Struct(
    "Task",
    {
        "frame": I64,  # address
        "transform_kernel": I64,  # addresses
        "setup_kernel": I64,
        "draw_kernel": I64,  # resolve.draw_band, or msaa.edges.draw_samples
        "edges_kernel": I64,  # msaa.edges.find_edges; 0: one sample per pixel
        "shade_kernel": I64,  # 0: nothing is shaded
        "shade_job": I64,
        "yield_function": I64,
        "vertex_count": I64,
        "vertices_per_unit": I64,
        "chunk_count": I64,
        "chunks_per_unit": I64,
        "height": I64,
        "stride": I64,
        "keeps_backs": I64,  # not 0: back faces are kept apart
        "has_outputs": I64,  # not 0: other outputs than colour are wanted
        "band_memory": I64,  # address of the first thread's memory for a band; 0: none
        "band_memory_bytes": I64,  # of each thread
        "stop": I64,  # as in FRAME
        "units": array_of(I64, PHASES),
        # Written while threads work.
        "threads": array_of(I64, 1),  # number of threads that have begun
        "units_taken": array_of(I64, PHASES),
        "units_done": array_of(I64, PHASES),
    },
)
"""A frame's work, shared by threads. Helper threads that are late read it after the frame's end, so it does not lie in
the memory that frames reuse."""

LAYER: Final = Struct("Layer", {"ids": pointer_to(I32), "inv_z": pointer_to(F32)})
"""A visibility layer, both (height, stride). If only a band of it exists, the pointers are shifted: index 0 is the
image's first pixel."""

SETUP_MEMORY: Final = Struct(
    "SetupMemory",
    {
        "binned": I64,  # address of CHUNK primitives of BINNED_BYTES
        "bin_ranges": pointer_to(I32),  # (CHUNK, 2): first and last bin of each
        "tiny": pointer_to(I32),  # (4, TINY_ROOM): pixel, bits of 1/z, primitive id, bin
        "columns": pointer_to(I32),  # (16, 8): scratch
    },
)
"""Memory that a chunk is set up in."""
TINY_ROOM: Final = TINY_PIXELS * CHUNK + 8
TINY_BIN: Final = 3 * TINY_ROOM
"""Index of the bins in ``SETUP_MEMORY.tiny``. Before, the highest bit of a pixel marks a kept back face."""

BINNED_BYTES: Final = 64
"""Size of each of the following three, which share ``id`` and ``kind``."""
BINNED: Final = Struct(
    "Binned",
    {
        "xy": array_of(I32, 6),  # x0 y0 x1 y1 x2 y2, grid units; see the kinds
        "id": I32,  # primitive id
        "kind": I32,
        "dx": F64,  # change of 1/z per column
        "dy": F64,  # change of 1/z per row
        "base": F64,  # 1/z at the first pixel centre of the bounding box
        "low": F32,  # range of 1/z over the primitive, so that slivers never extrapolate
        "high": F32,
    },
)
TRIANGLE: Final = 0
CLIPPED_TRIANGLE: Final = 1
"""Crosses the near plane or leaves the guard band. xy: first column and row of the bounding box, index of the draw."""
LINE: Final = 2
"""xy: both ends, half the width, then first column and row of the bounding box in 16 bits each."""
POINT: Final = 3
"""xy: first column and row, and those after the last; grid units where a pixel has several samples."""
SMALL: Final = 4
"""A SMALL_TRIANGLE."""
DEFERRED: Final = 5
"""A DEFERRED_BACKS."""

SMALL_TRIANGLE: Final = Struct(
    "SmallTriangle",
    {
        "edges": array_of(I32, 3),  # edge functions at the first pixel centre of the box; inside where all are >= 0
        "right": array_of(I32, 2),  # change per column of the first two; those of the third are minus their sum
        "down": I32,  # change per row of the first
        "id": I32,
        "kind": I32,
        "down_second": I32,  # change per row of the second
        "box": I32,  # row (high half) and column (low half, signed) of the box's corner, perhaps outside the image
        "size": I32,  # rows (high half) and columns (low half)
        "base": F32,  # as in BINNED
        "dx": F32,
        "dy": F32,
        "low": F32,
        "high": F32,
    },
)
DEFERRED_BACKS: Final = Struct(
    "DeferredBacks",
    {
        "first": I32,  # primitive of its draw
        "lanes": I32,  # mask of the eight primitives from there on
        "draw": I32,
        "_unused": array_of(I32, 3),
        "id": I32,
        "kind": I32,
        "_unused2": I32,
        "box": I32,  # bounding box of all, as in SMALL_TRIANGLE
        "size": I32,
        "_unused3": array_of(I32, 4),
        "high": F32,  # greatest 1/z of all
    },
)
"""Up to eight neighbouring back faces that are kept apart. Nearly all are hidden; the others are set up when their band
is drawn."""

DEFERRED_SETUP: Final = Struct(
    "DeferredSetup",
    {
        "group": I64,  # address of a DEFERRED_BACKS
        "memory": SETUP_MEMORY,
        "pixels": pointer_to(I32),  # (8 * TINY * TINY, 4) as FRAME.tiny_pixels
        "count": I64,  # results: primitives, pixels
        "pixel_count": I64,
    },
)
"""A request to ``setup`` for one group of deferred back faces."""

frame_at: Final = FRAME.at
task_at: Final = TASK.at
binned_at: Final = BINNED.at
small_at: Final = SMALL_TRIANGLE.at
deferred_at: Final = DEFERRED_BACKS.at
