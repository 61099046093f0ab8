"""Structs that the rasterizer's kernels share, and the constants of its fixed-point grid.

RasterFrame ─┬─ RasterInstance    an instance of the draw list, without its pose
             ├─ Draw              an instance that is drawn in this frame
             ├─ Chunk ─ Primitive or SmallTriangle    1,024 of them, with the bins that each touches
             └─ Layer             visibility buffer: primitive id and 1/z of each pixel
"""

from typing import Final

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import F32, F64, I32, I64, U32, Address, Pointer
from renderers.compiler.pointers import advance, f32_at, i32_at
from renderers.compiler.structs import Struct, inline
from renderers.visibility_buffer import BAND_ROWS

SUBPIXEL_BITS: Final = 8
SUBPIXEL: Final = 1 << SUBPIXEL_BITS
"""Grid units per pixel. Vertices are snapped to the grid, as on GPUs; edge functions of snapped vertices are exact."""
HALF_PIXEL: Final = SUBPIXEL // 2
"""Grid units from a pixel's border to its centre."""
GUARD_BAND: Final = 32760.0
"""Maximum distance of a vertex from pixel (0, 0), across and down, pixels; triangles beyond are clipped. So coordinates
are below 2^15 pixels, 2^23 grid units, exact in float32. Edge functions are below 2^50, exact in float64."""
BEFORE_NEAR_PLANE: Final = -2.0
"""In place of 1/z of a vertex that is nearer than the near plane, or whose z is not a number."""
OUTSIDE_GUARD_BAND: Final = -1.0
"""In place of 1/z of a vertex that is outside the guard band, or whose x or y is not a number. It lies between
BEFORE_NEAR_PLANE and every 1/z, so that the minimum and the maximum over a triangle tell what it needs."""
MAX_SIDE: Final = 16384
"""Maximum image width and height, pixels: half of the guard band, which leaves room around the image."""
MAX_POINT_SIZE: Final = 1024
"""Maximum point size and line width, pixels; larger ones are drawn with this."""

CHUNK_SIZE: Final = 1024
"""Maximum number of primitives of a chunk. It does not depend on the number of threads, and so neither does the drawing
order."""
TINY_SIDE: Final = 4
"""Triangles of at most TINY_SIDE x TINY_SIDE pixel centres are rasterized in setup. It keeps their fragments: a pixel
with its 1/z and primitive id."""
MAX_TINY_FRAGMENTS: Final = 4 * CHUNK_SIZE
"""Maximum fragments of a chunk's tiny triangles. When there is no more room, they become small triangles."""
KEPT_BACK_BIT: Final = -(1 << 31)
"""Set in the ``Chunk.fragment_pixels`` of back faces that are kept."""
FRAGMENT_CAPACITY: Final = MAX_TINY_FRAGMENTS + 8
"""Fragments that a chunk has memory for. Whole vectors are stored, up to seven values beyond the last fragment."""
CHUNK_WORDS: Final = CHUNK_SIZE + 3 * FRAGMENT_CAPACITY
"""Words of four bytes of a chunk's memory: its ranges of bins, then its fragments' pixels, 1/z and ids."""
MAX_SMALL_WIDTH: Final = 64
MAX_SMALL_HEIGHT: Final = 128
"""Maximum pixel centres of a small triangle across and down: it spans less than 65 x 129 pixels. So its edge functions
fit int32, also eight columns (``msaa``) and seven rows (``small_triangles``) off its box. An edge function is the
difference of two products of a width and a height, grid units: 2 x (256 x (65 + 8)) x (256 x (129 + 7)) < 2^31."""
MAX_SMALL_DEPTH_RATIO: Final = 4.0
"""Maximum ratio of farthest to nearest vertex depth of a small triangle. Beyond, float32 would lose digits of 1/z at
the far end, and float64 is used."""

# Values of ``vertices_per_primitive``; points have 1.
LINE_VERTICES: Final = 2
TRIANGLE_VERTICES: Final = 3

