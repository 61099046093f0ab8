"""Structs that the kernels of the look ``studio`` and their callers share."""

from __future__ import annotations

from typing import Any, Final

from renderers.compiler.device_function import device_function
from renderers.compiler.simd import LANES
from renderers.compiler.structs import F32, F64, I32, I64, U8, Struct, array_of, pointer_to
from renderers.shading.layout import SHADING_JOB, STRIDE

LIGHT: Final = Struct(
    "StudioLight",
    {
        "kind": I64,  # lights.DIRECTIONAL, POINT or SPOT
        "position": array_of(F64, 3),  # optical frame, metres
        "direction": array_of(F64, 3),  # unit vector in which it shines, optical frame
        "color": array_of(F64, 3),  # linear RGB times intensity
        "inv_range_squared": F64,  # 1 / range^2, 1/m^2; 0: unlimited range
        "spot_scale": F64,  # falloff of a spot: clamp(scale * cos(angle from the axis) + offset)^2
        "spot_offset": F64,
        "shadow_map": I64,  # index of a SHADOW_MAP, -1: no shadows
    },
)
SHADOW_MAP: Final = Struct(
    "StudioShadowMap",
    {
        "X_light_camera": array_of(F64, 12),  # (3, 4), from the optical frame of the camera to that of the light
        "focal_length": F64,  # texels
        "center": F64,  # principal point in both directions, texels
        "normal_offset": F64,  # offset of receivers along their normal, metres per metre of distance from the light
        "inv_z": pointer_to(F32),  # (side, side), as in ShadowMap
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
        "has_environment": I64,  # 0: environment_ and split_sum fields are not read
        "environment_texels": pointer_to(F32),  # Environment.texels
        "environment_tables": pointer_to(I32),  # Environment.tables
        "split_sum": pointer_to(F32),  # environment_map.split_sum
        "split_sum_side": I64,
        "R_world_camera": array_of(F64, 9),  # (3, 3) rotation from the optical frame to the world
        "exposure": F64,
        "tone": I64,  # index into tone_mapping.TONES
        "stop": I64,  # address of a stop flag, see stop.StopFlag
    },
)
"""Light of an image."""
STUDIO_JOB: Final = Struct("StudioJob", {"shading": SHADING_JOB, "lighting": LIGHTING})

OUTPUT: Final = Struct(
    "StudioOutput",
    {
        "background": array_of(F32, 3),  # linear RGB
        "srgb_cells": pointer_to(I32),  # tone_mapping.SRGB_CELLS
        "color": pointer_to(U8),  # (H, W, 3)
    },
)
"""Image to which finished rows are written."""
EDGE_SHADER: Final = Struct(
    "StudioEdgeShader",
    {
        "shade_rows": I64,  # address of the kernel
        "job": I64,  # address of a STUDIO_JOB
        "width": I64,  # pixels
        "output": I64,  # address of an OUTPUT
    },
)
"""Arguments of ``shade_rows.shade_edges`` for all bands of an image."""


def _rows(count: int) -> Any:
    """Return the type of a field of SURFACES with this number of rows."""
    return array_of(F32, count * STRIDE)


SURFACES: Final = Struct(
    "Surfaces",
    {
        "normal": _rows(3),  # unit, on the visible side
        "to_camera": _rows(3),  # unit
        "point": _rows(3),  # metres
        "flat_normal": _rows(3),  # unit normal of the triangle, towards the camera
        "base_color": _rows(3),  # linear
        "metallic": _rows(1),
        "roughness": _rows(1),
        "f0": _rows(3),  # reflectance of the dielectric at normal incidence
        "f90": _rows(1),  # reflectance of the dielectric at grazing angles
        "unoccluded": _rows(1),  # share of the environment's light that occlusion leaves
        "emitted": _rows(3),  # radiance; of unlit surfaces their colour
        "alpha": _rows(1),
        "color": _rows(3),  # linear RGB of the lit surface, tone-mapped
    },
)
"""Surfaces gathered for lighting: rows of STRIDE float32, one value per pixel. Vectors are in the optical frame."""


def channel_values(width: int) -> int:
    """Return the number of float32 in one channel of an image row, padded since loops overrun by up to a vector."""
    return (width + LANES - 1) // LANES * LANES + LANES


channel_values_in_kernel: Final = device_function(channel_values)
"""``channel_values`` for kernels."""
