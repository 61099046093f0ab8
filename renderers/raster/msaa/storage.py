"""Storage of a band's samples, and the depth test of primitives against it.

Most pixels see one primitive with all samples. Of those, only the index of the primitive (the pixel's *owner*)
and a range of 1/z are stored. A pixel at an edge gets a slot, where each sample has its own primitive id and 1/z.
"""

from typing import Final, TypeVar

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import F32, F64, I64, f32, f64, i64
from renderers.compiler.pointers import address, as_i32
from renderers.compiler.simd import F32x8, I32x8, Mask8
from renderers.msaa import SampleBand
from renderers.raster.fill import inv_z_origin
from renderers.raster.grid import box_of
from renderers.raster.layout import KIND_SMALL, SUBPIXEL, Primitive, RasterFrame, SmallTriangle

MIXED: Final = -2
"""Owner of a pixel whose samples have primitives of their own, in its slot."""
AnyPrimitive = TypeVar("AnyPrimitive", Primitive, SmallTriangle)


@inlined
def sample_inv_z_offsets(frame: RasterFrame, inv_z_dx: F64, inv_z_dy: F64) -> F32x8:
    """Return 1/z at the samples minus 1/z at the pixel's centre."""
    offsets, pixel = frame.sample_offsets, vec.f32(1.0 / SUBPIXEL)
    x, y = vec.to_f32(vec.load(offsets, 0)) * pixel, vec.to_f32(vec.load(offsets, vec.LANES)) * pixel
    return vec.f32(inv_z_dx) * x + vec.f32(inv_z_dy) * y


@inlined
def max_inv_z_offset(frame: RasterFrame, inv_z_dx: F64, inv_z_dy: F64) -> F32:
    """Return an upper limit of the absolute values of ``sample_inv_z_offsets``; infinite if not finite."""
    reach = f32(frame.sample_reach) * f32(1.0 / SUBPIXEL)
    # Rounded as the sums at the samples are, none of which is farther out.
    limit = abs(f32(inv_z_dx)) * reach + abs(f32(inv_z_dy)) * reach
    return limit if limit < np.inf else f32(np.inf)


@inlined
def merge_whole_pixels(
    band: SampleBand,
    pixel: I64,
    inv_z: F32x8,
    max_offset: F32x8,
    primitive: AnyPrimitive,
    owner: I64,
    full: Mask8,
    touched: Mask8,
) -> I64:
    """Draw a primitive into eight pixels; return the mask of those whose samples must be tested one by one.

    It takes pixels that it covers wholly and in front of everything. Pixels in which it is hidden are skipped.

    Args:
        inv_z: 1/z at the centres before it is clamped to the primitive's range.
        max_offset: from ``max_inv_z_offset``.
        full, touched: pixels of which all samples are covered, and some may be.
    """
    # NaN is never in front of everything; on the near side it counts as ``inv_z_min``, as for clamped samples.
    far = vec.minimum(vec.f32(primitive.inv_z_max), inv_z - max_offset)
    near = vec.maximum(inv_z + max_offset, vec.f32(primitive.inv_z_min))
    old_far, old_near = vec.load_volatile(band.far, pixel), vec.load_volatile(band.near, pixel)
    old_ids, old_owners = vec.load_volatile(band.ids, pixel), vec.load_volatile(band.owners, pixel)
    is_whole = full & (far > old_near)
    needs_test = touched & (near >= old_far) & ~is_whole  # at the same 1/z ids decide
    vec.store(band.far, pixel, vec.select(is_whole, far, old_far))
    vec.store(band.near, pixel, vec.select(is_whole | needs_test, vec.maximum(near, old_near), old_near))
    vec.store(band.ids, pixel, vec.select(is_whole, vec.i32(primitive.id), old_ids))
    vec.store(band.owners, pixel, vec.select(is_whole, vec.i32(owner), old_owners))
    return vec.movemask(needs_test)


@device_function
def _write_owner_samples(frame: RasterFrame, band: SampleBand, pixel: I64, first_sample: I64, owner: I64) -> None:
    """Write the samples of a pixel's owner to the pixel's slot, from ``first_sample`` on."""
    row = pixel // frame.stride
    x, y = pixel - row * frame.stride, band.first_row + row
    primitive = frame.primitives[owner]
    if primitive.kind == KIND_SMALL:
        small = SmallTriangle(address(primitive))
        base_x, base_y, _, _ = box_of(small)
        row_inv_z = small.inv_z_base + small.inv_z_dy * f32(y - base_y)
        center = vec.f32(row_inv_z + small.inv_z_dx * f32(x - base_x))
        inv_z = center + sample_inv_z_offsets(frame, small.inv_z_dx, small.inv_z_dy)
    else:
        base = inv_z_origin(primitive)
        exact_row_inv_z = primitive.inv_z_base + primitive.inv_z_dy * f64(y - base.y)
        center = vec.f32(exact_row_inv_z + primitive.inv_z_dx * f64(x - base.x))
        inv_z = center + sample_inv_z_offsets(frame, primitive.inv_z_dx, primitive.inv_z_dy)
    vec.store(band.sample_ids, first_sample, vec.i32(primitive.id))
    inv_z = vec.minimum(vec.maximum(inv_z, vec.f32(primitive.inv_z_min)), vec.f32(primitive.inv_z_max))
    vec.store(band.sample_inv_z, first_sample, inv_z)


@inlined
def _open_slot(frame: RasterFrame, band: SampleBand, slot_count: I64, pixel: I64) -> tuple[I64, I64, I64]:
    """Give a pixel a slot if it has none, and make it MIXED.

    Return the index of the pixel's first sample, its owner before, and the new ``slot_count``.
    """
    slot = i64(band.slots[pixel])
    is_new = slot < 0
    slot = slot_count if is_new else slot
    band.slots[pixel] = slot
    owner = i64(band.owners[pixel])
    if owner >= 0:
        _write_owner_samples(frame, band, pixel, vec.LANES * slot, owner)
    band.owners[pixel] = MIXED
    return vec.LANES * slot, owner, slot_count + is_new


@inlined
def merge_samples(
    frame: RasterFrame, band: SampleBand, slot_count: I64, pixel: I64, inv_z: F32x8, covered: Mask8, ids: I32x8
) -> I64:
    """Write those of a pixel's covered samples that are not behind what is stored; return the number of slots in use.

    Without a branch: which samples are, and whether the pixel was empty, cannot be predicted.
    """
    first, owner, slot_count = _open_slot(frame, band, slot_count, pixel)
    # An empty pixel's far limit is its 1/z.
    is_empty = vec.i32(owner) == vec.i32(-1)
    old_inv_z = vec.select(is_empty, vec.f32(band.far[pixel]), vec.load_volatile(band.sample_inv_z, first))
    old_ids = vec.select(is_empty, vec.i32(-1), vec.load_volatile(band.sample_ids, first))
    passed = covered & ((inv_z > old_inv_z) | ((inv_z == old_inv_z) & (ids > old_ids)))
    inv_z = vec.select(passed, inv_z, old_inv_z)
    vec.store(band.sample_inv_z, first, inv_z)
    vec.store(band.sample_ids, first, vec.select(passed, ids, old_ids))
    # Bits are ordered as the values are: none is negative.
    as_i32(band.far)[pixel] = vec.minimum_of(vec.float_bits(inv_z))
    return slot_count