# Kinds of Primitive. Each says what its ``geometry`` is, and which pixel is its origin. There, 1/z is ``inv_z_base``.
KIND_TRIANGLE: Final = 0
"""geometry: x0 y0 x1 y1 x2 y2 of the corners, clockwise on screen, grid units. Origin: the first column and the first
row whose pixel centres are not before the leftmost and the topmost corner; it may be off the image."""
KIND_CLIPPED: Final = 1
"""A triangle that crosses the near plane or leaves the guard band. geometry: column and row of the origin; index of the
draw. Origin: the first pixel of the triangle's box in the image."""
KIND_LINE: Final = 2
"""geometry: x0 y0 x1 y1 of the ends, and half the width, grid units; then the origin, packed as row << 16 | column.
Origin: the first pixel of the line's box in the image."""
KIND_POINT: Final = 3
"""geometry: left, top, right and bottom of its square. With several samples per pixel, these are grid units; with one,
columns and rows of the image, right and bottom excluded. Origin: any pixel, since 1/z is constant."""
KIND_SMALL: Final = 4
"""The struct is a SmallTriangle, which has the same size, and ``id`` and ``kind`` at the same place."""


class Primitive(Struct):
    geometry: Pointer[I32] = inline(6)  # see the kinds
    id: I32  # primitive id
    kind: I32
    inv_z_dx: F64  # change of 1/z per column
    inv_z_dy: F64  # change of 1/z per row
    inv_z_base: F64  # 1/z at the centre of the origin, see the kinds and ``fill.inv_z_origin``
    inv_z_min: F32  # range of 1/z over the primitive; clamping to it keeps slivers from extrapolating
    inv_z_max: F32


class SmallTriangle(Struct):
    """Sixteen words: a vector up to ``kind``, and another one (see ``small_triangles``). Primitive has ``id`` and
    ``kind`` at the same places. The changes of the third edge are not stored, since those of all three sum to 0."""

    edge_base: Pointer[I32] = inline(3)  # edge functions at the box's first pixel centre; inside where all are >= 0
    edge_dx: Pointer[I32] = inline(2)  # change per column of the first two
    edge0_dy: I32  # change per row of the first
    id: I32
    kind: I32
    edge1_dy: I32  # change per row of the second
    box_origin: I32  # packed column and row of the box's first pixel: see grid.box_of
    box_size: I32  # packed likewise: numbers of columns and rows
    inv_z_base: F32  # at the box's first pixel centre; this and the rest are as in Primitive
    inv_z_dx: F32
    inv_z_dy: F32
    inv_z_min: F32
    inv_z_max: F32


SMALL_FIELD_INDEX: Final = SmallTriangle.places(4)
"""Index of each field in the struct as int32 values; of ``edge_base`` and ``edge_dx``, that of the first value."""
SMALL_FIELD_COUNT: Final = SmallTriangle.nbytes // 4


class RasterInstance(Struct):
    """An instance of the draw list, independent of camera and pose. The table ends with one more row, in which
    ``first_vertex`` and ``first_id`` are the totals."""

    positions: Pointer[F32]  # (N, 3): the vertices of mesh_positions that primitives use; others need no transform
    indices: Pointer[U32]  # (M, vertices_per_primitive) into these
    vertices_per_primitive: I64  # a value of drawlist.Topology
    first_vertex: I64  # among all instances' vertices
    first_id: I64  # primitive id of its first primitive
    point_or_line_size: F64  # point size or line width, pixels
    box_center: Pointer[F64] = inline(3)  # of convex meshes, see convex_culling
    box_half_extents: Pointer[F64] = inline(3)  # negative: not convex
    mesh_positions: Pointer[F32]  # the mesh's own arrays, which mesh_normals goes with
    mesh_indices: Pointer[U32]
    mesh_normals: Address  # (N, 3) float32; 0: none


class Draw(Struct):
    """An instance that is drawn in a frame. The table ends with one more row for the totals."""

    positions: Pointer[F32]  # as in RasterInstance
    indices: Pointer[U32]
    vertices_per_primitive: I64
    point_or_line_size: F64
    first_vertex: I64  # among the drawn vertices
    first_frame_primitive: I64  # index of its first primitive among those drawn in the frame
    first_id: I64  # primitive id of its first primitive
    culled_area_sign: I64  # sign of the area of culled faces, kept or not: 1 clockwise, -1 counter-clockwise; 0: none
    hidden_area_sign: I64  # likewise of back faces of a convex mesh, which its front faces hide
    X_camera_mesh: Pointer[F64] = inline(12)  # the first three rows


