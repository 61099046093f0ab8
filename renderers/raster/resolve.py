"""The outputs of a band from its visibility layer: depth, label and instance; ``resolve_normals`` has the normals.

    primitive id of a pixel ──▶ instance ──▶ its label, its instance_id    1/z ──▶ depth, infinite where nothing is seen

Eight pixels at a time. Most see the same instance as the pixels before. So their ids are compared with its range of ids
first, and only others are searched.
"""

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import call_kernel
from renderers.compiler.kernel_types import F32, I32, I64, Address, Number, Pointer, i32, i64
from renderers.compiler.pointers import advance, f32_at, i32_at
from renderers.compiler.simd import Lanes
from renderers.drawlist import LABEL_NONE
from renderers.primitive_ids import instance_of
from renderers.raster.layout import Layer, RasterFrame, set_band_layer

_BACKGROUND_INSTANCE_ID: Final = -1
_PREFETCH_DISTANCE: Final = 1024
"""Values by which a prefetch is ahead of the store: 4 KiB. A store to a line that is not in the cache waits for the
line. Processors fetch lines ahead by themselves, but only within a page of 4 KiB."""


@kernel
def resolve_band(frame_address: Address, first_row: I64, end_row: I64, band_memory: Address) -> None:
    """Write the wanted outputs of a band."""
    frame, layer = RasterFrame(frame_address), Layer()
    set_band_layer(frame, layer, first_row, band_memory)
    for row in range(first_row, end_row):
        layer_row_start, out_row_start = (row - layer.first_row) * frame.stride, row * frame.width
        row_ids, row_inv_z = advance(layer.ids, layer_row_start), advance(layer.inv_z, layer_row_start)
        # The whole row of one output, then that of the next: the stores to a cache line follow each other.
        if frame.depth_out != 0:
            _resolve_depth_row(row_inv_z, row_ids, advance(f32_at(frame.depth_out), out_row_start), frame.width)
        if frame.label_out != 0:
            out = advance(i32_at(frame.label_out), out_row_start)
            _resolve_instance_row(frame, row_ids, frame.labels, LABEL_NONE, out)
        if frame.instance_out != 0:
            out = advance(i32_at(frame.instance_out), out_row_start)
            _resolve_instance_row(frame, row_ids, frame.instance_ids, _BACKGROUND_INSTANCE_ID, out)
    if frame.normal_out != 0:  # a kernel by address, to keep its compilation out of start-up
        call_kernel(frame.normals_kernel, (frame_address, first_row, end_row, band_memory))


@device_function
def _resolve_depth_row(row_inv_z: Pointer[F32], row_ids: Pointer[I32], out: Pointer[F32], width: I64) -> None:
    """Write the depths of a row, whose pixels are readable to a multiple of eight."""
    one, no_depth, zero = vec.f32(1.0), vec.f32(np.inf), vec.i32(0)
    for column in range(0, width, vec.LANES):
        visible = vec.load(row_ids, column) >= zero
        _store_columns(out, column, width, vec.select(visible, one / vec.load(row_inv_z, column), no_depth))


@inlined
def _store_columns(out: Pointer[Number], column: I64, width: I64, values: Lanes) -> None:
    """Write eight values of a row, or those before its end."""
    if column + vec.LANES <= width:
        vec.prefetch(out, column + _PREFETCH_DISTANCE)  # harmless past the output's end
        vec.store(out, column, values)
    else:
        for k in range(width - column):
            out[column + k] = vec.lane(values, k)


@device_function
def _resolve_instance_row(
    frame: RasterFrame, row_ids: Pointer[I32], instance_values: Pointer[I32], background: I64, out: Pointer[I32]
) -> None:
    """Write the value, such as the label, of the instance that each pixel of a row sees, or the background's."""
    first_ids, width = frame.first_ids, frame.width
    # The instance looked up last, its value and its range of primitive ids, which is empty at first.
    cached_index, cached_value, cached_first_id, cached_end_id = i64(0), i32(0), i64(0), i64(0)
    for column in range(0, width, vec.LANES):
        ids = vec.load(row_ids, column)
        sees_cached = (ids >= vec.i32(cached_first_id)) & (ids < vec.i32(cached_end_id))
        values = vec.select(sees_cached, vec.i32(cached_value), vec.i32(background))
        pending = vec.movemask((ids >= vec.i32(0)) & ~sees_cached)
        while pending != 0:  # look up the instance of the first pixel left, for all pixels that see it
            primitive_id = i64(row_ids[column + vec.lowest_bit(pending)])
            cached_index = instance_of(first_ids, frame.instance_count, primitive_id, cached_index)
            cached_value = instance_values[cached_index]
            cached_first_id, cached_end_id = first_ids[cached_index], first_ids[cached_index + 1]
            sees_cached = (ids >= vec.i32(cached_first_id)) & (ids < vec.i32(cached_end_id))
            values = vec.select(sees_cached, vec.i32(cached_value), values)
            pending &= ~vec.movemask(sees_cached)
        _store_columns(out, column, width, values)
