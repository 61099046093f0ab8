"""Triangles of a few pixels, rasterized eight at a time in setup: a Chunk gets their pixels instead of primitives.

A million triangles at 640 x 480 take nearly half as long again without.
"""

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.kernel_types import I64, f32
from renderers.compiler.simd import F32x8, I32x8, Mask8
from renderers.raster.grid import Box
from renderers.raster.layout import KEPT_BACK_BIT, MAX_TINY_FRAGMENTS, TINY_SIDE, Chunk, RasterFrame
from renderers.raster.triangle_geometry import EightTriangles


@inlined
def can_rasterize_tiny(frame: RasterFrame, chunk: Chunk) -> bool:
    """Return whether a Chunk has room for the pixels of eight tiny triangles, and pixels have one sample."""
    return frame.sample_count == 1 and chunk.fragment_count <= MAX_TINY_FRAGMENTS - vec.LANES * TINY_SIDE * TINY_SIDE


@inlined
def is_tiny(frame: RasterFrame, box: Box[I32x8]) -> Mask8:
    """Return which Boxes have at most TINY_SIDE x TINY_SIDE pixels, all in the image."""
    zero, side = vec.i32(0), vec.i32(TINY_SIDE)
    tiny = (box.right - box.left <= side) & (box.bottom - box.top <= side)
    tiny = tiny & (box.left >= zero) & (box.right <= vec.i32(frame.width))
    return tiny & (box.top >= zero) & (box.bottom <= vec.i32(frame.height))


@inlined
def rasterize_tiny(frame: RasterFrame, triangles: EightTriangles, tiny: Mask8, kept_back: Mask8, chunk: Chunk) -> None:
    """Append the pixels of the triangles ``tiny``, at most TINY_SIDE x TINY_SIDE of each, to a Chunk.

    Pixels of those that are culled but kept, ``kept_back``, get KEPT_BACK_BIT.
    """
    ids, box, edges, plane = triangles
    first_pixel = box.top * vec.i32(frame.stride) + box.left
    first_pixel = vec.select(kept_back, first_pixel | vec.i32(KEPT_BACK_BIT), first_pixel)
    # All eight are tested at the same 3 x 3 pixels, or 4 x 4 if any is that wide: surplus tests, which cover nothing,
    # cost less than one mispredicted loop.
    usual_side = vec.i32(TINY_SIDE - 1)
    is_wide = (box.right - box.left > usual_side) | (box.bottom - box.top > usual_side)
    side = TINY_SIDE if vec.movemask(tiny & is_wide) != 0 else TINY_SIDE - 1
    count = chunk.fragment_count
    row_e0, row_e1, row_e2 = edges.base
    for row in range(side):
        row_inv_z = plane.base + plane.dy * vec.f32(f32(row))
        e0, e1, e2 = row_e0, row_e1, row_e2
        for column in range(side):
            inv_z = row_inv_z + plane.dx * vec.f32(f32(column))
            inv_z = vec.minimum(vec.maximum(inv_z, plane.min), plane.max)
            covered = tiny & ((e0 | e1 | e2) >= vec.i32(0))
            pixels = first_pixel + vec.i32(row * frame.stride + column)  # KEPT_BACK_BIT stays
            count = _append_pixels(chunk, count, covered, pixels, inv_z, ids)
            e0, e1, e2 = e0 + edges.dx[0], e1 + edges.dx[1], e2 + edges.dx[2]
        row_e0, row_e1, row_e2 = row_e0 + edges.dy[0], row_e1 + edges.dy[1], row_e2 + edges.dy[2]
    chunk.fragment_count = count


@inlined
def _append_pixels(chunk: Chunk, count: I64, covered: Mask8, pixels: I32x8, inv_z: F32x8, ids: I32x8) -> I64:
    """Append one pixel of each covered triangle to a Chunk that has ``count``; return the new ``count``.

    Without a branch, since coverage cannot be predicted. Up to seven values beyond the last are overwritten.
    """
    vec.store(chunk.fragment_pixels, count, vec.compress(covered, pixels))
    vec.store(chunk.fragment_inv_z, count, vec.compress(covered, inv_z))
    vec.store(chunk.fragment_ids, count, vec.compress(covered, ids))
    return count + vec.count_bits(vec.movemask(covered))
