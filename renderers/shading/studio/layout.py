"""Tables and structs that the kernels of the look ``studio`` and their callers share."""

from __future__ import annotations

from typing import Final

from renderers.compiler.device_function import device_function
from renderers.compiler.simd import LANES
from renderers.compiler.structs import F32, F64, I32, I64, U8, Struct, array_of, pointer_to
from renderers.shading.layout import S_COMMON, STRIDE

LIGHT: Final = Struct(
    "StudioLight",
    {
        "kind": I64,  # lights.DIRECTIONAL, POINT or SPOT
        "position": array_of(F64, 3),  # optical frame, metres
        "direction": array_of(F64, 3),  # unit vector in which it shines, optical frame
        "color": array_of(F64, 3),  # linear RGB times intensity
        "inv_range_squared": F64,  # 1 / m^2; 0: unlimited
        "spot_scale": F64,  # falloff of a spot: clamp(scale * cos(angle from the axis) + offset)^2
        "spot_offset": F64,
        "shadow_map": I64,  # index of a SHADOW_MAP, -1: no shadows
    },
)
SHADOW_MAP: Final = Struct(
    "StudioShadowMap",
    {
        "X_light_camera": array_of(F64, 12),  # first three rows of the transform from the camera's optical frame
        "focal_length": F64,  # texels
        "center": F64,  # principal point in both directions, texels
        "normal_offset": F64,  # metres by which receivers are offset along the normal, per metre from the light
        "inv_z": pointer_to(F32),  # (side, side)
        "side": I64,  # texels
    },
)
LIGHTING: Final = Struct(
    "StudioLighting",
    {
        "lights": LIGHT,
        "light_count": I64,
        "shadow_maps": SHADOW_MAP,
        "shadow_radius": I64,  # texels
        "has_environment": I64,  # 0: the next four are not read
        "environment_texels": pointer_to(F32),  # Environment.texels
        "environment_tables": pointer_to(I32),  # Environment.tables
        "split_sum": pointer_to(F32),  # environment_map.split_sum
        "split_sum_side": I64,
        "R_world_camera": array_of(F64, 9),
        "exposure": F64,
        "tone": I64,  # index into tone_mapping.TONES
        "stop": I64,  # address of a stop flag, see stop.StopFlag
    },
)
"""Light of an image. Its address is in column J_LIGHTING of the job, which follows those of ``shading.layout``."""
J_LIGHTING: Final = S_COMMON
J_COLUMNS: Final = S_COMMON + 1

OUTPUT: Final = Struct(
    "StudioOutput",
    {
        "background": array_of(F32, 3),  # linear RGB
        "srgb_cells": pointer_to(I32),  # tone_mapping.SRGB_CELLS
        "color": pointer_to(U8),  # (H, W, 3)
    },
)
"""The image that finished rows are written to."""
EDGE_SHADER: Final = Struct(
    "StudioEdgeShader",
    {
        "shade_rows": I64,  # address of the kernel
        "job": I64,
        "width": I64,
        "output": I64,
    },
)
"""Arguments of ``shade_rows.shade_edges`` for all bands of an image."""

# Rows of the table of gathered surfaces: float32, STRIDE values each, one per pixel; vectors in the optical frame.
R_NORMAL: Final = 0  # 3 rows: unit, on the visible side
R_VIEW: Final = 3  # 3 rows: unit, towards the camera
R_POINT: Final = 6  # 3 rows: metres
R_FLAT: Final = 9  # 3 rows: unit normal of the triangle, towards the camera
R_BASE: Final = 12  # 3 rows: base colour, linear
R_METALLIC: Final = 15
R_ROUGHNESS: Final = 16
R_F0: Final = 17  # 3 rows: of the dielectric
R_F90: Final = 20
R_AMBIENT: Final = 21  # share of the environment's light that is not occluded
R_EMITTED: Final = 22  # 3 rows
R_ALPHA: Final = 25
R_LIGHT: Final = 26  # 3 rows: the lit colour
R_ROWS: Final = 29
R_VALUES: Final = R_ROWS * STRIDE


def channel_values(width: int) -> int:
    """Return the number of float32 of one channel of an image row, padded since loops overrun by up to a vector."""
    return (width + LANES - 1) // LANES * LANES + LANES


channel_values_in_kernel: Final = device_function(channel_values)
"""``channel_values`` for kernels."""