class Chunk(Struct):
    """Primitives that are set up together, and searched by each band that they touch.

    A bin is only a number that a band looks for in ``bin_ranges``. Band ``k`` looks for ``k``, and after shading for
    ``RasterFrame.first_back_bin + k``: for the back faces that are kept, which colour does not show."""

    primitives: Primitive  # (CHUNK_SIZE,): those that may be visible, in the order of their ids
    bin_ranges: Pointer[I32]  # (CHUNK_SIZE,): last << 16 | first bin that each of them touches
    primitive_count: I64
    fragment_pixels: Pointer[I32]  # (FRAGMENT_CAPACITY,): row * stride + column; kept back faces have KEPT_BACK_BIT set
    fragment_inv_z: Pointer[F32]
    fragment_ids: Pointer[I32]
    fragment_count: I64
    first_band: I64  # bands that primitives and fragments touch; last_band < first_band: none
    last_band: I64


# Phases of a frame, see ``frame_phases``.
TRANSFORM: Final = 0
SETUP: Final = 1
BANDS: Final = 2
PHASE_COUNT: Final = 3
# Passes over a band, see ``coverage.draw_band``.
COLOR_FACES: Final = 0
"""All faces but kept back faces: what colour images show. The layer is cleared first."""
KEPT_BACK_FACES: Final = 1
"""Back faces that are kept, drawn on top of the layer."""


class RasterFrame(Struct):
    """A rasterization: its parameters, the memory that it works in, and its units of work, which threads share.

    ``frame.FrameJob`` fills the fields before ``draw_count``, the kernels those from it on. An Address or Pointer is
    0 if the frame has no use for it.
    """

    # Image and camera.
    width: I64  # pixels
    height: I64
    stride: I64  # pixels from one row of a visibility layer to the next: a multiple of eight
    drawn_bands: Pointer[I32]  # (drawn_band_count,): bands that are drawn; 0: all
    drawn_band_count: I64
    fx: F64  # camera intrinsics, pixels
    fy: F64
    cx: F64
    cy: F64
    near: F64  # metres
    inv_z_far: F32  # 1/z at the far plane, 1/m: nothing with less passes the depth test
    X_world_camera: Pointer[F64] = inline(16)

    # Instances of the draw list, instance_count each.
    instance_count: I64
    instances: RasterInstance  # and a row for the totals
    first_ids: Pointer[I64]  # first_id of each, and the total: an array that ``instance_of`` searches
    labels: Pointer[I32]  # bits of uint32 labels
    instance_ids: Pointer[I32]  # values for ``instance_out``
    X_world_mesh: Pointer[F64]  # (4, 4) each
    X_camera_mesh: Pointer[F64]  # (4, 4) each
    is_selected: Address  # bool for each instance: whether to draw it; 0: all are drawn
    cull_back: Address  # bool for each instance: whether its back faces are culled; 0: none are
    skip_hidden_back_faces: I64  # flag: back faces of convex meshes need not be drawn
    keep_back_faces: I64  # flag: culled back faces go to bins of their own, drawn after shading

    # Samples.
    sample_count: I64  # per pixel
    sample_reach: I64  # grid units from a pixel's centre to its outermost sample, each way; 0: one sample
    sample_offsets: Pointer[I32]  # (2, 8): offsets of the samples across and down, grid units
    lanes_of_mask: Pointer[I32]  # (256, 8), see msaa.lanes_of_mask

    # Kernels. With several samples, draw_kernel and shade_kernel take other arguments: see frame_phases.
    transform_kernel: Address
    setup_kernel: Address
    draw_kernel: Address  # coverage.draw_band, or msaa.edges.draw_samples
    edges_kernel: Address  # msaa.edges.find_edges, with several samples per pixel
    shade_kernel: Address  # 0: nothing is shaded
    shade_job: Address  # first argument of shade_kernel
    resolve_kernel: Address  # 0: no outputs other than colour are wanted
    normals_kernel: Address
    yield_function: Address  # called while waiting for other threads

    # Depth peeling: limits for what passes the depth test, (height, stride) each; ids are int32, inv_z float32.
    # near_bound, the layer peeled before: only what is behind it passes, or at its depth with a lower id. Nothing
    # passes where it is empty.
    near_bound_ids: Address
    near_bound_inv_z: Address
    # far_bound, a layer of other instances, such as opaque ones: only what is not behind it passes, whatever its id.
    # Everything passes where it is empty.
    far_bound_ids: Address
    far_bound_inv_z: Address
    id_limits: Address  # only what has an id below these passes
    highest_id_wins: I64  # flag: a pixel sees the fragment drawn last, not the nearest (layers by drawing order)

    # Results. The layer is (height, stride); without it, each thread has a layer of one band.
    layer_ids: Address
    layer_inv_z: Address
    depth_out: Address  # as in interface.Frame; 0: not wanted
    label_out: Address
    instance_out: Address
    normal_out: Address

    # Memory.
    draws: Draw  # (draw_count + 1)
    vertices: Pointer[F32]  # (vertex_count, 4): x and y, pixels; 1/z or a negative constant; a value that is not used
    primitives: Primitive  # (chunk_count * CHUNK_SIZE); those of KIND_SMALL are SmallTriangle
    chunks: Chunk  # (chunk_count)
    chunk_memory: Pointer[I32]  # (chunk_count, CHUNK_WORDS): what their pointers point to
    band_memory_base: Address  # the threads' memory for a band, one after the other
    band_memory_bytes: I64  # of each thread
    max_threads: I64
    stop: Address  # of an int64: not 0 once the frame should end, see renderers.stop. The address is never 0

    # Counts, computed by set_up_frame.
    draw_count: I64
    vertex_count: I64
    primitive_count: I64
    chunk_count: I64
    band_count: I64
    first_back_bin: I64  # bin of the first band's kept back faces; 0: none are kept
    vertices_per_unit: I64
    chunks_per_unit: I64
    unit_counts: Pointer[I64] = inline(PHASE_COUNT)

    # Progress, written while threads work; pointers, as atomic operations need.
    threads_started: Pointer[I64] = inline(1)
    units_taken: Pointer[I64] = inline(PHASE_COUNT)
    units_done: Pointer[I64] = inline(PHASE_COUNT)


