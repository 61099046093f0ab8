"""Eight triangles, one per lane: corners, boxes, edge functions and planes of 1/z. In them, ``w`` is 1/z, 1/m."""

from typing import Final, NamedTuple

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.kernel_types import F32, I32, I64, Pointer
from renderers.compiler.pointers import advance, as_u32, stack_array
from renderers.compiler.simd import F32x8, F32x8x3, I32x8, I32x8x3, Lanes, Mask8
from renderers.raster.grid import Box
from renderers.raster.layout import HALF_PIXEL, SUBPIXEL, SUBPIXEL_BITS, Draw, RasterFrame

_CORNERS: Final = 3
_index_array = stack_array(I32, _CORNERS * vec.LANES)


class Edges(NamedTuple):
    """Edge functions of a triangle's three edges, three i32x8 each. A point is covered where all are at least 0.

    That of the edge a -> b at p is (b - a) x (p - a), square grid units. By the top-left rule, points on left and top
    edges are covered, and those on the others, the open edges, are not. The functions are integers, so that those of
    open edges, lowered by one, are at least 0 only inside.
    """

    base: I32x8x3
    """At the first pixel centre of the box."""
    dx: I32x8x3
    """Change per column."""
    dy: I32x8x3
    """Change per row."""


class InvZPlane(NamedTuple):
    """1/z of eight triangles as a function of the pixel, 1/m, f32x8 each. It is linear on the screen."""

    base: F32x8
    """At the first pixel centre of the box."""
    dx: F32x8
    """Change per column."""
    dy: F32x8
    """Change per row."""
    min: F32x8
    """Minimum over the vertices: clamping to the range keeps slivers from extrapolating."""
    max: F32x8


class Corners(NamedTuple):
    """The three corners of eight triangles."""

    x: F32x8x3
    """Pixels."""
    y: F32x8x3
    inv_z: F32x8x3
    """1/z, or BEFORE_NEAR_PLANE or OUTSIDE_GUARD_BAND."""


class EightTriangles(NamedTuple):
    """Edges and depth planes of eight triangles, from which coverage and depth are computed."""

    ids: I32x8
    """Primitive ids."""
    box: Box[I32x8]
    edges: Edges
    plane: InvZPlane


@inlined
def load_triangles(draw: Draw, first: I64, count: I64, vertices: Pointer[F32]) -> Corners:
    """Return the corners of ``count`` triangles from the mesh's ``first`` on; further lanes repeat the last one."""
    indices = advance(draw.indices, _CORNERS * first)
    if count < vec.LANES:
        padded = as_u32(_index_array())
        for k in range(vec.LANES):
            for corner in range(_CORNERS):
                padded[_CORNERS * k + corner] = indices[_CORNERS * min(k, count - 1) + corner]
        indices = padded
    x0, y0, w0 = vec.load_corners(vertices, indices, 0)
    x1, y1, w1 = vec.load_corners(vertices, indices, 1)
    x2, y2, w2 = vec.load_corners(vertices, indices, 2)
    return Corners((x0, x1, x2), (y0, y1, y2), (w0, w1, w2))


@inlined
def minimum_of_3(a: tuple[Lanes, Lanes, Lanes]) -> Lanes:
    """Return the minimum of three vectors, lane by lane."""
    return vec.minimum(vec.minimum(a[0], a[1]), a[2])


@inlined
def maximum_of_3(a: tuple[Lanes, Lanes, Lanes]) -> Lanes:
    """Return the maximum of three vectors, lane by lane."""
    return vec.maximum(vec.maximum(a[0], a[1]), a[2])


@inlined
def snap_to_grid_3(a: F32x8x3) -> I32x8x3:
    """Return the grid coordinates of values in pixels, as ``grid.snap_to_grid``."""
    scale = vec.f32(float(SUBPIXEL))  # grid units per pixel
    return vec.to_i32(vec.rint(a[0] * scale)), vec.to_i32(vec.rint(a[1] * scale)), vec.to_i32(vec.rint(a[2] * scale))


@inlined
def bounding_box(gx: I32x8x3, gy: I32x8x3, reach: I64) -> Box[I32x8]:
    """Return the Box of corners on the grid, perhaps off the image; ``reach``: as RasterFrame.sample_reach."""
    subpixel_bits = vec.i32(SUBPIXEL_BITS)
    # Same rule as grid.pixel_box: left = first_center(minimum - reach), right = first_center(maximum + reach), where
    # first_center(value) = (value + SUBPIXEL - 1 - HALF_PIXEL) >> SUBPIXEL_BITS is the first centre at or after value.
    # A centre on the right or bottom edge is not covered, since these are open: the first one is one past the last.
    low_bias, high_bias = vec.i32(SUBPIXEL - 1 - HALF_PIXEL - reach), vec.i32(SUBPIXEL - 1 - HALF_PIXEL + reach)
    return Box(
        left=(minimum_of_3(gx) + low_bias) >> subpixel_bits,
        top=(minimum_of_3(gy) + low_bias) >> subpixel_bits,
        right=(maximum_of_3(gx) + high_bias) >> subpixel_bits,
        bottom=(maximum_of_3(gy) + high_bias) >> subpixel_bits,
    )


