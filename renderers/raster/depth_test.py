"""Depth test and write of eight pixels: the innermost step of rasterization.

The test is OpenGL's LEQUAL, in the order of the primitives' ids: of two surfaces at the same depth the
later one is seen.
"""

from typing import Final

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import F32, I32, I64, i64
from renderers.compiler.pointers import f32_at, i32_at
from renderers.compiler.simd import F32x8, I32x8, Mask8
from renderers.raster.layout import Layer, RasterFrame

IN_ORDER: Final = 0
"""For primitives drawn in the order of their ids: of two at the same depth the one drawn last is seen."""
PEELED: Final = 1
"""IN_ORDER among what lies between the frame's bounds for depth peeling."""
ANY_ORDER: Final = 2
"""For primitives drawn in any order: of two at the same depth the one with the higher id is seen."""


@device_function
def _is_between(frame: RasterFrame, pixel: I64, inv_z: F32x8, ids: I32x8) -> Mask8:
    """Return which pixels pass the frame's limits for depth peeling, as far as it has them."""
    zero = vec.i32(0)
    passed = zero == zero  # all
    if frame.near_bound_ids != 0:
        layer_ids = vec.load(i32_at(frame.near_bound_ids), pixel)
        layer_inv_z = vec.load(f32_at(frame.near_bound_inv_z), pixel)
        is_behind = (inv_z < layer_inv_z) | ((inv_z == layer_inv_z) & (ids < layer_ids))
        passed = passed & (layer_ids >= zero) & is_behind
    if frame.far_bound_ids != 0:
        layer_ids = vec.load(i32_at(frame.far_bound_ids), pixel)
        layer_inv_z = vec.load(f32_at(frame.far_bound_inv_z), pixel)
        passed = passed & ((layer_ids < zero) | (inv_z >= layer_inv_z))
    if frame.id_limits != 0:
        passed = passed & (ids < vec.load(i32_at(frame.id_limits), pixel))
    return passed


@inlined
def depth_test(
    frame: RasterFrame, layer: Layer, depth_rule: I64, pixel: I64, inv_z: F32x8, covered: Mask8, ids: I32x8
) -> None:
    """Write those of eight pixels that are covered and not behind the layer.

    With the frame's ``highest_id_wins`` the layer's 1/z stays, and higher ids win.

    Args:
        depth_rule: IN_ORDER, PEELED or ANY_ORDER.
        pixel: that of the first one. PEELED needs a layer of the whole image.
    """
    old_inv_z = vec.load_volatile(layer.inv_z, pixel)
    passed = covered & (inv_z >= old_inv_z)
    if depth_rule == ANY_ORDER:
        passed = passed & ((inv_z > old_inv_z) | (ids > vec.load(layer.ids, pixel)))
    if depth_rule == PEELED:
        passed = passed & _is_between(frame, pixel, inv_z, ids)
        if frame.highest_id_wins != 0:
            inv_z = old_inv_z
            passed = passed & (ids > vec.load(layer.ids, pixel))
    vec.store(layer.inv_z, pixel, vec.select(passed, inv_z, old_inv_z))
    vec.store_where(layer.ids, pixel, passed, ids)


@device_function
def depth_test_pixel(
    frame: RasterFrame, layer: Layer, depth_rule: I64, pixel: I64, inv_z: F32, primitive_id: I32
) -> None:
    """Write one covered pixel if it is not behind the layer, as ``depth_test``, in any order of primitives."""
    old_inv_z = layer.inv_z[pixel]
    old_id = layer.ids[pixel]
    # Without a branch: which of two overlapping meshes is nearer cannot be predicted.
    passed = (inv_z > old_inv_z) | ((inv_z == old_inv_z) & (primitive_id > old_id))
    if depth_rule == PEELED:
        passed = passed & (vec.movemask(_is_pixel_between(frame, pixel, inv_z, primitive_id)) != 0)
        if frame.highest_id_wins != 0:
            inv_z = old_inv_z
            passed = passed & (primitive_id > old_id)
    layer.inv_z[pixel] = inv_z if passed else old_inv_z
    layer.ids[pixel] = primitive_id if passed else old_id


@device_function
def _is_pixel_between(frame: RasterFrame, pixel: I64, inv_z: F32, primitive_id: I32) -> Mask8:
    """Return m8: the lane of one pixel, if it passes ``_is_between``.

    The layers are read from the start of the pixel's vector, so not past the image.
    """
    start = pixel & ~i64(vec.LANES - 1)
    lane = vec.iota() == vec.i32(pixel - start)
    return lane & _is_between(frame, start, vec.f32(inv_z), vec.i32(primitive_id))
