"""The fixed-point grid of 1/256 pixel that vertices are snapped to, and boxes of pixels on it."""

from typing import Generic, NamedTuple, TypeVar

import numpy as np

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import F32, I64, f32, i64
from renderers.compiler.simd import I32x8
from renderers.raster.layout import HALF_PIXEL, SUBPIXEL, SUBPIXEL_BITS, RasterFrame, SmallTriangle

N = TypeVar("N", I64, I32x8)


class Box(NamedTuple, Generic[N]):
    """Pixels whose centre, or one of whose samples, may be covered: int64, or i32x8 for eight triangles."""

    left: N
    """First column."""
    top: N
    """First row."""
    right: N
    """One past the last column."""
    bottom: N
    """One past the last row."""


@device_function
def snap_to_grid(value: F32) -> I64:
    """Return the grid coordinate of a value in pixels. The product is exact; ties round to even."""
    return i64(np.rint(f32(value) * f32(SUBPIXEL)))


@device_function
def first_center(value: I64) -> I64:
    """Return the first pixel whose centre is at or after a grid coordinate: ceil((value - 1/2 px) / 1 px)."""
    return (value - HALF_PIXEL + SUBPIXEL - 1) >> SUBPIXEL_BITS


@inlined
def pixel_box(frame: RasterFrame, min_x: I64, min_y: I64, max_x: I64, max_y: I64, reach: I64) -> Box[I64]:
    """Return the Box of pixels in the image that what lies between two grid points may cover.

    ``reach`` is the distance from a pixel's centre to its outermost sample, plus what a primitive is widened by, grid
    units.
    """
    return Box(
        left=max(first_center(min_x - reach), 0),
        top=max(first_center(min_y - reach), 0),
        right=min(first_center(max_x + reach), frame.width),
        bottom=min(first_center(max_y + reach), frame.height),
    )


@inlined
def is_empty(box: Box[I64]) -> bool:
    """Return whether a Box has no pixels."""
    return box.left >= box.right or box.top >= box.bottom


@inlined
def box_of(triangle: SmallTriangle) -> Box[I64]:
    """Return the Box of a SmallTriangle, perhaps off the image. The high halves of its packed fields are for rows."""
    packed_origin, packed_size = i64(triangle.box_origin), i64(triangle.box_size)
    left, top = ((packed_origin & 0xFFFF) ^ 0x8000) - 0x8000, packed_origin >> 16  # both signed
    return Box(left, top, left + (packed_size & 0xFFFF), top + (packed_size >> 16))