class Layer(Struct):
    """A visibility layer, or a band of one: (rows, stride) each, from row ``first_row`` of the image on."""

    ids: Pointer[I32]
    inv_z: Pointer[F32]
    first_row: I64


@inlined
def vertex_of(frame: RasterFrame, draw: Draw, index: I64) -> Pointer[F32]:
    """Return a pointer to a vertex in RasterFrame.vertices; ``index``: a value of ``draw.indices``."""
    return advance(frame.vertices, 4 * (draw.first_vertex + index))


@inlined
def set_band_layer(frame: RasterFrame, layer: Layer, first_row: I64, band_memory: Address) -> None:
    """Set a Layer to that of the band which begins with ``first_row``.

    ``band_memory`` has BAND_ROWS x stride int32, the ids, then as many float32, the 1/z. 0: the layer is the image's.
    """
    if band_memory == 0:
        layer.ids, layer.inv_z, layer.first_row = i32_at(frame.layer_ids), f32_at(frame.layer_inv_z), 0
    else:
        layer.ids, layer.first_row = i32_at(band_memory), first_row
        layer.inv_z = advance(f32_at(band_memory), BAND_ROWS * frame.stride)


@device_function
def draw_of(frame: RasterFrame, index: I64, is_vertex: bool) -> I64:
    """Return the index of the Draw with a vertex (``is_vertex``) or primitive; ``index``: its own among the frame's."""
    low, high = 0, frame.draw_count
    while high - low > 1:  # bisection: the draw is one of low .. high
        middle = (low + high) >> 1
        draw = frame.draws[middle]
        if (draw.first_vertex if is_vertex else draw.first_frame_primitive) <= index:
            low = middle
        else:
            high = middle
    return low