@inlined
def overlaps_image(frame: RasterFrame, box: Box[I32x8]) -> Mask8:
    """Return which Boxes have any pixel in the image."""
    zero = vec.i32(0)
    has_columns = vec.maximum(box.left, zero) < vec.minimum(box.right, vec.i32(frame.width))
    return has_columns & (vec.maximum(box.top, zero) < vec.minimum(box.bottom, vec.i32(frame.height)))


@inlined
def _edge_function(xa: I32x8, ya: I32x8, xb: I32x8, yb: I32x8, px: I32x8, py: I32x8) -> I32x8x3:
    """Return the edge function of (xa, ya) -> (xb, yb) at the grid point (px, py), and its changes per column and row.

    All are i32x8, in grid units and their squares. Edges that are neither left nor top are open. Of clockwise
    triangles, left edges run upwards and top edges to the right.
    """
    zero, one, subpixel_bits = vec.i32(0), vec.i32(1), vec.i32(SUBPIXEL_BITS)
    edge_x = xb - xa
    edge_y = yb - ya
    closed = (edge_y < zero) | ((edge_y == zero) & (edge_x > zero))
    value = edge_x * (py - ya) - edge_y * (px - xa)
    return vec.select(closed, value, value - one), zero - (edge_y << subpixel_bits), edge_x << subpixel_bits


@inlined
def edge_functions(gx: I32x8x3, gy: I32x8x3, box: Box[I32x8]) -> Edges:
    """Return the Edges of clockwise triangles with corners on the grid.

    Valid for boxes of at most MAX_SMALL_WIDTH x MAX_SMALL_HEIGHT. Of others they have wrapped around, and
    ``triangle_setup`` does not use them.
    """
    subpixel_bits, half = vec.i32(SUBPIXEL_BITS), vec.i32(HALF_PIXEL)
    px, py = (box.left << subpixel_bits) + half, (box.top << subpixel_bits) + half
    e0, dx0, dy0 = _edge_function(gx[0], gy[0], gx[1], gy[1], px, py)
    e1, dx1, dy1 = _edge_function(gx[1], gy[1], gx[2], gy[2], px, py)
    e2, dx2, dy2 = _edge_function(gx[2], gy[2], gx[0], gy[0], px, py)
    return Edges(base=(e0, e1, e2), dx=(dx0, dx1, dx2), dy=(dy0, dy1, dy2))


@inlined
def inv_z_plane(corners: Corners, box: Box[I32x8]) -> InvZPlane:
    """Return the InvZPlane through the vertices before snapping; the same for both windings.

    Along both edges from corner 0, dw = dx edge_x + dy edge_y: two equations, solved by Cramer's rule. Coverage is that
    of the snapped vertices, so that 1/z of a covered pixel may be extrapolated a little: see ``InvZPlane.min``.
    """
    x, y, w = corners
    ax, ay, aw = vec.to_f64(x[0]), vec.to_f64(y[0]), vec.to_f64(w[0])
    edge1_x, edge1_y, edge1_w = vec.to_f64(x[1]) - ax, vec.to_f64(y[1]) - ay, vec.to_f64(w[1]) - aw
    edge2_x, edge2_y, edge2_w = vec.to_f64(x[2]) - ax, vec.to_f64(y[2]) - ay, vec.to_f64(w[2]) - aw
    determinant = edge1_x * edge2_y - edge2_x * edge1_y
    zero, half = vec.f64(0.0), vec.f64(0.5)
    is_flat = determinant == zero
    inverse = vec.f64(1.0) / vec.select(is_flat, vec.f64(1.0), determinant)
    dx = vec.select(is_flat, zero, (edge1_w * edge2_y - edge2_w * edge1_y) * inverse)
    dy = vec.select(is_flat, zero, (edge2_w * edge1_x - edge1_w * edge2_x) * inverse)
    base = aw + (dx * (vec.to_f64(box.left) + half - ax) + dy * (vec.to_f64(box.top) + half - ay))
    return InvZPlane(
        base=vec.to_f32(base), dx=vec.to_f32(dx), dy=vec.to_f32(dy), min=minimum_of_3(w), max=maximum_of_3(w)
    )
