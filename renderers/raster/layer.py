"""The Layer that a band is drawn into and shaded from."""

from __future__ import annotations

from renderers.compiler.device_function import inlined
from renderers.compiler.kernel_types import I64, Address
from renderers.compiler.pointers import advance, f32_at, i32_at
from renderers.raster.layout import Layer, RasterFrame
from renderers.visibility_buffer import BAND_ROWS


@inlined
def set_band_layer(frame: RasterFrame, layer: Layer, first_row: I64, band_memory: Address) -> None:
    """Set a Layer to that of the band which begins with ``first_row``.

    Args:
        band_memory: address of BAND_ROWS x stride int32, the ids, and as many float32, the 1/z; 0: the frame has a
            layer of the whole image.
    """
    if band_memory == 0:
        layer.ids, layer.inv_z, layer.first_row = i32_at(frame.layer_ids), f32_at(frame.layer_inv_z), 0
    else:
        layer.ids, layer.first_row = i32_at(band_memory), first_row
        layer.inv_z = advance(f32_at(band_memory), BAND_ROWS * frame.stride)
